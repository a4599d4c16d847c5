"""Independent reference for the two examples of the paper, written from the specification alone (its sections 2, 3,
4, 6 and 8) and in the paper's own coordinates: coefficients alpha_hat, with K^-1 by Cholesky. It shares nothing with
the Rust program that it checks.

    python3 bench/tests/paper_reference.py translation --dead-zone saturated --adaptation-rate 100 --duration 60
    python3 bench/tests/paper_reference.py --table > bench/tests/paper_reference.csv

A row j holds t_j, the truth at t_j, the estimate for t_j *before* sample j is used, f at the true state, f_hat as used
in the step from t_j, |ytilde_j|, sigma, and P_N(y_j). Needs numpy and scipy.
"""
import argparse
import math
import shlex
import sys

import numpy as np
from scipy.linalg import cho_factor, cho_solve

CASES = [
    "translation",
    "translation --dead-zone saturated --adaptation-rate 100",
    "translation --dead-zone saturated --adaptation-rate 10 --gain 2 --initial zero-velocity",
    "translation --dead-zone step --width 0.03 --adaptation-rate 20 --kernel-order 2 --rate-hz 100",
    "translation --adaptation-rate 5 --kernel-order 4 --initial zero-velocity --scheme predict-first",
    "rotation",
    "rotation --dead-zone saturated --width 0.02 --buffer 0.02 --adaptation-rate 5 --initial zero-velocity",
    "rotation --dead-zone step --width 0.02 --adaptation-rate 2 --kernel-order 4 --rate-hz 500 --scheme predict-first",
]
MASS = 4.0
INERTIA = np.array([0.2, 15.0, 15.0])
TAIL = "f1,f2,f3,f1_hat,f2_hat,f3_hat,output_error,sigma,coverage"
STATE_NAMES = {"translation": "r1 r2 r3 v1 v2 v3", "rotation": "phi theta psi w1 w2 w3", "table": "x1 x2 x3 x4 x5 x6"}


def kernel(order, r):
    """Section 2: Sobolev-Matern, d = 3, length scale 1: closed forms of 2 pi^(3/2)/Gamma(k) K_nu(r) (r/2)^nu."""
    factor = {2: 1.0, 3: (1 + r) / 4, 4: (3 + 3 * r + r**2) / 24, 5: (15 + 15 * r + 6 * r**2 + r**3) / 192}[order]
    return math.pi**2 * factor * np.exp(-r)


def dead_zone(shape, e, d, eps):
    """Section 4."""
    if shape == "step":
        return 0.0 if e < d else 1.0
    if e <= d:
        return 0.0
    if shape == "quadratic":
        return (e - d) ** 2 / (2 * eps) if e <= d + eps else e - d - eps / 2
    s = min((e - d) / eps, 1.0)
    return s * s * (3 - 2 * s)


# ---------------------------------------------------------------- section 8: the two plants
# Plain floats: the plants take most of the time. The state is r, v or (quaternion w x y z), omega.

def translation_force(v):
    return [math.cos(v[0] ** 2), math.sin(v[1] ** 2) + math.sin(v[0]), math.cos(v[2]) + math.sin(v[1])]


def translation_rate(x, u):
    f = translation_force(x[3:])
    return [x[3], x[4], x[5], (u[0] + f[0]) / MASS, (u[1] + f[1]) / MASS, (u[2] + f[2]) / MASS]


def translation_command(x, t):
    r_ref = [math.sin(t), math.cos(t), math.sin(2 * t)]
    v_ref = [math.cos(t), -math.sin(t), 2 * math.cos(2 * t)]
    a_ref = [-math.sin(t), -math.cos(t), -4 * math.sin(2 * t)]
    return [-(x[i] - r_ref[i]) - (x[3 + i] - v_ref[i]) + MASS * a_ref[i] for i in range(3)]


def rotation_torque(w):
    """The whole matched torque: drag and the gyroscopic term, -0.001 |w| w - w x (I w)."""
    i1, i2, i3 = map(float, INERTIA)
    gyroscopic = [(i3 - i2) * w[1] * w[2], (i1 - i3) * w[2] * w[0], (i2 - i1) * w[0] * w[1]]
    return [-0.001 * math.hypot(*w) * w[i] - gyroscopic[i] for i in range(3)]


