"""An effect hidden in a record: compare, see, learn, add, watch.

Statement. A stack is driven by a staircase and by triangles with minor loops for 40 s and read at
100 Hz with white noise of 0.1 % of its stroke. Beside Bouc-Wen hysteresis it creeps, which the user
does not know: they fit the default model to the first 28 s, look where it fails on the rest, ask
which effect is missing, add it, and watch the error fall.

    s = d v - h,   h' = alpha v' - beta |v'| h - gamma v' |h|
    y(t) = s(t) + g integral s'(u) lg(1 + (t - u) / t0) du + y0

Known answer. Creep, in a form that the catalogue does not have: every change of the free
displacement goes on as the logarithm of time, a share g of it a decade, for ever. The catalogue's
creep is a chain of three exponentials. Still it must be named first and alone, at the fit and by
the ladder, and with it the error on data that neither fit has seen must fall to the noise.

Data. Made here: the loop by its closed form on every straight stretch of the drive, the creep as a
sum over all changes of the free displacement before each instant. Nothing is shared with the
package.

Source: logarithmic creep: Jung and Gweon (2000), Rev. Sci. Instrum. 71(4), 1896-1900; closed form
of Bouc-Wen: Ikhouane and Rodellar (2007), Systems with Hysteresis, ch. 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

import piezo_opt as po

FloatArray = NDArray[np.float64]

RATE, SAMPLES = 100.0, 4000
NOISE: Final = 0.001
"""Standard deviation of the noise over the stroke."""
SPLIT: Final = "28 s"
TRUTH: Final = {"d": 1.5e-7, "alpha": 4e-8, "beta": 0.03, "gamma": 0.008, "y0": 0.4e-6}
SHARE, BEGIN = 0.015, 0.1
"""Creep: share of the displacement a decade, and where its logarithm begins [s]."""


def drive() -> FloatArray:
    """Voltage (4000,): steps between ramps of 0.2 s, then triangles of falling amplitude."""
    holds = [0.0, 80.0, 40.0, 100.0, 20.0, 60.0, 0.0, 90.0]
    corners: list[tuple[float, float]] = []
    t = 0.0
    for turn in range(2):
        for level in holds if turn == 0 else holds[::-1]:
            corners += [(t, level), (t + 1.3, level)]
            t += 1.5
        for swing in (100.0, 0.0, 85.0, 15.0, 70.0, 30.0, 60.0, 0.0):
            corners.append((t + 0.8, swing))
            t += 1.0
    at, level = np.array(corners).T
    return np.asarray(np.interp(np.arange(SAMPLES) / RATE, at, level))


def exact_reading() -> FloatArray:
    """Reading (4000,) [m] without noise, from rest."""
    v = drive()
    h = [0.0]
    for change in np.diff(v).tolist():
        h.append(_branch(h[-1], change))
    s = TRUTH["d"] * v - np.array(h)
    t = np.arange(SAMPLES) / RATE
    # Every change takes place, on average, in the middle of its sample.
    since = t[:, None] - (t[None, 1:] - 0.5 / RATE)
    response = np.log10(1.0 + np.maximum(since, 0.0) / BEGIN)
    return np.asarray(s + SHARE * (response @ np.diff(s)) + TRUTH["y0"])


def _branch(h: float, change: float) -> float:
    """h after the drive has moved by ``change`` [V] on a straight line (closed form)."""
    if change == 0.0:
        return h
    alpha, beta, gamma = TRUTH["alpha"], TRUTH["beta"], TRUTH["gamma"]
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


@cache
def data() -> po.Measurement:
    """The record with noise."""
    exact = exact_reading()
    noise = np.random.default_rng(7).normal(scale=noise_rms(), size=SAMPLES)
    time = np.arange(SAMPLES) / RATE
    return po.Measurement(time=time, drive=drive(), position=exact + noise, name="stack")


@cache
def noise_rms() -> float:
    """Standard deviation of the noise [m]."""
    return NOISE * float(np.ptp(exact_reading()))


def question() -> po.Identification:
    """The default model on the first 28 s."""
    train, _ = data().split(SPLIT)
    model, _ = po.default_model(train)
    return po.Identification(model, train)


def known() -> Mapping[str, float]:
    """Held-out error over the true noise without and with creep."""
    return {"without creep": 2.89, "with creep": 1.0}


def tolerance() -> Mapping[str, float]:
    """How far the found numbers may be from the known ones."""
    return {"without creep": 0.05, "with creep": 0.05}


def add_what_is_missing(fit: po.Fit) -> po.Fit:
    """Learn which effect is likeliest, add it, and fit again from where the fit was."""
    suspects = po.diagnose(fit, ladder=False)
    richer = fit.model + suspects.best()
    return po.solve(fit.question.with_model(richer), start=fit)


def found(*fits: po.Fit) -> Mapping[str, float]:
    """The numbers of `known`, of the fits without and with the missing effect."""
    _, test = data().split(SPLIT)
    errors = [entry.metrics.rms for entry in po.compare(*fits, on=test).entries]
    return dict(zip(known(), (rms / noise_rms() for rms in errors), strict=True))


def check(fit: po.Fit) -> None:
    """Creep is likeliest at once, the ladder agrees and stops there, and the error falls."""
    richer = add_what_is_missing(fit)
    assert "creep" in richer.model, richer.model.names
    have = found(fit, richer)
    for name, value in known().items():
        assert abs(have[name] - value) <= tolerance()[name], (
            f"{name}: {have[name]:.4g}, known {value:.4g}"
        )
    _, test = data().split(SPLIT)
    diagnosis = po.diagnose(fit, test=test, advise=False)
    assert [step.name for step in diagnosis.steps] == ["creep"], diagnosis.steps
    assert diagnosis.steps[0].group == ("creep",), diagnosis.steps[0].group
    assert diagnosis.verdict == "missing", diagnosis.verdict
    assert diagnosis.final.rms < 1.05 * noise_rms()
    assert 0.9 < diagnosis.noise.rms / noise_rms() < 1.1


def main() -> None:
    """Compare, see, learn, add, watch."""
    _, test = data().split(SPLIT)
    fit = po.solve(question())
    print(fit.outcome.sentence)
    print(f"\nSee. {po.compare(fit, on=test)}")
    print(f"\nLearn. {po.diagnose(fit, ladder=False)}")
    richer = add_what_is_missing(fit)
    print(f"\nWatch. {po.compare(fit, richer, on=test)}")
    print(f"\nAll at once. {po.diagnose(fit, test=test, advise=False)}")
    print(f"\n  {'held-out rms over noise':<24} {'found':>8} {'known':>8}")
    for name, value in found(fit, richer).items():
        print(f"  {name:<24} {value:>8.3f} {known()[name]:>8.3f}")
    check(fit)


if __name__ == "__main__":
    main()
