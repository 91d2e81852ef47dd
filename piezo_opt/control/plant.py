"""A plant that is driven one sampling period at a time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import assemble
from piezo_opt.effects import Model
from piezo_opt.errors import ModelError
from piezo_opt.identification import Fit
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

RISE = 0.02
"""Share of a period in which the held drive goes to its next value. A hysteresis law moves with the
drive's rate, which a jump does not have; a loop without rate dependence ends at the same place
whatever the share."""


class Plant(Protocol):
    """What a loop is closed around. A class of your own needs these two methods."""

    def begin(self, drive: float) -> float:
        """Come to rest at a drive [V]; the reading there [m]."""
        ...

    def advance(self, drive: float, period: float) -> float:
        """Hold a drive [V] for a period [s]; the reading at its end [m]."""
        ...


@final
class ModelPlant:
    """A fitted or composed model as a plant; it keeps its state.

    The drive goes to its new value within the first :data:`RISE` of a period and is held after it;
    both stretches are integrated by classical Runge-Kutta steps.

    Args:
        plant: a fit, or a model with ``values``.
        values: SI values by full name; those of the fit, or nominal ones, where none are given.
        substeps: steps of the held stretch, and as many of the rise.

    Raises:
        ModelError: the model needs channels, or has a delay (``close_loop`` takes one).
    """

    def __init__(
        self, plant: Fit | Model, values: Mapping[str, float] | None = None, *, substeps: int = 8
    ) -> None:
        model = plant.model if isinstance(plant, Fit) else plant
        known = plant.values.of_record(0) if isinstance(plant, Fit) else {}
        numbers = Values.nominal(model).with_({**known, **(values or {})})
        system = assemble(model, {})
        if system.channel_names or system.delay is not None:
            raise ModelError(
                "A plant in a loop has neither channels nor a delay of its own: leave that effect "
                "out, and give close_loop(delay=...)."
            )
        self._p = numbers.vector(system.parameter_names)
        self._system = system
        self._step = _stepping(system.rate, system.becomes, substeps, self._p)
        self._x = np.zeros(len(system.state_names))
        self._drive = 0.0
        self._time = 0.0

    def begin(self, drive: float) -> float:
        """Rest at a drive [V]; the reading [m]."""
        none, n = np.zeros(0), self._x.size
        start = self._system.start(0.0, drive, none, self._p, np.zeros(n))
        self._x, self._drive, self._time = np.asarray(start, dtype=float).ravel(), drive, 0.0
        return self._reading(0.0)

    def advance(self, drive: float, period: float) -> float:
        """The reading [m] after a drive [V] was held for a period [s]."""
        x = self._step(self._x, self._time, self._drive, drive, period)
        self._x = np.asarray(x, dtype=float).ravel()
        self._time += period
        self._drive = drive
        return self._reading(0.0)

    def _reading(self, rate: float) -> float:
        none = np.zeros(0)
        y = self._system.reading(self._time, self._x, self._drive, rate, none, none, self._p)
        return float(y)


def _stepping(
    rate: ca.Function, becomes: ca.Function | None, substeps: int, p: FloatArray
) -> ca.Function:
    """(x, t, u before, u, T) -> x after one period T."""
    n = rate.size1_in(1)
    x, t, before, after, period = (
        ca.SX.sym("x", n), *(ca.SX.sym(name) for name in ("t", "before", "after", "period"))
    )  # fmt: skip
    none = ca.SX(0, 1)
    rise = RISE * period
    now, clock = x, t

    for length, slope in ((rise, (after - before) / rise), (period - rise, ca.SX(0.0))):
        h = length / substeps
        base = before if length is rise else after

        def moves(
            state: ca.SX, since: ca.SX, begun: ca.SX = clock, u0: ca.SX = base, du: ca.SX = slope
        ) -> ca.SX:
            return rate(begun + since, state, u0 + du * since, du, none, none, p)

        for k in range(substeps):
            s = k * h
            k1 = moves(now, s)
            k2 = moves(now + h / 2.0 * k1, s + h / 2.0)
            k3 = moves(now + h / 2.0 * k2, s + h / 2.0)
            k4 = moves(now + h * k3, s + h)
            now = now + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        clock = clock + length
        if becomes is not None:
            now = becomes(clock, now, after, none, p)
    return ca.Function("period", [x, t, before, after, period], [now])
