"""The simplex search of Nelder and Mead: a baseline without derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.solvers.scalar import NOT_FINITE, ScalarCost

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True)
class NelderMead:
    """Simplex search on the cost alone, within bounds: what many theses used.

    A point outside the bounds is moved to the nearest one inside.

    Args:
        iterations: most moves of the simplex, over all restarts.
        tolerance: relative spread of cost and unknowns over the simplex at convergence.
        first_step: edge of the first simplex, as a share of each unknown's size.
        restarts: times a fresh simplex is put around the point found, because a simplex can
            collapse short of a minimum.
        adaptive: coefficients that depend on the number of unknowns.

    References: Nelder & Mead (1965), Comput. J. 7(4), 308-313; Gao & Han (2012), Comput. Optim.
    Appl. 51, 259-277 (adaptive coefficients).
    """

    iterations: int = 5000
    tolerance: float = 1e-8
    first_step: float = 0.1
    restarts: int = 1
    adaptive: bool = True

    def __post_init__(self) -> None:
        if self.iterations < 1 or self.restarts < 0 or not self.first_step > 0:
            raise InputError(
                f"NelderMead(iterations={self.iterations}, restarts={self.restarts}, "
                f"first_step={self.first_step}): give at least one iteration, no fewer than 0 "
                "restarts and a positive first step."
            )

    @property
    def name(self) -> str:
        """Name in tables."""
        return "nelder_mead"

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum."""
        unknowns, monitor = objective.unknowns, objective.monitor
        scale = unknowns.scale
        theta = unknowns.clip(start)
        cost = ScalarCost(objective, theta)
        if not cost.finite:
            return Solution(theta, Ending.FAILED, NOT_FINITE)
        low, high = unknowns.low / scale, unknowns.high / scale

        def inside(at: FloatArray) -> FloatArray:
            return unknowns.clip(at * scale)

        def value(at: FloatArray) -> float:
            return cost(inside(at))

        def report(*, intermediate_result: scipy.optimize.OptimizeResult) -> None:
            monitor.iterate(inside(intermediate_result.x), cost.best_rms)

        # Keyword-only by SciPy's convention, which its type stubs do not know.
        callback: Any = report
        left = self.iterations
        for _ in range(self.restarts + 1):
            height = cost(theta)
            simplex = _simplex(theta / scale, low, high, self.first_step)
            found: Any = scipy.optimize.minimize(
                value, theta / scale, method="Nelder-Mead", bounds=scipy.optimize.Bounds(low, high),
                callback=callback,
                options={
                    "initial_simplex": simplex, "adaptive": self.adaptive,
                    "maxiter": left, "maxfev": 1000 * left,
                    "xatol": self.tolerance, "fatol": self.tolerance * height,
                },
            )  # fmt: skip
            theta, left = inside(np.asarray(found.x, dtype=float)), left - int(found.nit)
            if not found.success or left < 1:
                return Solution(
                    theta, Ending.LIMIT,
                    f"Stopped after {self.iterations} iterations while the simplex was still "
                    "moving; go on with solve(question, start=fit), or raise iterations.",
                )  # fmt: skip
        return Solution(theta, Ending.CONVERGED, "the simplex shrank to a point")


def _simplex(centre: FloatArray, low: FloatArray, high: FloatArray, step: float) -> FloatArray:
    """The start and one neighbour along each unknown, all within the bounds."""
    corners = np.tile(centre, (centre.size + 1, 1))
    for k in range(centre.size):
        size = step * max(1.0, abs(centre[k]))
        moved = centre[k] + size
        if moved > high[k]:
            moved = max(centre[k] - size, low[k])
        corners[k + 1, k] = moved
    return corners
