"""Small plants whose truth is known: what the diagnosis' tests measure on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

import piezo_opt as po
from piezo_opt.diagnosis.book import Book
from piezo_opt.effects import BoucWen, Effect, Model, Offset, PiezoGain, SecondOrder
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.measurement import FloatArray

NOISE: Final = 5e-9
STILL: Final = PiezoGain() + BoucWen() + Offset()
MOVING: Final = PiezoGain() + BoucWen() + SecondOrder() + Offset()
TRUTH: Final = {
    "piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 0.03,
    "bouc_wen.gamma": 5e-3, "offset.y0": 1e-7,
    "second_order.omega": 2.0 * np.pi * 60.0, "second_order.zeta": 0.1,
}  # fmt: skip

LAWS: Final = {name for name, kind in CATALOGUE.items() if kind().is_hysteresis_law}


def but(*kept: str) -> tuple[str, ...]:
    """All effects but these and the rival laws: to be withheld where the way counts and not who
    may go it, for models that nobody has compiled yet take their time."""
    return tuple(name for name in CATALOGUE if name not in {*kept, *LAWS})


def triangle(time: FloatArray, frequency: float) -> FloatArray:
    """0..60 V, from 0."""
    return np.asarray(60.0 * np.abs((2.0 * frequency * time + 1.0) % 2.0 - 1.0))


def rich(time: FloatArray) -> FloatArray:
    """Triangles of two heights, steps and holds, 0..60 V over the record."""
    span = float(time[-1])
    corners = np.array([0.0, 0.1, 0.2, 0.25, 0.3, 0.35, 0.4, 0.401, 0.6, 0.601, 0.8, 0.9, 1.0])
    levels = np.array([0.0, 60, 10, 30, 5, 45, 0, 60, 60, 20, 20, 50, 0.0])
    return np.asarray(np.interp(time, corners * span, levels))


def sine(time: FloatArray, frequency: float = 5.0) -> FloatArray:
    """0..60 V, from 0."""
    return np.asarray(30.0 - 30.0 * np.cos(2.0 * np.pi * frequency * time))


def clock(samples: int = 2000, rate: float = 1000.0) -> FloatArray:
    """Even instants from 0."""
    return np.arange(samples) / rate


def measured(
    base: Model,
    time: FloatArray,
    drive: FloatArray,
    *hidden: tuple[Effect, Mapping[str, float]],
    noise: float | FloatArray = NOISE,
    seed: int = 0,
    name: str = "record",
) -> po.Measurement:
    """A record of the base at TRUTH and hidden effects at given own values, with white noise.

    Args:
        noise: root mean square [m] of white noise, or the noise itself (N,).
    """
    model, values = base, {n: v for n, v in TRUTH.items() if n in base.parameters}
    for effect, own in hidden:
        model = model + effect
        values |= {f"{model.names[-1]}.{k}": v for k, v in own.items()}
    blank = po.Measurement(time, drive, drive, allow_saturated=True)
    reading = po.simulate(model, blank, values).reading
    white = np.random.default_rng(seed).normal(size=time.size)
    extra = noise * white if np.isscalar(noise) else noise
    return po.Measurement(time, drive, reading + extra, name=name, allow_saturated=True)


def fitted(base: Model, record: po.Measurement) -> po.Fit:
    """The base fitted from the truth on: no search for a start."""
    start = {n: v for n, v in TRUTH.items() if n in base.parameters}
    return po.solve(po.Identification(base, record), start=start)


def minor_loops(law: Effect, own: Mapping[str, float], noise: float) -> po.Measurement:
    """A gain with this hysteresis law on a triangle that shrinks and grows, 12 s, 0..60 V.

    Args:
        law: the truth.
        own: its own values.
        noise: root mean square of white noise [m].
    """
    time = clock(1200, 100.0)
    corners = np.array([0.0, 60, 10, 50, 20, 45, 0, 30, 5, 55, 15, 40, 0])
    drive = np.interp(time, np.linspace(0.0, 12.0, corners.size), corners)
    blank = po.Measurement(time, drive, 1e-7 * drive)
    values = {f"{law.name}.{k}": v for k, v in own.items()}
    reading = po.simulate(PiezoGain() + law + Offset(), blank, values).reading
    white = np.random.default_rng(2).normal(size=time.size)
    return blank.with_(position=reading + noise * white)


def opened(*hidden: tuple[Effect, Mapping[str, float]], choices: int = 1) -> Book:
    """The book of a search at the fit of ``STILL`` to a short record with something hidden."""
    time = clock(600)
    fit = po.solve(po.Identification(STILL, measured(STILL, time, rich(time), *hidden)))
    return Book(fit, choices, 1)
