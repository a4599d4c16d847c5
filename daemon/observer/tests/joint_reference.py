"""The joint law of docs/method.md, written from its equations with NumPy; it shares no code with the library.

    python3 daemon/observer/tests/joint_reference.py > daemon/observer/tests/joint_reference.csv

prints, for the paper's first example, what the law does at some samples of five runs: even steps with and without noise
levels and excitation, uneven steps of 2 to 7 ms, every seventh sample missing, spikes of 1 m/s, another noise on each axis.
"""

import math

import numpy as np

MASS = 4.0
HALF_WIDTH = 2.2
SIGMA_B, SIGMA_V, SIGMA_F, SIGMA_U, SIGMA_L = 0.5, 0.3, 0.35, 0.15, 0.3
SIGMA_D, TAU_D, Q = 0.1, 0.2, 1.5e-3
LAGS = np.array([0.05, 0.2])
MEAN_TIME, VARIATION_TIME, IDLE_RATE = 5.0, 0.2, 0.05


def kernel(r):
    return (1 + r) * np.exp(-r)


class Law:
    """Three covariances, one for each axis: with equal noises they stay equal."""

    def __init__(self, noise, n_a=500.0, c=0.3):
        self.noise, self.n_a, self.c = np.array(noise), n_a, c
        axis = np.linspace(-HALF_WIDTH, HALF_WIDTH, 3)
        self.centers = np.array([[x, y, z] for x in axis for y in axis for z in axis])
        between = np.linalg.norm(self.centers[:, None] - self.centers[None], axis=-1) / HALF_WIDTH
        self.factor = np.linalg.cholesky(kernel(between))
        self.memory = np.concatenate([np.full(4 + 27, 300.0), np.full(9, 3600.0)])
        self.n = 2 + len(self.memory)
        self.x = None

    def features(self, v, a, lag_means):
        phi = np.linalg.solve(self.factor, kernel(np.linalg.norm(self.centers - v, axis=1) / HALF_WIDTH))
        psi = np.concatenate(
            [
                [SIGMA_B],
                SIGMA_V * v / HALF_WIDTH,
                SIGMA_F * phi,
                SIGMA_U * a,
                SIGMA_L * lag_means[0],
                SIGMA_L * lag_means[1],
            ]
        )
        return psi, max(1 - phi @ phi, 0.0)

    def start(self, y):
        self.x = np.zeros((self.n, 3))
        self.x[0] = y
        self.p = [
            np.diag(np.concatenate([[r**2, SIGMA_D**2], np.ones(len(self.memory))])) for r in self.noise
        ]
        self.rho = self.lam = self.g = 1.0
        self.m, self.a_square, self.variation = np.zeros(3), 0.0, 0.0
        self.lagged = self.mean = None
        self.strays = 0

    def update(self, y, since):
        if self.x is None:
            self.start(y)
        e = y - self.x[0]
        p00 = np.array([p[0, 0] for p in self.p])
        noise = self.rho * self.noise**2
        s = p00 + noise
        k = p00 / s
        zeta = math.sqrt(np.mean(e**2 / s))
        if since > 0 and self.c > 0:
            self.a_square = np.sum(self.c**2 * p00 * (1 - k) * (k / since) ** 2) * max(1, self.lam**-1.5)
        if self.n_a > 0:
            chi = min(1, 4 / zeta) if zeta > 0 else 1
            gain = k.mean()
            by_scale = (chi**2 * zeta**2 - 1) / self.n_a
            by_gain = chi * np.mean(e * self.m / s) / max(gain / (2 - gain), 1e-3) / self.n_a
            self.rho = np.clip(self.rho * math.exp(by_scale - gain / max(1 - gain, 0.05) * by_gain), 0.01, 100)
            self.lam = np.clip(self.lam * math.exp(by_scale + 2 * by_gain), math.exp(-2), 100)
            self.m = (1 - k) * self.m + k * chi * e
        self.strays = self.strays + 1 if zeta > 4 else 0
        for i, p in enumerate(self.p):
            if self.strays > 3:
                p[0, 0] += np.mean(e**2)
                s_w = p[0, 0] + noise[i]
            else:
                s_w = s[i] * max(1, zeta / 4)
            column = p[:, 0].copy()
            self.x[:, i] += column / s_w * e[i]
            p -= np.outer(column, column) / s_w
            p[0, :] = p[:, 0] = column * (s_w - column[0]) / s_w

    def predict(self, h, a):
        if self.lagged is None:
            self.lagged = np.array([a, a])
        alpha = np.exp(-h / LAGS)[:, None]
        lag_means = (a - self.lagged) * LAGS[:, None] * (1 - alpha) / h
        self.lagged = alpha * self.lagged + (1 - alpha) * a
        psi, uncovered = self.features(self.x[0], a, lag_means)
        s = np.concatenate([[1, math.exp(-h / TAU_D)], np.exp(-h / self.memory)])
        f = np.concatenate([[1, TAU_D * (1 - s[1])], h * psi])
        velocity = f @ self.x + h * a
        learned = f[1:] @ self.x[1:] / h
        if self.mean is None:
            self.mean = psi.copy()
        self.mean += (1 - math.exp(-h / MEAN_TIME * (self.g + IDLE_RATE))) * (psi - self.mean)
        square = np.sum((psi - self.mean) ** 2)
        self.variation += (1 - math.exp(-h / VARIATION_TIME)) * (square - self.variation)
        self.g = 1.0
        if self.a_square > 0:
            self.g = self.variation**4 / (self.variation**4 + self.a_square**4)
        f[2:] = h * (self.mean + self.g * (psi - self.mean))
        self.x *= s[:, None]
        self.x[0] = velocity
        driven = self.lam * SIGMA_D**2 * (1 - s[1] ** 2)
        std = []
        for p in self.p:
            w = p @ f
            p[0, :] = p[:, 0] = w
            p[0, 0] = f @ w
            p *= np.outer(s, s)
            prior = np.concatenate([[0, self.lam * SIGMA_D**2], np.ones(len(self.memory))])
            p[np.diag_indices(self.n)] += prior * (1 - s**2)
            p[0, 0] += (self.lam * Q + 0.1 * 2 * TAU_D * SIGMA_F**2 * uncovered) * h + driven * h**2 / 3
            p[0, 1] += driven * h / 2
            p[1, 0] = p[0, 1]
            c = np.concatenate([[0, 1], psi])
            std.append(math.sqrt(c @ p @ c + SIGMA_F**2 * uncovered))
        return learned, std


