"""Reference tables for the observer's kernels and native spaces, made with mpmath, numpy and scipy only.

Run from the repository's root:

    python3 daemon/observer/tests/kernel_reference.py kernels      > daemon/observer/tests/kernel_reference.csv
    python3 daemon/observer/tests/kernel_reference.py native-space > daemon/observer/tests/native_space_reference.csv

Every decimal number (r, lattice coordinate, point) stands for the double nearest to it, taken exactly. All printed
values come from mpmath; doubles are used only to search for the supremum of the power function.

Cases of the native-space table (axes are divided by the length scale before distances are taken):
A  3x3x3 lattice on [-1,1]^3, Sobolev-Matern d=3 k=3, length scale 1
B  3x3x3 lattice on [-0.1,0.1]^3, the rest as A
C  5x4 lattice on [-2,2]x[-1,1], Sobolev-Matern d=2 k=3, length scales 1.5 and 0.5
D  7 points -3..3 on a line, Gaussian, length scale 1
E  as A with Wendland C2, support radius (length scale) 2.5
The power function's supremum is taken over the centers' bounding box. By symmetry several points attain it; the
table holds one of them (the lexicographically largest), and the value is the power function at exactly that point.
"""
import itertools
import sys

import mpmath
import numpy as np
from mpmath import mp, mpf
from scipy import linalg, ndimage, optimize, special

mp.dps = 50
COMMAND = "# made by: python3 daemon/observer/tests/kernel_reference.py {0} > daemon/observer/tests/{1}_reference.csv"


# ---- kernels, in mpmath -----------------------------------------------------------------------------------------

def sobolev_matern(d, k):
    def kappa(r):
        nu = mpf(k) - mpf(d) / 2
        if r == 0:
            return mp.pi ** (mpf(d) / 2) * mp.gamma(nu) / mp.gamma(k)
        return 2 * mp.pi ** (mpf(d) / 2) / mp.gamma(k) * mp.besselk(nu, r) * (r / 2) ** nu
    return kappa


def gaussian(r):
    return mp.exp(-r * r / 2)


def wendland_c2(r):
    return (1 - r) ** 4 * (4 * r + 1) if r < 1 else mpf(0)


def wendland_c4(r):
    return (1 - r) ** 6 * (35 * r * r + 18 * r + 3) / 3 if r < 1 else mpf(0)


def digits(value, n=20):
    return mpmath.nstr(value, n, strip_zeros=False)


