"""What a drive within its limits reaches: the range that a reference may have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np

from piezo_opt.control.closed_loop import Limits
from piezo_opt.control.linearise import linearise
from piezo_opt.control.plant import ModelPlant
from piezo_opt.effects import Model
from piezo_opt.values import Values

_STEPS: Final = 200
"""Of a ramp from one limit to the other."""
_SLOW: Final = 0.2
"""Of a step over the time constant of what moves most: a ramp lasts forty of them."""


@final
@dataclass(frozen=True)
class Reach:
    """Readings of an actuator [m].

    Attributes:
        rest: at rest at the drive nearest to none.
        low, high: the lowest and highest of slow ramps, and of rest at the limits, where there is
            no loop to take from them: a drive that turns often comes closer to that.
        again, top: what slow ramps from limit to limit lead between, again and again.
    """

    rest: float
    low: float
    high: float
    again: float
    top: float


def reach(model: Model, numbers: Values, limits: Limits, period: float) -> Reach:
    """Slow ramps of the model from rest to one limit, to the other, and back.

    A limit that is infinite is left out.

    Args:
        model: without a delay.
        numbers: a value for every parameter of it.
        limits: of the drive.
        period: shortest step of the ramps [s].
    """
    plant = ModelPlant(model, numbers)
    begin = min(max(0.0, limits.low), limits.high)
    rest = plant.begin(begin)
    again, bare = rest, [rest]
    ends = [end for end in (limits.high, limits.low, limits.high) if np.isfinite(end)]
    readings, now = [rest], begin
    step = max(period, _SLOW * _time_constant(model, numbers))
    for end in ends:
        for drive in np.linspace(now, end, _STEPS)[1:]:
            readings.append(plant.advance(float(drive), step))
        now = end
        if end == limits.low:
            again = max(rest, readings[-1])
    top = max(readings)
    bare += [plant.begin(end) for end in ends]
    return Reach(rest, min(readings + bare), max(readings + bare), again, top)


def _time_constant(model: Model, numbers: Values) -> float:
    """Of the slowest of the poles that matter to a step [s]; 0 without any."""
    system = linearise(model, numbers)
    poles, vectors = np.linalg.eig(np.asarray(system.A))
    into = np.linalg.solve(vectors, np.asarray(system.B, dtype=complex)).ravel()
    share = np.abs((np.asarray(system.C, dtype=complex) @ vectors).ravel() * into)
    moving = np.abs(poles) > 0.0
    if not moving.any():
        return 0.0
    share = share[moving] / np.abs(poles[moving])
    return float(1.0 / np.abs(poles[moving])[share >= 0.3 * share.max()].min())
