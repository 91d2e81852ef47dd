"""A plant that is driven one sampling period at a time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, final, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System, assemble
from piezo_opt.choosing import expected
from piezo_opt.control.motion import Steps, advance_function, advance_library, fastest_pole
from piezo_opt.effects import Delay, Model
from piezo_opt.errors import ModelError
from piezo_opt.identification import Fit
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]


@runtime_checkable
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

    The drive goes to its new value within the first :data:`~piezo_opt.control.motion.RISE` of a
    period and is held after it; both stretches are integrated by classical Runge-Kutta steps, as
    many as the model's fastest pole asks for. Compiled code runs where there is a compiler.

    Args:
        plant: a fit, or a model with ``values``.
        values: SI values by full name; those of the fit, or nominal ones, where none are given.
        substeps: steps of the held stretch, and as many of the rise, instead.

    Raises:
        ModelError: the model needs channels, or has a delay (``close_loop`` takes one).
    """

    def __init__(
        self,
        plant: Fit | Model,
        values: Mapping[str, float] | None = None,
        *,
        substeps: int | None = None,
    ) -> None:
        self._system, self._p = system_of(plant, values)
        self._x = np.zeros(len(self._system.state_names))
        self._drive = 0.0
        self._time = 0.0
        self._steps = None if substeps is None else Steps(substeps, substeps)
        self._fastest = fastest_pole(self._system, self._p)
        self._library = advance_library(self._system)

    def begin(self, drive: float) -> float:
        """Rest at a drive [V]; the reading [m]."""
        none, n = np.zeros(0), self._x.size
        start = self._system.start(0.0, drive, none, self._p, np.zeros(n))
        self._x, self._drive, self._time = np.asarray(start, dtype=float).ravel(), drive, 0.0
        y = self._system.reading(0.0, self._x, drive, 0.0, none, none, self._p)
        return float(y)

    def advance(self, drive: float, period: float) -> float:
        """The reading [m] after a drive [V] was held for a period [s]."""
        steps = self._steps or Steps.of(self._fastest, period)
        before, since = self._drive, self._time
        self._drive, self._time = drive, since + period
        if self._library is None:
            move = advance_function(self._system, steps.rise, steps.held)
            moved, y = move(self._x, since, before, drive, period, self._p)
            self._x = np.asarray(moved, dtype=float).ravel()
            return float(y)
        return float(
            self._library.po_run(
                self._p.ctypes.data, since, before, drive, period, steps.rise, steps.held,
                self._x.ctypes.data,
            )
        )  # fmt: skip


def system_of(
    plant: Fit | Model, values: Mapping[str, float] | None = None
) -> tuple[System, FloatArray]:
    """A plant's equations, and its parameters in their order.

    Raises:
        ModelError: the model needs channels, or has a delay.
    """
    expected((Fit, Model), plant, "The plant", "a fit, or a model with values")
    model = plant.model if isinstance(plant, Fit) else plant
    known = plant.values.of_record(0) if isinstance(plant, Fit) else {}
    numbers = Values.nominal(model).with_({**known, **(values or {})})
    system = assemble(model, {})
    if system.channel_names or system.delay is not None:
        raise ModelError(
            "A plant in a loop has neither channels nor a delay of its own: leave that effect "
            "out, and give close_loop(delay=...)."
        )
    return system, numbers.vector(system.parameter_names)


def without_delay(
    plant: Fit | Model, values: Mapping[str, float] | None, period: float
) -> tuple[Model, int]:
    """A plant's model without its delay, and that delay in whole periods, rounded up."""
    model = plant.model if isinstance(plant, Fit) else plant
    known = plant.values.of_record(0) if isinstance(plant, Fit) else {}
    numbers = Values.nominal(model).with_({**known, **(values or {})})
    behind = 0.0
    for name, effect in tuple(model):
        if isinstance(effect, Delay):
            behind += numbers[f"{name}.T"]
            model = model.without(name)
    # What is a whole number of periods but for its last digit is that number.
    return model, int(np.ceil(behind / period - 1e-6))
