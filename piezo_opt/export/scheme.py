"""How an interval between two calls is cut, and what error that leaves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError, ModelError
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Accuracy, Simulator, Substeps
from piezo_opt.units import show

TOLERANCE: Final = 1e-6
"""Error of the scheme as a share of the reading's range: hundredfold below what a record shows."""
_MOST: Final = 200
"""Sub-steps in one interval at most: beyond, the interval is too long for what the model does."""
_ROUGH: Final = 1e-3
"""Error of sub-steps that are asked for, as a share of the reading's range, above which the code
would not be the model any more."""


def cut(
    model: Model,
    values: Mapping[str, float],
    record: Measurement,
    step: float,
    substeps: int | None,
) -> Accuracy:
    """Sub-steps for calls every ``step`` seconds, chosen by halving on a record, or as given.

    Args:
        model: what is exported, values: of its parameters.
        record: on which the error is measured.
        step: time between two calls [s].
        substeps: of each interval; chosen unless given.

    Raises:
        InputError: the interval is too long for the model, or the sub-steps are too few.
    """
    if substeps is None:
        try:
            chosen = Simulator(model, record, values, tolerance=TOLERANCE).accuracy
        except ModelError as refused:
            raise InputError(f"step = {show(step, 's')}: {refused}") from refused
        if step > _MOST * chosen.substeps.longest:
            most = _MOST * chosen.substeps.longest
            raise InputError(
                f"step = {show(step, 's')}: the model moves so fast that it takes "
                f"{step / chosen.substeps.longest:.0f} sub-steps between two calls: call it at "
                f"least every {show(most, 's')}, or leave out its mechanics or shortest lag."
            )
        return chosen
    if substeps < 1:
        raise InputError(f"substeps = {substeps}: give a whole number from 1 on")
    given = Substeps(step / substeps, np.inf)
    simulator = Simulator(model, record, values, substeps=given)
    with np.errstate(all="ignore"):
        reading = simulator.reading(values)
        error = simulator.halving(values, reading) * 16.0 / 15.0
    stroke = float(np.ptp(reading))
    if not error <= _ROUGH * stroke:
        said = f"err by {show(error, 'm')}" if np.isfinite(error) else "run away"
        raise InputError(
            f"substeps = {substeps}: the model would {said} at one call every {show(step, 's')}: "
            "take more sub-steps, or leave the choice to the export."
        )
    return Accuracy(given, error, float(substeps))
