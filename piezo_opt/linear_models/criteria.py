"""How a linear system answers a step: overshoot, settling time and the like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.linear_models.judging import state_space
from piezo_opt.linear_models.stepping import exponential
from piezo_opt.measurement import FloatArray

if TYPE_CHECKING:
    import control

_BAND: Final = 0.02
"""Share of the final value within which a response has settled: the usual 2 %."""
_GRID: Final = 8000
"""Instants at which the response is looked at before each is refined."""
_DECAYS: Final = 12.0
"""Time constants of the slowest pole that are looked at: e^-12 is 6e-6."""
_TURN: Final = 24
"""Instants for one turn of the fastest oscillating pole."""


@final
@dataclass(frozen=True)
class StepCriteria:
    """Criteria of a unit step from rest.

    Attributes:
        final: value at rest [position_unit / drive_unit].
        overshoot: (peak - final) / final; 0 where there is none.
        peak: the value farthest from zero on the final value's side.
        peak_time: [s] when it is first reached.
        rise_time: [s] from 10 % to 90 % of the final value.
        settling_time: [s] after which the response stays within 2 % of the final value.
    """

    final: float
    overshoot: float
    peak: float
    peak_time: float
    rise_time: float
    settling_time: float


def step_criteria(system: control.StateSpace | control.TransferFunction) -> StepCriteria:
    """Time-response criteria of a stable system, refined beyond any grid.

    Raises:
        InputError: unstable, a pole at 0, or no final value to compare with.

    Source: Ogata (2010), Modern Control Engineering, 5th ed., sec. 5-3.
    """
    from scipy import optimize

    a, b, c, d = state_space(system)
    poles = np.linalg.eigvals(a)
    if poles.size and float(poles.real.max()) >= 0.0:
        raise InputError("an unstable system has no step criteria: fit it with stable=True")
    rest = np.asarray(-np.linalg.solve(a, b), dtype=np.float64) if poles.size else np.zeros(0)
    last = float(c @ rest + d)
    if last == 0.0:
        raise InputError("the response ends at 0, so overshoot and settling mean nothing")
    if not poles.size:
        return StepCriteria(last, 0.0, last, 0.0, 0.0, 0.0)

    def response(t: float) -> float:
        """Share of the final value: 1 - C exp(A t) x_rest / final."""
        return 1.0 - float(c @ exponential(a * t) @ rest) / last

    length = _DECAYS / float(-poles.real.max())
    turns = length * float(np.abs(poles.imag).max()) / (2.0 * np.pi)
    grid = np.asarray(np.linspace(0.0, length, max(_GRID, int(_TURN * turns))))
    values = _along(a, c, rest, last, grid)
    top = int(np.argmax(values))
    peak, when = float(values[top]), float(grid[top])
    if 0 < top < grid.size - 1:
        found = optimize.minimize_scalar(
            lambda t: -response(t), bounds=(grid[top - 1], grid[top + 1]), method="bounded",
            options={"xatol": 1e-10 * length},
        )  # fmt: skip
        when, peak = float(found.x), float(-found.fun)
    outside = np.flatnonzero(np.abs(values - 1.0) > _BAND)
    settling = 0.0
    if outside.size:
        k = int(outside[-1])
        edge = 1.0 + _BAND * float(np.sign(values[k] - 1.0))
        settling = _crossing(lambda t: response(t) - edge, grid, k)
    rise = _first(response, grid, values, 0.9) - _first(response, grid, values, 0.1)
    over = max(peak - 1.0, 0.0)
    if over < 1e-5:
        over, peak, when = 0.0, 1.0, float("inf")
    return StepCriteria(last, over, peak * last, when, rise, settling)


def _along(
    a: FloatArray, c: FloatArray, rest: FloatArray, last: float, grid: FloatArray
) -> FloatArray:
    """The response on an even grid."""
    move = exponential(a * grid[1])
    state, values = rest.copy(), np.empty(grid.size)
    for k in range(grid.size):
        values[k] = 1.0 - float(c @ state) / last
        state = move @ state
    return values


def _first(
    response: Callable[[float], float], grid: FloatArray, values: FloatArray, level: float
) -> float:
    above = np.flatnonzero(values >= level)
    if above.size == 0 or above[0] == 0:
        return 0.0
    return _crossing(lambda t: response(t) - level, grid, int(above[0]) - 1)


def _crossing(function: Callable[[float], float], grid: FloatArray, k: int) -> float:
    """The root between grid points k and k + 1."""
    from scipy import optimize

    if k + 1 >= grid.size or function(grid[k]) * function(grid[k + 1]) > 0.0:
        return float(grid[k])
    return float(optimize.brentq(function, grid[k], grid[k + 1], xtol=1e-12 * float(grid[-1])))
