"""Synthetic recovery: seven known parameters from 8000 noisy samples.

Statement. A stack with Bouc-Wen hysteresis behind a resonance of 180 Hz is driven for 0.8 s by a
swept sine on top of a slow one whose amplitude changes from period to period, and read at 10 kHz
from rest, with white noise of 0.2 % of the stroke. Find d, alpha, beta, gamma, omega, zeta and y0.

    x'' + 2 zeta omega x' + omega^2 x = omega^2 (d v - h)
    h' = alpha v' - beta |v'| h - gamma v' |h|
    y = x + y0

Known answer. The parameters that made the record: each must lie in its 99.9 % interval, all of them
together in their 99.9 % ellipsoid, and the residual must be the noise.

Data. Made here, by code that shares nothing with the package: the loop by its closed form on every
straight stretch of the drive, split where h changes its sign; the linear resonance by a Runge-Kutta
scheme of order four at 200 kHz on it. At 400 kHz the reading changes by 3e-11 of its range.

Source: closed form of Bouc-Wen with n = 1, Ikhouane and Rodellar (2007), Systems with Hysteresis,
ch. 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import piezo_opt as po
from piezo_opt.effects import BoucWen, Offset, PiezoGain, SecondOrder

FloatArray = NDArray[np.float64]

RATE, SAMPLES = 1e4, 8000
FINER = 20
"""Runge-Kutta steps a sample."""
NOISE = 0.002
"""Standard deviation of the noise over the stroke."""


def known() -> Mapping[str, float]:
    """The parameters that made the record (SI units)."""
    return {
        "piezo_gain.d": 1.5e-7,
        "bouc_wen.alpha": 5e-8,
        "bouc_wen.beta": 0.03,
        "bouc_wen.gamma": 0.01,
        "second_order.omega": 2.0 * math.pi * 180.0,
        "second_order.zeta": 0.08,
        "offset.y0": 0.7e-6,
    }


def drive() -> FloatArray:
    """Voltage (8000,) at the samples: 0..100 V with minor loops, and a sweep through 180 Hz."""
    t = np.arange(SAMPLES) / RATE
    slow = (30.0 + 12.0 * np.cos(2.0 * np.pi * 2.5 * t)) * (1.0 - np.cos(2.0 * np.pi * 10.0 * t))
    sweep = 8.0 * np.sin(2.0 * np.pi * (20.0 + 200.0 * t) * t)
    return np.asarray(slow + sweep)


def branch(h: float, change: float, alpha: float, beta: float, gamma: float) -> float:
    """h after the drive has moved by ``change`` [V] on a straight line (closed form).

    With s the sign of the change:  dh / d(path) = s alpha - (beta + s gamma sign(h)) h.
    """
    sign, path = math.copysign(1.0, change), abs(change)
    for _ in range(2):  # h changes its sign at most once: towards that of the change
        rate = beta + sign * gamma * (math.copysign(1.0, h) if h else sign)
        target = sign * alpha / rate
        after = target + (h - target) * math.exp(-rate * path)
        if h == 0.0 or after * h >= 0.0:
            return after
        path -= math.log((h - target) / -target) / rate
        h = 0.0
    return h


def exact_reading() -> FloatArray:
    """Reading (8000,) [m] without noise, from rest."""
    d, alpha, beta, gamma, omega, zeta, y0 = known().values()
    # Free displacement at every half step, the drive being straight between samples.
    half_steps = np.arange(2 * FINER * (SAMPLES - 1) + 1) / (2 * FINER)
    fine = np.interp(half_steps, np.arange(SAMPLES), drive())
    loop = [0.0]
    for change in np.diff(fine).tolist():
        loop.append(branch(loop[-1], change, alpha, beta, gamma) if change else loop[-1])
    free = (d * fine - np.array(loop)).tolist()
    step = 1.0 / (RATE * FINER)
    stiffness, damping = omega**2, 2.0 * zeta * omega
    x, w = free[0], 0.0
    readings = [x]
    for j in range(FINER * (SAMPLES - 1)):
        before, middle, after = free[2 * j : 2 * j + 3]
        a1 = stiffness * (before - x) - damping * w
        w2 = w + 0.5 * step * a1
        a2 = stiffness * (middle - x - 0.5 * step * w) - damping * w2
        w3 = w + 0.5 * step * a2
        a3 = stiffness * (middle - x - 0.5 * step * w2) - damping * w3
        w4 = w + step * a3
        a4 = stiffness * (after - x - step * w3) - damping * w4
        x += step / 6.0 * (w + 2.0 * (w2 + w3) + w4)
        w += step / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
        if (j + 1) % FINER == 0:
            readings.append(x)
    return np.array(readings) + y0


@cache
def clean() -> po.Measurement:
    """The record without noise."""
    return po.Measurement(
        time=np.arange(SAMPLES) / RATE, drive=drive(), position=exact_reading(), name="synthetic"
    )


def data(seed: int = 1) -> po.Measurement:
    """The record with the noise of one seed."""
    exact = clean().position
    noise = np.random.default_rng(seed).normal(scale=NOISE * float(np.ptp(exact)), size=SAMPLES)
    return clean().with_(position=exact + noise)


def question(seed: int = 1) -> po.Identification:
    """All seven parameters, started automatically; the actuator is known to be at rest."""
    return po.Identification(
        PiezoGain() + BoucWen() + SecondOrder() + Offset(), data(seed), start=po.Start.REST
    )


def errors(fit: po.Fit) -> Mapping[str, float]:
    """Estimate minus truth over the standard deviation that the fit states."""
    return {name: (fit.values[name] - value) / fit.std[name] for name, value in known().items()}


def distance(fit: po.Fit) -> float:
    """Squared distance from the truth in the metric of the covariance: chi-square of 7 degrees."""
    order = [fit.names.index(name) for name in known()]
    scale = np.sqrt(np.diag(fit.covariance))[order]
    error = np.array(list(errors(fit).values()))
    correlation = fit.covariance[np.ix_(order, order)] / np.outer(scale, scale)
    return float(error @ np.linalg.solve(correlation, error))


def check(fit: po.Fit) -> None:
    """Truth within the intervals and the ellipsoid, residual equal to the noise."""
    assert set(fit.names) == set(known()), fit.names
    for name, error in errors(fit).items():
        assert abs(error) < stats.norm.ppf(0.9995), (
            f"{name}: {fit.values[name]:.6g}, known {known()[name]:.6g}, {error:+.1f} deviations"
        )
        assert fit.std[name] < 0.05 * known()[name], f"{name}: deviation {fit.std[name]:.2g}"
    assert distance(fit) < stats.chi2.ppf(0.999, 7), f"squared distance {distance(fit):.1f}"
    noise = NOISE * float(np.ptp(clean().position))
    # The rms of 8000 normal numbers strays by 1/sqrt(16000) of itself.
    assert abs(fit.rms / noise - 1.0) < 3.3 / math.sqrt(2.0 * SAMPLES) + 7 / SAMPLES, (
        f"rms {fit.rms:.4g} m, noise {noise:.4g} m"
    )


def main() -> None:
    """Solve it, and print the answer beside the truth."""
    fit = po.solve(question())
    print(fit)
    print(f"\n  {'parameter':<20} {'found':>12} {'known':>12} {'deviations':>11}")
    for name, error in errors(fit).items():
        print(f"  {name:<20} {fit.values[name]:>12.6g} {known()[name]:>12.6g} {error:>+11.2f}")
    check(fit)


if __name__ == "__main__":
    main()