def force(v):
    return np.array(
        [math.cos(v[0] ** 2), math.sin(v[1] ** 2) + math.sin(v[0]), math.cos(v[2]) + math.sin(v[1])]
    )


def reference(t):
    return (
        np.array([math.sin(t), math.cos(t), math.sin(2 * t)]),
        np.array([math.cos(t), -math.sin(t), 2 * math.cos(2 * t)]),
        np.array([-math.sin(t), -math.cos(t), -4 * math.sin(2 * t)]),
    )


def advance(r, v, u, h):
    n = math.ceil(h * 1000 - 1e-9)
    dt = h / n
    for _ in range(n):
        k1 = (u + force(v)) / MASS
        k2 = (u + force(v + dt / 2 * k1)) / MASS
        k3 = (u + force(v + dt / 2 * k2)) / MASS
        k4 = (u + force(v + dt * k3)) / MASS
        r = r + dt * v + dt * dt / 6 * (k1 + k2 + k3)
        v = v + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return r, v


def run(name, law, steps_ms, is_missing, spike):
    r, v, _ = reference(0.0)
    t, last = 0.0, None
    for j in range(2001):
        h = steps_ms(j) / 1000
        r_r, v_r, a_r = reference(t)
        u = -(r - r_r) - (v - v_r) + MASS * a_r
        y = v + 0.008 * (math.sin(0.5 * t) + math.cos(0.5 * t)) + spike(j)
        before = y if law.x is None else law.x[0].copy()
        std = law.noise if law.x is None else [math.sqrt(p[0, 0]) for p in law.p]
        if not is_missing(j):
            law.update(y, 0.0 if last is None else t - last)
            last = t
        norm = math.sqrt(np.sum(law.x[2:] ** 2))
        traces = [np.trace(p[2:, 2:]) for p in law.p]
        learned, learned_std = law.predict(h, u / MASS)
        if j in (1, 10, 199, 200, 700, 1000, 2000):
            row = [*before, *(MASS * learned), *std, *(MASS * np.array(learned_std)), norm, *traces]
            print(name, j, *("%.13e" % value for value in row), sep=",")
        r, v = advance(r, v, u, h)
        t += h


def never(_):
    return False


def none(_):
    return 0.0


if __name__ == "__main__":
    print("run,sample,v1,v2,v3,f1,f2,f3,std1,std2,std3,f_std1,f_std2,f_std3,weights_norm,trace1,trace2,trace3")
    equal = [0.01] * 3
    run("even", Law(equal), lambda j: 5, never, none)
    run("plain", Law(equal, 0.0, 0.0), lambda j: 5, never, none)
    run("uneven", Law(equal), lambda j: 2 + j * 7919 % 6, never, none)
    run("missing", Law(equal), lambda j: 5, lambda j: j % 7 == 6, none)
    run("spikes", Law(equal), lambda j: 5, never, lambda j: float(j % 50 == 49) * (-1) ** (j // 50))
    run("axes", Law([0.01, 0.02, 0.005]), lambda j: 5, never, none)