def kernel_table():
    print(COMMAND.format("kernels", "kernel"))
    print("kernel,d,k,r,value")
    orders = [(d, d // 2 + i) for d in range(1, 8) for i in range(1, 6)] + [(3, 12), (2, 12)]
    radii = "0 1e-200 1e-12 1e-6 1e-3 0.01 0.1 0.5 0.99 1 1.5 1.99 2 2.01 3 5 7.99 8.01 10 20 50 200".split()
    for (d, k), r in itertools.product(orders, radii):
        value = sobolev_matern(d, k)(mpf(float(r)))
        with mp.workdps(90):  # the value must not depend on the working precision
            assert abs(sobolev_matern(d, k)(mpf(float(r))) / value - 1) < mpf("1e-30"), (d, k, r)
        print(f"sobolev-matern,{d},{k},{r},{digits(value)}")
    small = "0 1e-200 1e-12 1e-6 1e-3 0.01 0.1 0.25 0.5 0.75 0.9 0.99 0.999999 1 1.000001 1.5".split()
    for name, kappa, large in [("gaussian", gaussian, "2 3 5 8 10 20 30"), ("wendland-c2", wendland_c2, "2 30"),
                               ("wendland-c4", wendland_c4, "2 30")]:
        for r in small + large.split():
            print(f"{name},,,{r},{digits(kappa(mpf(float(r))))}")


# ---- native spaces ----------------------------------------------------------------------------------------------

def sobolev_matern_doubles(d, k):
    nu, factor = k - d / 2, 2 * np.pi ** (d / 2) / special.gamma(k)
    at_zero = np.pi ** (d / 2) * special.gamma(nu) / special.gamma(k)

    def kappa(r):
        positive = np.where(r > 0, r, 1.0)
        return np.where(r > 0, factor * special.kv(nu, positive) * (positive / 2) ** nu, at_zero)
    return kappa


class Case:
    def __init__(self, name, kappa, kappa_doubles, axes, length_scales, points):
        self.name, self.kappa, self.kappa_doubles, self.axes, self.points = name, kappa, kappa_doubles, axes, points
        self.scales = np.array(length_scales)
        self.centers = np.array(list(itertools.product(*axes)))
        self.box = [(axis[0], axis[-1]) for axis in axes]
        self.gram = mp.matrix([[kappa(self.distance(a, b)) for b in self.centers] for a in self.centers])
        self.inverse = self.gram ** -1
        gram_doubles = kappa_doubles(self.distances(self.centers))
        self.cholesky = linalg.cholesky(gram_doubles, lower=True)

    def distance(self, a, b):
        return mp.sqrt(sum(((mpf(float(x)) - mpf(float(y))) / mpf(float(s))) ** 2
                           for x, y, s in zip(a, b, self.scales)))

    def distances(self, points):
        """Doubles: one row a point, one column a center."""
        return np.linalg.norm((points[:, None, :] - self.centers[None, :, :]) / self.scales, axis=2)

    def power_function(self, point):
        k = mp.matrix([self.kappa(self.distance(center, point)) for center in self.centers])
        return mp.sqrt(self.kappa(mpf(0)) - (k.T * self.inverse * k)[0])

    def power_squared_doubles(self, points):
        phi = linalg.solve_triangular(self.cholesky, self.kappa_doubles(self.distances(points)).T, lower=True)
        return float(self.kappa(mpf(0))) - np.sum(phi * phi, axis=0)

    def grid(self):
        """A fine grid over the box; 48 divides by twice the cells of every axis, so it holds the cells' midpoints."""
        n = {1: 4801, 2: 481, 3: 49}[len(self.axes)]
        lines = [np.linspace(low, high, n) for low, high in self.box]
        return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)

    def supremum(self):
        """Every local maximum on the grid is refined in doubles, the best of them once more in mpmath."""
        grid = self.grid()
        points = grid.reshape(-1, grid.shape[-1])
        values = np.concatenate([self.power_squared_doubles(part) for part in np.array_split(points, 20)])
        field = values.reshape(grid.shape[:-1])
        is_peak = (field == ndimage.maximum_filter(field, size=3)).ravel() & (values > 0.5 * values.max())
        top, half = values.max(), [(high - low) / 2 for low, high in self.box]

        def refine(objective, start, size):
            simplex = np.vstack([start] + [start - size * h * np.sign(x or 1) * e  # towards the middle: stays inside
                                           for h, x, e in zip(half, start, np.eye(len(half)))])
            return optimize.minimize(objective, start, method="Nelder-Mead", bounds=self.box, options=dict(
                initial_simplex=simplex, xatol=1e-9 * min(half), fatol=1e-15, maxiter=4000)).x

        peaks = [refine(lambda y: -self.power_squared_doubles(y[None, :])[0] / top, start, 0.02)
                 for start in points[is_peak]]
        heights = [self.power_squared_doubles(peak[None, :])[0] for peak in peaks]
        best = [p for p, height in zip(peaks, heights) if height > max(heights) * (1 - 1e-9)]
        start = max(best, key=lambda p: tuple(np.round(p / half, 5)))
        scale = self.power_function(start)
        point = refine(lambda y: -float(self.power_function(y) / scale), start, 1e-3)
        value = max((self.power_function(p), tuple(p)) for p in (start, point))
        print(f"# {self.name}: {len(peaks)} local maxima on the grid, {len(best)} attain the supremum; "
              f"gain of the last refinement {mpmath.nstr(value[0] / scale - 1, 3)}", file=sys.stderr)
        return value

    def fill_distance(self):
        """Of a lattice: half of one cell's diagonal, in the scaled metric."""
        edges = [mpf(high - low) / (len(axis) - 1) / mpf(float(s))
                 for (low, high), axis, s in zip(self.box, self.axes, self.scales)]
        half_diagonal = mp.sqrt(sum(edge ** 2 for edge in edges)) / 2
        points = self.grid().reshape(-1, len(self.axes))
        searched = max(self.distances(part).min(axis=1).max() for part in np.array_split(points, 20))
        assert abs(searched / half_diagonal - 1) < 1e-12, (self.name, searched, half_diagonal)
        return half_diagonal

    def print_rows(self):
        eigenvalues = mp.eigsy(self.gram, eigvals_only=True)
        print(f"condition_number,{self.name},{digits(max(eigenvalues) / min(eigenvalues))}")
        for text in self.points:
            value = self.power_function([float(x) for x in text.split()])
            print(f"power_function at {text},{self.name},{digits(value)}")
        value, point = self.supremum()
        print(f"power_function_supremum at {' '.join(repr(float(x)) for x in point)},{self.name},{digits(value)}")
        print(f"fill_distance,{self.name},{digits(self.fill_distance())}")
        separation = min(self.distance(a, b) for a, b in itertools.combinations(self.centers, 2)) / 2
        print(f"separation_distance,{self.name},{digits(separation)}")


def native_space_table():
    # three points inside the box and one outside
    cube = ["0.3 -0.2 0.7", "0.5 0.5 0.5", "-0.95 0.5 0.05", "1.8 -1.3 0.4"]
    small_cube = ["0.03 -0.02 0.07", "0.05 0.05 0.05", "-0.095 0.05 0.005", "0.18 -0.13 0.04"]
    rectangle = ["0.4 -0.1", "1.7 0.6", "-1.95 -0.65", "2.5 1.4"]
    line = ["0.5", "-2.4", "2.95", "4.2"]
    matern3 = sobolev_matern(3, 3), sobolev_matern_doubles(3, 3)
    matern2 = sobolev_matern(2, 3), sobolev_matern_doubles(2, 3)
    wendland = wendland_c2, lambda r: np.maximum(1 - r, 0) ** 4 * (4 * r + 1)
    print(COMMAND.format("native-space", "native_space"))
    print("quantity,case,value")
    Case("A", *matern3, [np.linspace(-1, 1, 3)] * 3, [1, 1, 1], cube).print_rows()
    Case("B", *matern3, [np.linspace(-0.1, 0.1, 3)] * 3, [1, 1, 1], small_cube).print_rows()
    Case("C", *matern2, [np.linspace(-2, 2, 5), np.linspace(-1, 1, 4)], [1.5, 0.5], rectangle).print_rows()
    Case("D", gaussian, lambda r: np.exp(-r * r / 2), [np.linspace(-3, 3, 7)], [1], line).print_rows()
    Case("E", *wendland, [np.linspace(-1, 1, 3)] * 3, [2.5] * 3, cube).print_rows()


if __name__ == "__main__":
    tables = {"kernels": kernel_table, "native-space": native_space_table}
    if len(sys.argv) != 2 or sys.argv[1] not in tables:
        sys.exit(f"usage: kernel_reference.py {' | '.join(tables)}")
    tables[sys.argv[1]]()
