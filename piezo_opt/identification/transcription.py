"""How a question becomes a finite problem: the choice, and single shooting."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, cast, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import ModelError
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import ENOUGH_A_SAMPLE, MOST_A_SAMPLE, Objective
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.solvers.base import ResidualSolver, Solution
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.unknowns import Unknowns
from piezo_opt.simulation import TOLERANCE

FloatArray = NDArray[np.float64]


class Transcription(Protocol):
    """Turns a question into a finite problem and hands it to a solver."""

    @property
    def name(self) -> str:
        """Name in tables."""

    @property
    def default_solver(self) -> str:
        """Name of the solver that it takes where none is given."""

    def identify(
        self,
        question: Identification,
        unknowns: Unknowns,
        start: FloatArray,
        solver: object | None,
        monitor: Monitor,
    ) -> Solution:
        """Estimate the unknowns from a start; ``solver`` None takes the transcription's own."""


@final
@dataclass(frozen=True)
class SingleShooting:
    """Simulate each record from its start to its end; only the unknowns are variables.

    The default: the problem stays as small as the number of unknowns, and least-squares solvers
    use the compiled sensitivities. Best for stable models and smooth costs.

    Args:
        refine: whether sub-steps are chosen anew at the solution, and the fit repeated where
            they had been too coarse; without it the scheme may bias what a long record knows
            very well (a resonance), which does not matter for a comparison of models.
        mend: rms [m] up to which, where they are not refined, sub-steps whose error has become a
            good part of what is left are chosen anew and the fit is repeated all the same: a search
            finds where the scheme errs in its favour (two loops in series, at steps of the drive).
            A fit that leaves more with the new ones is told with them and not repeated. With 0
            nothing is chosen anew.
        most: sub-steps a sample beyond which there is no fit: a comparison would wait for it longer
            than for all others.
        tolerance: error of the scheme as a share of the reading's range, with which it begins.
    """

    refine: bool = True
    mend: float = np.inf
    most: float = np.inf
    tolerance: float = TOLERANCE

    @property
    def name(self) -> str:
        """Name in tables."""
        return "single_shooting"

    @property
    def default_solver(self) -> str:
        """Levenberg-Marquardt."""
        return LevenbergMarquardt().name

    def identify(
        self,
        question: Identification,
        unknowns: Unknowns,
        start: FloatArray,
        solver: object | None,
        monitor: Monitor,
    ) -> Solution:
        """Estimate the unknowns from a start."""
        chosen = LevenbergMarquardt() if solver is None else solver
        if not hasattr(chosen, "minimise"):
            raise ModelError(
                f"{type(chosen).__name__} solves nonlinear programs, not residuals: use it with "
                "transcription=MultipleShooting() or Collocation(), or take LevenbergMarquardt()."
            )
        taken = cast(ResidualSolver, chosen)
        most = MOST_A_SAMPLE if self.refine else ENOUGH_A_SAMPLE
        objective = Objective(
            question, unknowns, start, monitor, self.tolerance, most=most, exact=not self.refine
        )
        self._affordable(objective)
        solution = taken.minimise(objective, start)
        if self.refine and objective.refine(solution.theta):
            # Sub-steps that were enough at the start are not at the solution: once more.
            solution = taken.minimise(objective, solution.theta)
        elif self.refine:
            solution = replace(solution, point=None)  # on other sub-steps than were chosen since
        elif self.mend > 0.0 and objective.mended(solution.theta, solution.point):
            self._affordable(objective)
            told = objective.rms(objective.residual(solution.theta))
            if told <= self.mend:
                solution = taken.minimise(objective, solution.theta)
            if told > self.mend or objective.mended(solution.theta, solution.point):
                solution = replace(solution, point=None)  # told on the sub-steps that it needs
        return replace(solution, accuracy=objective.accuracy)

    def _affordable(self, objective: Objective) -> None:
        dearest = max(accuracy.per_sample for accuracy in objective.accuracy)
        if dearest > self.most:
            raise ModelError(
                f"The model takes {dearest:.3g} sub-steps a sample at these values, more than "
                f"{self.most:.3g}: it is too stiff to be compared with others on this record."
            )
