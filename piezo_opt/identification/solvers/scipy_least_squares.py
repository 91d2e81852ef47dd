"""SciPy's trust-region least squares on exact sensitivities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.problem import Shape
from piezo_opt.identification.solvers.base import Solution

FloatArray = NDArray[np.float64]

_LOSS: Final[Mapping[Shape, Literal["linear", "soft_l1", "huber", "cauchy"]]] = {
    Shape.SQUARE: "linear",
    Shape.SOFT_L1: "soft_l1",
    Shape.HUBER: "huber",
    Shape.CAUCHY: "cauchy",
}


@final
@dataclass(frozen=True)
class ScipyLeastSquares:
    """``scipy.optimize.least_squares`` (trust-region reflective) on exact sensitivities.

    A second opinion on :class:`LevenbergMarquardt` by other people's code: same residuals, same
    bounds, the loss taken from SciPy.

    Args:
        evaluations: most simulations without sensitivities.
        tolerance: relative change of cost or unknowns below which it has converged.

    References: Branch, Coleman & Li (1999), SIAM J. Sci. Comput. 21(1), 1-23.
    """

    evaluations: int = 1000
    tolerance: float = 1e-12

    @property
    def name(self) -> str:
        """Name in tables."""
        return "scipy_least_squares"

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum."""
        unknowns, monitor = objective.unknowns, objective.monitor
        theta = unknowns.clip(start)
        first = objective.residual(theta)
        if not np.isfinite(first).all():
            return Solution(
                theta, Ending.FAILED,
                "The simulation is not finite at the start values; give other ones "
                "(values={...}) or tighter bounds.",
            )  # fmt: skip
        # SciPy's gradient test is absolute: residuals of 1e-6 m would pass it at once.
        unit = objective.rms(first) or 1.0

        def residual(at: FloatArray) -> FloatArray:
            inside = unknowns.clip(at)
            with np.errstate(over="ignore", invalid="ignore"):
                found = objective.residual(inside)
                monitor.saw(inside, objective.cost(found))
            return found / unit

        def jacobian(at: FloatArray) -> FloatArray:
            point = objective.linearised(unknowns.clip(at))
            monitor.iterate(unknowns.clip(at), objective.rms(point.residual))
            return point.jacobian / unit

        found: Any = scipy.optimize.least_squares(
            residual, theta, jac=jacobian, bounds=(unknowns.low, unknowns.high),
            x_scale=unknowns.scale, loss=_LOSS[objective.question.loss.shape],
            f_scale=objective.question.loss.scale / unit, max_nfev=self.evaluations,
            ftol=self.tolerance, xtol=self.tolerance, gtol=self.tolerance,
        )  # fmt: skip
        end = unknowns.clip(np.asarray(found.x, dtype=float))
        if found.status == 0:
            return Solution(
                end, Ending.LIMIT,
                f"Stopped after {self.evaluations} simulations while the cost was still falling; "
                "go on with solve(question, start=fit), or raise evaluations.",
            )  # fmt: skip
        why = {
            1: "the gradient vanished",
            2: "the cost stopped falling",
            3: "the unknowns stopped moving",
            4: "cost and unknowns stopped moving",
        }
        return Solution(end, Ending.CONVERGED, why[int(found.status)])