def rotation_rate(x, u):
    w = x[4:]
    f = rotation_torque(w)
    q_rate = [0.5 * c for c in quaternion_product(x[:4], [0.0] + w)]
    return q_rate + [(u[i] + f[i]) / float(INERTIA[i]) for i in range(3)]


def rotation_command(x, t):
    s = 0.1 * t
    w_ref = [0.1 * math.cos(s), 0.1 * math.sin(s), 0.1 * math.tanh(s)]
    w_ref_rate = [-0.01 * math.sin(s), 0.01 * math.cos(s), 0.01 / math.cosh(s) ** 2]
    return [-10 * (x[4 + i] - w_ref[i]) + w_ref_rate[i] for i in range(3)]


def rk4(rate, x, u, h, substep):
    """Classical Runge-Kutta over h in equal substeps no longer than `substep`, u held."""
    count = max(1, math.ceil(h / substep - 1e-6))
    s = h / count
    for _ in range(count):
        k1 = rate(x, u)
        k2 = rate([a + s / 2 * b for a, b in zip(x, k1)], u)
        k3 = rate([a + s / 2 * b for a, b in zip(x, k2)], u)
        k4 = rate([a + s * b for a, b in zip(x, k3)], u)
        x = [a + s / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4)]
    return x


# ---------------------------------------------------------------- section 6: attitude

def quaternion_product(p, q):
    return [
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    ]


def turn(q, rotation):
    """q followed by the body-frame rotation vector: q (x) exp(rotation / 2), normalised."""
    angle = math.hypot(*rotation)
    factor = 0.5 if angle == 0 else math.sin(angle / 2) / angle
    q = quaternion_product(q, [math.cos(angle / 2)] + [factor * c for c in rotation])
    return [c / math.hypot(*q) for c in q]


def euler(q):
    """3-2-1 angles phi, theta, psi of the quaternion that turns body vectors into the inertial frame; (-pi, pi]."""
    w, x, y, z = (c / math.hypot(*q) for c in q)
    angles = [
        math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))),
        math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    ]
    return [math.pi if a == -math.pi else a for a in angles]


# ---------------------------------------------------------------- sections 3 and 8: one run

def run(scenario, dead_zone_shape="quadratic", width=None, buffer=0.01, adaptation_rate=1.0, kernel_order=3, gain=10.0,
        initial="reference", rate_hz=200.0, duration=None, scheme="update-first", substep=1e-3):
    """The rows j = 0 .. duration*rate_hz as an array: t, 6 states, 6 estimates, f, f_hat, |ytilde|, sigma, P_N(y)."""
    translation = scenario == "translation"
    width = (0.01 if translation else 0.1) if width is None else width
    duration = (60.0 if translation else 100.0) if duration is None else duration

    if translation:
        rate, command, matched = translation_rate, translation_command, translation_force
        state = [0.0, 1.0, 0.0, 1.0, 0.0, 2.0]
        axis, b = np.array([-1.0, 0.0, 1.0]), np.full(3, 1 / MASS)
        noise = lambda t: 0.008 * (math.sin(0.5 * t) + math.cos(0.5 * t))
    else:
        rate, command, matched = rotation_rate, rotation_command, rotation_torque
        state = [1.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0]
        axis, b = np.array([-0.1, 0.0, 0.1]), 1 / INERTIA
        noise = lambda t: 0.05 * math.sin(5 * t)

    centers = np.array([[p, q, r] for p in axis for q in axis for r in axis])
    centers = centers.astype(np.longdouble)  # for P_N only, see below
    gram = kernel(kernel_order, np.linalg.norm(centers[:, None] - centers[None], axis=2))
    factor = cho_factor(gram.astype(float), lower=True)

    # The estimate: pose_hat is r_hat or q_hat, rate_hat is v_hat or omega_hat (the measured part), alpha is alpha_hat.
    pose_hat = list(state[:-3])
    rate_hat = np.array(state[-3:]) if initial == "reference" else np.zeros(3)
    alpha = np.zeros((len(centers), 3))

    rows = []
    count = round(duration * rate_hz)
    for j in range(count + 1):
        t = j / rate_hz
        h = (j + 1) / rate_hz - t
        y = np.array(state[-3:]) + noise(t)
        u = command(state, t)

        error = y - rate_hat
        e = float(np.linalg.norm(error))
        sigma = dead_zone(dead_zone_shape, e, width, buffer)
        k_long = kernel(kernel_order, np.linalg.norm(centers - y, axis=1))
        k = k_long.astype(float)
        cardinal = cho_solve(factor, k)  # K^-1 k(y)
        alpha_next = alpha + h * sigma * np.outer(cardinal, adaptation_rate * error)
        f_hat = k @ (alpha_next if scheme == "update-first" else alpha)
        # P_N(y)^2 = kappa(0) - k' K^-1 k, as |K(y,.) - sum_j cardinal_j K(xi_j,.)|^2 in extended precision: the plain
        # difference cancels near a center, and its root is then wrong by up to 1e-7.
        coverage = math.sqrt(max(0.0, float(gram[0, 0] - 2 * (k_long @ cardinal) + cardinal @ gram @ cardinal)))

        shown, shown_hat = (state[:3], pose_hat) if translation else (euler(state[:4]), euler(pose_hat))
        rows.append([t, *shown, *state[-3:], *shown_hat, *rate_hat, *matched(state[-3:]), *f_hat, e, sigma, coverage])
        if j == count:
            break

        # rate_hat' = -gain rate_hat + w with w held: exact, and so is its integral.
        w = gain * y + b * (np.array(u) + f_hat)
        once = -math.expm1(-gain * h) / gain
        rate_hat_next = math.exp(-gain * h) * rate_hat + once * w
        if translation:
            pose_hat = list(np.array(pose_hat) + once * rate_hat + (h - once) / gain * w)
        else:
            pose_hat = turn(pose_hat, list(h * (rate_hat + rate_hat_next) / 2))
        rate_hat, alpha = rate_hat_next, alpha_next
        state = rk4(rate, state, u, h, substep)
    return np.array(rows, dtype=float)


