"""Small records whose truth is known: simulated with a scheme far finer than any noise here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

import piezo_opt as po
from piezo_opt.effects import BoucWen, Model, Offset, PiezoGain, SecondOrder
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.unknowns import theta_of, unknowns
from piezo_opt.measurement import FloatArray

LINE: Final = PiezoGain() + Offset()
STILL: Final = PiezoGain() + BoucWen() + Offset()
MOVING: Final = PiezoGain() + BoucWen() + SecondOrder() + Offset()
TRUTH: Final = {
    "piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 4e-8, "bouc_wen.beta": 0.05,
    "bouc_wen.gamma": 0.01, "offset.y0": 2e-7,
}  # fmt: skip


def loops(samples: int = 300, rate: float = 100.0) -> tuple[FloatArray, FloatArray]:
    """Time and drive: triangles of several heights between -10 V and 60 V, from 0 V."""
    time = np.arange(samples) / rate
    corners = np.array([0, 60, -10, 40, 5, 60, 20, 50, 0], dtype=float)
    at = np.linspace(0.0, time[-1], corners.size)
    return time, np.interp(time, at, corners)


def record(
    model: Model,
    values: Mapping[str, float],
    time: FloatArray,
    drive: FloatArray,
    *,
    noise: float | FloatArray = 0.0,
    seed: int = 0,
    **more: Any,
) -> po.Measurement:
    """What a sensor with white noise [m] (or this noise) reads of the model at these values."""
    bare = po.Measurement(time, drive, np.linspace(0.0, 1e-6, time.size), **more)
    initial = po.Initial.REST if bare.period is None else po.Initial.PERIODIC
    reading = po.simulate(model, bare, values, initial=initial, tolerance=1e-8).reading
    white = np.random.default_rng(seed).normal(size=time.size)
    return bare.with_(position=reading + noise * (white if np.isscalar(noise) else 1.0))


def objective_of(
    question: po.Identification, start: Mapping[str, float]
) -> tuple[Objective, FloatArray]:
    """The residuals of a question as a solver sees them, and the start as a vector."""
    numbers = po.Values({**po.Values.nominal(question.model), **start})
    unknown = unknowns(question, numbers)
    theta = theta_of(unknown, numbers)
    return Objective(question, unknown, theta, Monitor(unknown.names)), theta
