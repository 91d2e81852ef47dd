"""An effect of one's own: a magnet brakes a part of the travel, and no catalogue knows it.

Statement. A stage behind a stack with Bouc-Wen hysteresis passes a magnet, and eddy currents brake
it where the field is strong. The record is read at 10 kHz for 0.8 s with white noise; the drive is
a slow sine of changing amplitude with a swept one on top, so that the travel is passed at many
speeds. The user knows nothing of the magnet and begins with the default model.

    x'' + 2 zeta omega x' + omega^2 x = omega^2 (d v - h) - c(x) x'
    c(x) = c / (1 + ((x - m) / b)^2)^2
    h' = alpha v' - beta |v'| h - gamma v' |h|
    y = x + y0

Story. The fit stays at nearly three times the noise. The diagnosis says that nothing in the
catalogue explains it. The smallest correction that would enters the motion balance and is x' times
a function of x: a damping that depends on where the stage is. A formula for it follows in one call
and, as an effect, already brings the error near the noise. Drawn against x the damping has one
hump, which is what a magnet does: so the user writes EddyBrake, twenty lines below, starts it where
the hump is, and fits again.

Known answer. The law that made the record: strength, place and breadth of the magnet, each in its
99.9 % interval, and the noise as the error that is left.

Data. Made here, by code that shares nothing with the package: classical Runge-Kutta steps at 100
kHz. At 200 kHz the reading changes by less than a hundredth of the noise.

Source: Wouterse (1991), IEE Proceedings B 138(4), 153-158 (eddy current brake; drag proportional
to speed and to the squared field at low speed).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import piezo_opt as po
from piezo_opt.diagnosis import Diagnosis, Quantity, Unexplained, diagnose
from piezo_opt.diagnosis.evidence import WORTH
from piezo_opt.effects import BoucWen, Effect, Offset, PiezoGain, SecondOrder
from piezo_opt.effects.base import Chain, Equations, Parameter, Place

FloatArray = NDArray[np.float64]

RATE, SAMPLES = 1e4, 8000
FINER = 10
"""Runge-Kutta steps a sample."""
NOISE = 0.002
"""Standard deviation of the noise over the stroke."""


@final
@dataclass(frozen=True)
class EddyBrake(Effect):
    """A magnet beside the travel brakes the stage by eddy currents, per unit mass.

        x'' += -c x' / (1 + ((x - m) / b)^2)^2

    References: Wouterse (1991), IEE Proceedings B 138(4), 153-158.
    """

    place = Place.MOTION
    requires = ("motion",)
    c = Parameter("1/s", "damping at the magnet", 0.0, (0.0, 1e6), (10.0, 1000.0), null=0.0)
    m = Parameter("m", "position of the magnet", 5e-6, (-1e-3, 1e-3), (1e-6, 1e-5))
    b = Parameter("m", "breadth of its field", 1e-6, (1e-8, 1e-3), (5e-7, 5e-6))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:  # noqa: ARG002
        """Own share of the acceleration."""
        field = 1.0 / (1.0 + ((chain.position.value - p.m) / p.b) ** 2)
        return Equations(gives=-p.c * field**2 * chain.position.rate)


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
        "eddy_brake.c": 150.0,
        "eddy_brake.m": 5e-6,
        "eddy_brake.b": 2e-6,
    }


def drive(t: FloatArray) -> FloatArray:
    """Voltage at times t [s]: 0..84 V with minor loops, and a sweep through 180 Hz."""
    slow = (30.0 + 12.0 * np.cos(2.0 * np.pi * 2.5 * t)) * (1.0 - np.cos(2.0 * np.pi * 10.0 * t))
    return np.asarray(slow + 8.0 * np.sin(2.0 * np.pi * (20.0 + 200.0 * t) * t))


@cache
def exact_reading(finer: int = FINER) -> FloatArray:
    """Reading (8000,) [m] without noise, from rest; the drive is straight between the samples."""
    d, alpha, beta, gamma, omega, zeta, y0, c, m, b = known().values()
    at = np.arange(SAMPLES)
    voltage = drive(at / RATE)
    slopes = np.diff(voltage) * RATE
    stiffness, damping = omega**2, 2.0 * zeta * omega
    step = 1.0 / (RATE * finer)

    def rates(v: float, dv: float, x: float, w: float, h: float) -> tuple[float, float, float]:
        brake = c / (1.0 + ((x - m) / b) ** 2) ** 2
        force = stiffness * (d * v - h - x) - (damping + brake) * w
        return w, force, alpha * dv - beta * abs(dv) * h - gamma * dv * abs(h)

    x = w = h = 0.0
    readings = [x]
    for v, dv in zip(voltage.tolist(), slopes.tolist(), strict=False):
        for k in range(finer):
            now, half, then = (v + dv * step * (k + part) for part in (0.0, 0.5, 1.0))
            a = rates(now, dv, x, w, h)
            e = 0.5 * step
            f = rates(half, dv, x + e * a[0], w + e * a[1], h + e * a[2])
            g = rates(half, dv, x + e * f[0], w + e * f[1], h + e * f[2])
            i = rates(then, dv, x + step * g[0], w + step * g[1], h + step * g[2])
            x += step / 6.0 * (a[0] + 2.0 * (f[0] + g[0]) + i[0])
            w += step / 6.0 * (a[1] + 2.0 * (f[1] + g[1]) + i[1])
            h += step / 6.0 * (a[2] + 2.0 * (f[2] + g[2]) + i[2])
        readings.append(x)
    return np.array(readings) + y0


def noise() -> float:
    """Standard deviation of the noise [m]."""
    return NOISE * float(np.ptp(exact_reading()))


@cache
def data(seed: int = 1) -> po.Measurement:
    """The record with the noise of one seed."""
    time = np.arange(SAMPLES) / RATE
    read = exact_reading() + np.random.default_rng(seed).normal(scale=noise(), size=SAMPLES)
    return po.Measurement(time=time, drive=drive(time), position=read, name="braked stage")


def question() -> po.Identification:
    """The default model of a moving stage, known to begin at rest."""
    model = PiezoGain() + BoucWen() + SecondOrder() + Offset()
    return po.Identification(model, data(), start=po.Start.REST)


def hump(left: Unexplained) -> tuple[float, float, float]:
    """Height [1/s], place [m] and breadth [m] of the damping that the correction asks for.

    In slices of the travel the correction w = -c(x) x' + ... gives c by least squares; the fitted
    constant damping has taken the mean of c, so that the hump is measured from its foot. As the
    correction is the smallest one, the hump is too low and too flat: good enough for a start.
    """
    force = left.forces[0]
    w, x, rate = (
        part[0]
        for part in (
            force.correction, force.signals[Quantity.POSITION], force.signals[Quantity.VELOCITY],
        )
    )  # fmt: skip
    edges = np.linspace(float(np.quantile(x, 0.01)), float(np.quantile(x, 0.99)), 25)
    slices = [(x >= low) & (x < high) for low, high in pairwise(edges)]
    damping = np.array([-float(w[s] @ rate[s]) / float(rate[s] @ rate[s]) for s in slices])
    centre = 0.5 * (edges[:-1] + edges[1:])
    height = damping - np.quantile(damping, 0.1)
    above = height > 0.25 * height.max()  # the law is at a quarter where |x - m| = b
    place = float(np.average(centre[above], weights=height[above]))
    return float(height.max()), place, float(0.5 * above.sum() * np.diff(edges)[0])


def with_own_effect(fit: po.Fit, left: Unexplained) -> po.Fit:
    """The fit with EddyBrake, started where the correction has its hump."""
    height, place, breadth = hump(left)
    start = {"eddy_brake.c": height, "eddy_brake.m": place, "eddy_brake.b": breadth}
    return po.solve(fit.question.with_model(fit.model + EddyBrake()), start={**fit.values, **start})


def with_formula(fit: po.Fit, left: Unexplained) -> po.Fit:
    """The fit with the proposed formula as an effect."""
    assert left.formula is not None
    proposed = left.formula.as_effect("position_damping")
    return po.solve(fit.question.with_model(fit.model + proposed), start=fit.values)


def errors(fit: po.Fit) -> Mapping[str, float]:
    """Estimate minus truth over the standard deviation that the fit states."""
    return {name: (fit.values[name] - value) / fit.std[name] for name, value in known().items()}


def check(fit: po.Fit) -> None:
    """The magnet and everything else within the intervals, the residual equal to the noise."""
    assert set(fit.names) == set(known()), fit.names
    for name, error in errors(fit).items():
        assert abs(error) < stats.norm.ppf(0.9995), f"{name}: {error:+.1f} deviations"
    # The rms of 8000 normal numbers strays by 1/sqrt(16000) of itself.
    assert abs(fit.rms / noise() - 1.0) < 3.3 / math.sqrt(2.0 * SAMPLES) + 10 / SAMPLES, fit.rms


def check_way(base: po.Fit, diagnosis: Diagnosis, formula: po.Fit) -> None:
    """Every turn on the way there: unexplained, the place, of what, and the formula's worth."""
    assert base.rms > 2.5 * noise(), f"the default model leaves {base.rms:.3g} m"
    assert diagnosis.verdict == "unexplained", diagnosis.verdict
    left = diagnosis.unexplained
    assert left is not None
    assert left.place is Place.MOTION, left.place
    assert left.against == "x, times x'", left.against
    assert left.share > 0.95, left.share
    assert left.forces[0].rms_after < 1.02 * noise(), left.forces[0]
    # A further term would have to be worth a name.
    assert formula.rms < math.hypot(1.0, WORTH) * noise(), f"the formula leaves {formula.rms:.3g} m"


def main() -> None:
    """Tell the story, and print the answer beside the truth."""
    base = po.solve(question())
    diagnosis = diagnose(base, effort=po.Effort.QUICK, max_time=300.0)
    print(diagnosis)
    left = diagnosis.unexplained
    assert left is not None
    for force in left.forces:
        print(f"  {force}")
    formula, own = with_formula(base, left), with_own_effect(base, left)
    print(f"\n{own}")
    print(f"\n  {'error over noise':<24}")
    for label, fit in (("default model", base), ("+ formula", formula), ("+ EddyBrake", own)):
        print(f"  {label:<24} {fit.rms / noise():>8.3f}")
    print(f"\n  {'parameter':<20} {'found':>12} {'known':>12} {'deviations':>11}")
    for name, error in errors(own).items():
        print(f"  {name:<20} {own.values[name]:>12.6g} {known()[name]:>12.6g} {error:>+11.2f}")
    check_way(base, diagnosis, formula)
    check(own)


if __name__ == "__main__":
    main()
