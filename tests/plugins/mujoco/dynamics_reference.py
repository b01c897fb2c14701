#!/usr/bin/python3
"""Reference numbers for lugre_test and transmission_test: the equations of the RH380-N study, written down a second
time and integrated by scipy to 1e-10. Prints one row of numbers per sample: `dynamics_reference.py CASE`."""
import sys
import numpy as np
from scipy.integrate import solve_ivp

# Canudas de Wit 1995, Table I, with the fading damping of the RH380-N study.
SIGMA0, SIGMA1, VD, FC, FS, VS, FV = 1e5, 316.0, 0.02, 1.0, 1.5, 0.001, 0.4


def g(w):
    return FC + (FS - FC) * np.exp(-((w / VS) ** 2))


def dz(w, z):
    return w - SIGMA0 * abs(w) * z / g(w)


def friction(w, z):
    return SIGMA0 * z + SIGMA1 * np.exp(-((w / VD) ** 2)) * dz(w, z) + FV * w


def integrate(f, y0, times, longest=np.inf, method="DOP853"):
    solution = solve_ivp(
        f, (times[0], times[-1]), y0, method=method, t_eval=times, rtol=1e-10, atol=1e-15, max_step=longest
    )
    assert solution.success, solution.message
    return solution.y


def prescribed(speed, times):
    z = integrate(lambda t, y: [dz(speed(t), y[0])], [0.0], times, 1e-3)[0]
    for t, zi in zip(times, z):
        print(repr(t), repr(float(friction(speed(t), zi))))


def presliding():  # displacement of two sizes below breakaway, 1.5e-5 m
    a, f = 6e-6, 2 * np.pi * 5
    prescribed(lambda t: a * f * np.cos(f * t) * (1 + 0.5 * np.sin(0.37 * f * t)), np.linspace(0, 1, 201))


def lag(frequency):  # speed varies, direction does not
    f = 2 * np.pi * float(frequency)
    prescribed(lambda t: 1.5e-3 + 1.2e-3 * np.sin(f * t), np.linspace(0, 3 / float(frequency), 151))


def stick_slip():  # 1 kg drawn by a spring of 2 N/m whose end moves at 0.1 m/s; the paper's figure
    times = np.linspace(0, 40, 801)
    y = integrate(
        lambda t, y: [y[1], 2 * (0.1 * t - y[0]) - friction(y[1], y[2]), dz(y[1], y[2])],
        [0.0, 0.0, 0.0],
        times,
        method="LSODA",
    )
    for row in zip(times, y[0], y[1]):
        print(*(repr(float(x)) for x in row))


def breakaway():  # force rate, force at which a mass of 1 kg starts to slide (speed crosses 1e-3 m/s for good)
    for rate in (0.1, 0.5, 1.0, 2.0, 5.0, 20.0):
        gone = lambda t, y: y[1] - 1e-3
        gone.terminal, gone.direction = True, 1
        s = solve_ivp(
            lambda t, y: [y[1], rate * t - friction(y[1], y[2]), dz(y[1], y[2])],
            (0, 3 / rate),
            [0, 0, 0],
            method="LSODA",
            rtol=1e-10,
            atol=1e-14,
            events=gone,
        )
        print(repr(rate), repr(float(rate * s.t_events[0][0])))


def hysteresis():  # torsion of two frequencies; rows of phi, tau_g, heat so far
    k0, k1, k2, w, beta, gamma, n = 1.2e6, 4e7, 3e12, 0.6, 1500.0, 300.0, 1.3
    phi = lambda t: 1.5e-3 * np.sin(2 * np.pi * t) + 0.4e-3 * np.sin(2 * np.pi * 3.3 * t)
    speed = lambda t: 2 * np.pi * (1.5e-3 * np.cos(2 * np.pi * t) + 0.4e-3 * 3.3 * np.cos(2 * np.pi * 3.3 * t))
    k = lambda p: k0 + k1 * abs(p) + k2 * abs(p) ** 3

    def f(t, y):
        v, x = speed(t), y[0]
        return [v - beta * abs(v) * abs(x) ** (n - 1) * x - gamma * v * abs(x) ** n, (1 - w) * k(phi(t)) * x * v]

    times = np.linspace(0, 2, 401)
    y = integrate(f, [0.0, 0.0], times, 1e-3)
    for t, x, work in zip(times, y[0], y[1]):
        p = phi(t)
        print(*(repr(float(v)) for v in (p, w * k(p) * p + (1 - w) * k(p) * x, work - (1 - w) * k(p) * x * x / 2)))


globals()[sys.argv[1]](*sys.argv[2:])
