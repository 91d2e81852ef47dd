"""A plain actuator that shares nothing with the package, for records of a user's first hour.

    h' = alpha u' - beta |u'| h - gamma u' |h|,   x''/w^2 + 2 zeta x'/w + x = d u - h

The loop is exact on each step of the drive, and the resonator for a strain that is linear between
the points of a fine grid.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import signal

from piezo_opt.measurement import FloatArray

D, ALPHA, BETA, GAMMA = 2e-7, 6e-8, 0.02, 0.004
OMEGA, ZETA = 2 * np.pi * 250, 0.03


def fine(values: FloatArray, parts: int) -> FloatArray:
    """The values with a straight line in ``parts`` pieces between each two."""
    at = np.arange((values.size - 1) * parts + 1) / parts
    return np.interp(at, np.arange(values.size), values)


def loop(
    u: FloatArray, alpha: float = ALPHA, beta: float = BETA, gamma: float = GAMMA
) -> FloatArray:
    """The hysteretic displacement [m] along a drive [V]."""
    out, h = np.zeros(u.size), 0.0
    for index, step in enumerate(np.diff(u).tolist()):
        size, sign = abs(step), (1.0 if step > 0 else -1.0)
        # Counted in the direction of the step, h goes up to alpha / k; k depends on its sign.
        g = sign * h
        if g < 0.0:
            k = beta - gamma
            rest = alpha / k
            to_zero = math.log(1.0 - g / rest) / k
            if size <= to_zero:
                g, size = rest + (g - rest) * math.exp(-k * size), 0.0
            else:
                g, size = 0.0, size - to_zero
        if size > 0.0:
            rest = alpha / (beta + gamma)
            g = rest + (g - rest) * math.exp(-(beta + gamma) * size)
        h = sign * g
        out[index + 1] = h
    return out


def resonator(
    strain: FloatArray, step: float, omega: float = OMEGA, zeta: float = ZETA, kind: str = "foh"
) -> FloatArray:
    """The displacement [m] of a strain that is linear ("foh") or held ("zoh") between points."""
    plant = ([omega**2], [1.0, 2 * zeta * omega, omega**2])
    b, a, _ = signal.cont2discrete(plant, step, method=kind)
    out: FloatArray = strain[0] + signal.lfilter(np.ravel(b), np.ravel(a), strain - strain[0])
    return out


def reading(
    u: FloatArray, step: float, *, parts: int = 5, omega: float = OMEGA, looped: bool = True
) -> FloatArray:
    """The displacement [m] at the samples of a drive that is linear between them."""
    c = fine(u, parts)
    return moved(c, step, parts, omega=omega, looped=looped)


def moved(
    c: FloatArray, step: float, parts: int, *, omega: float = OMEGA, looped: bool = True
) -> FloatArray:
    """The same of a drive on the fine grid, with ``parts`` points a sample."""
    strain = D * c - loop(c) if looped else D * c
    return resonator(strain, step / parts, omega)[::parts]


def forced(
    strain: FloatArray, step: float, *, omega: float, zeta: float, cubic: float, damping: float
) -> FloatArray:
    """A resonator with a spring that hardens and a damping that grows with speed, Runge-Kutta."""
    x, v, out = float(strain[0]), 0.0, np.empty_like(strain)
    out[0] = x

    def pull(e: float, x: float, v: float) -> float:
        return omega**2 * (e - x - cubic * x**3) - 2 * zeta * omega * v - damping * abs(v) * v

    given = strain.tolist()
    for k in range(1, strain.size):
        a, b = given[k - 1], given[k]
        m = (a + b) / 2
        v1 = v
        k1 = pull(a, x, v1)
        v2 = v + step / 2 * k1
        k2 = pull(m, x + step / 2 * v1, v2)
        v3 = v + step / 2 * k2
        k3 = pull(m, x + step / 2 * v2, v3)
        v4 = v + step * k3
        k4 = pull(b, x + step * v3, v4)
        x += step / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
        v += step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        out[k] = x
    return out
