"""The cost as one finite number, for solvers that know nothing of residuals."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.identification.objective import Objective

FloatArray = NDArray[np.float64]

WORST = 1e30
"""Cost, in units of the start's, of a point at which the simulation is not finite."""


@final
class ScalarCost:
    """Cost of a question relative to its cost at the start; reports every point it sees.

    Attributes:
        best_rms: root mean square of the residuals at the best point so far [m].
        finite: whether any point had a finite simulation.
    """

    def __init__(self, objective: Objective, start: FloatArray) -> None:
        self._objective = objective
        self._best = np.inf
        self.best_rms = float("nan")
        self.finite = False
        self._unit = 1.0
        first = self(start)
        self._unit = first if 0.0 < first < WORST else 1.0
        self._best /= self._unit

    def __call__(self, theta: FloatArray) -> float:
        """Cost at a point within the bounds."""
        objective = self._objective
        with np.errstate(over="ignore", invalid="ignore"):
            residual = objective.residual(theta)
            cost = objective.cost(residual)
        if not np.isfinite(cost):
            return WORST
        self.finite = True
        objective.monitor.saw(theta, cost)
        relative = cost / self._unit
        if relative < self._best:
            self._best, self.best_rms = relative, objective.rms(residual)
        return min(relative, WORST)


NOT_FINITE = "No simulation was finite; give other start values (values={...}) or tighter bounds."
