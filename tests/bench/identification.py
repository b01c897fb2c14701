"""The identification of M* (Bittencourt 2012) against scipy.optimize.least_squares, paired in one run: the same
samples, the same law, no knowledge of the answer. scipy starts at the middle of the ranges that identify searches;
its best of 2-point and exact derivatives counts. Arguments: the benchmark program identification_fit
(build/release/tests)."""
import json, os, subprocess, sys, tempfile, time

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from reference_law import M_STAR, law


def jacobian(p, v, l, T):
    x2, u = np.abs(v / p[7]) ** p[8], p[5] + p[6] * T
    x1, eT = np.abs(v / u) ** p[8], np.exp(-T / p[11])
    e1, e2, level = np.exp(-x1), np.exp(-x2), p[2] + p[3] * T
    du = level * e1 * x1 * p[8] / u
    dalpha = -level * e1 * x1 * np.log(np.abs(v / u)) - p[4] * l * e2 * x2 * np.log(np.abs(v / p[7]))
    return np.stack(
        [
            np.ones_like(v),
            l,
            e1,
            T * e1,
            l * e2,
            du,
            T * du,
            p[4] * l * e2 * x2 * p[8] / p[7],
            dalpha,
            v,
            v * eT,
            p[10] * v * eT * T / p[11] ** 2,
        ],
        1,
    )


start = [0.05, 0, 0.05, 0, 0, 28, 0, 28, 1.4, 2e-4, 0, 20]
random = np.random.default_rng(1)
for curves, repeats in ((484, 9), (83334, 3)):
    l, T = random.uniform(0, 0.73, curves).repeat(12), random.uniform(38, 81.2, curves).repeat(12)
    v = np.tile(1.5 * (280 / 1.5) ** (np.arange(12) / 11), curves)
    y = law(M_STAR, v, l, T) + random.normal(0, 4.23e-3, v.size)
    with tempfile.NamedTemporaryFile() as f:
        np.stack([v, l, T, y]).tofile(f.name)
        ratios = []
        for _ in range(repeats):
            best = None
            for jac in (
                3 * ("2-point", lambda p, *_: jacobian(p, v, l, T))
                if curves < 1000
                else ("2-point", lambda p, *_: jacobian(p, v, l, T))
            ):
                begin = time.perf_counter()
                r = least_squares(lambda p: law(p, v, l, T) - y, start, jac=jac, x_scale="jac")
                seconds = time.perf_counter() - begin
                best = min(best or (seconds, 2 * r.cost), (seconds, 2 * r.cost))
            ours = json.loads(subprocess.run([sys.argv[1], f.name], capture_output=True, text=True, check=True).stdout)
            ratios.append((best[0] / ours["seconds"], best[0], ours["seconds"], ours["cost"] / best[1] - 1))
    ratio, scipy_s, our_s, excess = sorted(ratios)[len(ratios) // 2]
    print(
        f"{v.size} samples: scipy {scipy_s:.4f} s, identify {our_s:.4f} s: {ratio:.1f} x; "
        f"cost relative to scipy's {excess:+.1e}"
    )
