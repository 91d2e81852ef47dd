"""A fit of a few steps, where models are chosen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.effects.model import Model
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.starting import starting_values
from piezo_opt.identification.tall import inner
from piezo_opt.identification.unknowns import theta_of, unknowns
from piezo_opt.measurement import Measurement

FloatArray = NDArray[np.float64]

ENOUGH = 20_000
"""Samples of a long record that are enough to choose a model by."""


@final
@dataclass(frozen=True, eq=False)
class Quick:
    """What a few steps have led to.

    Attributes:
        residual: modelled minus measured on the counted samples [m].
        values: the unknowns.
    """

    residual: FloatArray
    values: Mapping[str, float]

    @property
    def squares(self) -> float:
        """Sum of squares of the residual [m^2]."""
        return inner(self.residual, self.residual)


def quick(model: Model, record: Measurement, start: Mapping[str, float] | None = None) -> Quick:
    """Fit a model to a record by a few steps.

    Args:
        model: the model.
        record: the record.
        start: where it begins; what it lacks, or all, is found from the record.

    Raises:
        ArithmeticError: it is not finite.
        ModelError, InputError: the model cannot be fitted to the record.
    """
    question = Identification(model, record)
    asked = question if start is None else question.starting_at(start)
    begin = starting_values(asked, Monitor(()))
    unknown = unknowns(asked, begin)
    theta = theta_of(unknown, {**begin, **asked.given()})
    objective = Objective(asked, unknown, theta, Monitor(unknown.names))
    solution = LevenbergMarquardt(iterations=40, tolerance=1e-5).minimise(objective, theta)
    residual = objective.residual(solution.theta)
    if not np.isfinite(residual).all():
        raise ArithmeticError("no finite fit")
    return Quick(residual, dict(unknown.values(solution.theta)))
