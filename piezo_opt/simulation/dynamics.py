"""How a model moves at one instant: its linear blocks, the slopes of the rest, its clock.

Asked of the composed model where there is one; else of the model's whole expressions.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.simulation.composed import Program
from piezo_opt.simulation.composed import program as composed
from piezo_opt.simulation.exponential import linear_part, longest

FloatArray = NDArray[np.float64]


class Dynamics(Protocol):
    """What the choice of sub-steps asks of a model."""

    @property
    def blocks(self) -> int:
        """Number of linear blocks."""

    def longest(self, parameters: FloatArray) -> float:
        """The longest sub-step [s] over which the blocks are as good as exact."""

    def slopes(self, instants: FloatArray, parameters: FloatArray) -> FloatArray:
        """Derivatives (m, n, n) [1/s] of the rates less their linear blocks by the states.

        Args:
            instants: (m, 3 + 2c + n) time, drive, its slope, channels, their slopes, states.
            parameters: of the model.
        """

    def at_rest(
        self, time: float, drive: float, channels: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """States (n,) at rest."""


def dynamics(system: System, exact: bool, prefer_compiled: bool = True) -> Dynamics:
    """How a system moves.

    Args:
        system: a model.
        exact: whether linear blocks are taken out.
        prefer_compiled: False asks the whole expressions even where compiled functions exist.
    """
    made = composed(system, exact) if prefer_compiled else None
    return _whole(system, exact) if made is None else made


@lru_cache(maxsize=2048)
def _whole(system: System, exact: bool) -> Whole:
    return Whole(system, exact)


@final
class Whole:
    """The same of a model's whole expressions."""

    def __init__(self, system: System, exact: bool) -> None:
        self._system = system
        self._part = linear_part(system, exact)

    @property
    def blocks(self) -> int:
        """Number of linear blocks."""
        return len(self._part.blocks)

    def longest(self, parameters: FloatArray) -> float:
        """The longest sub-step [s] over which the blocks are as good as exact."""
        return longest(self._part, parameters)

    def slopes(self, instants: FloatArray, parameters: FloatArray) -> FloatArray:
        """Derivatives (m, n, n) [1/s] of the rates less their linear blocks by the states."""
        n, c = len(self._system.state_names), len(self._system.channel_names)
        found = np.zeros((instants.shape[0], n, n))
        # Wrapping the arguments of a call takes CasADi far longer than these few numbers.
        bound: Any = self._part.slopes.buffer()
        buffer, evaluate = bound
        p = np.array(parameters, dtype=float)
        for row, a in zip(instants, found, strict=True):
            t, u, du, channels, channel_slopes, x = np.split(row, np.cumsum([1, 1, 1, c, c]))
            held = [np.array(one) for one in (t, x, u, du, channels, channel_slopes, p)]
            for index, array in enumerate(held):
                buffer.set_arg(index, array.data)
            buffer.set_res(0, a.data)
            evaluate()
        return np.asarray(found.transpose(0, 2, 1))  # the engine writes columns

    def at_rest(
        self, time: float, drive: float, channels: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """States (n,) at rest."""
        unmoved = np.zeros(len(self._system.state_names))
        started = self._system.start.call([time, drive, channels, parameters, unmoved])
        return np.asarray(started[0].full()).ravel()


def delay_of(system: System, prefer_compiled: bool = True) -> Callable[[FloatArray], float] | None:
    """How much the chain lags the command [s] at given parameters; None without a delay.

    Raises:
        ModelError: the effects do not make a model.
    """
    made: Program | None = composed(system, False) if prefer_compiled else None
    if made is not None:
        return made.delay
    if system.delay is None:
        return None
    function = system.delay
    return lambda parameters: float(function(parameters))