# ---------------------------------------------------------------- command line

def parser():
    p = argparse.ArgumentParser(description="Reference runs of the paper's two examples, as CSV on standard output.")
    p.add_argument("scenario", nargs="?", choices=["translation", "rotation"])
    shapes = ["quadratic", "saturated", "step"]
    p.add_argument("--dead-zone", dest="dead_zone_shape", choices=shapes, default="quadratic")
    p.add_argument("--width", type=float, help="d; 0.01 for the translation, 0.1 for the rotation")
    p.add_argument("--buffer", type=float, default=0.01, help="epsilon")
    p.add_argument("--adaptation-rate", type=float, default=1.0)
    p.add_argument("--kernel-order", type=int, choices=[2, 3, 4, 5], default=3)
    p.add_argument("--gain", type=float, default=10.0, help="lambda, 1/s")
    p.add_argument("--initial", choices=["reference", "zero-velocity"], default="reference")
    p.add_argument("--rate-hz", type=float, default=200.0)
    p.add_argument("--duration", type=float, help="s; 60 for the translation, 100 for the rotation")
    p.add_argument("--scheme", choices=["update-first", "predict-first"], default="update-first")
    p.add_argument("--table", action="store_true", help="the cases of paper_reference.csv")
    return p


def header(which):
    names = STATE_NAMES[which].split()
    return ",".join(["t_s", *names, *(n + "_hat" for n in names), TAIL])


def line(row):
    return ",".join(f"{value + 0.0:.17g}" for value in row)  # + 0.0 turns -0 into 0


def main():
    options = vars(parser().parse_args())
    if options.pop("table"):
        print("# made by: python3 bench/tests/paper_reference.py --table > bench/tests/paper_reference.csv")
        print("case," + header("table"))
        for case in CASES:
            chosen = vars(parser().parse_args(shlex.split(case) + ["--duration", "10"]))
            chosen.pop("table")
            for j, row in enumerate(run(**chosen)):
                if j < 4 or j % 100 == 0:
                    print(case + "," + line(row))
    elif options["scenario"] is None:
        sys.exit("name a scenario, translation or rotation, or ask for --table")
    else:
        print(header(options["scenario"]))
        for row in run(**options):
            print(line(row))


if __name__ == "__main__":
    main()
