"""Who takes part: a solver, and how it goes about a problem."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from time import process_time
from typing import Any, Final, cast, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.optimisation.libraries import FiniteDifferences, Nlopt, ParticleSwarm
from piezo_opt.benchmark.optimisation.posed import Posed
from piezo_opt.benchmark.optimisation.recording import Recorded
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import (
    CmaEs,
    Collocation,
    DifferentialEvolution,
    Fatrop,
    Ipopt,
    LevenbergMarquardt,
    MultipleShooting,
    NelderMead,
    ScipyLeastSquares,
)
from piezo_opt.identification.horizon import Horizon, ProgramSolver
from piezo_opt.identification.multistart import draw
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.solvers.base import ResidualSolver
from piezo_opt.identification.solvers.dense_program import DenseProgram

FloatArray = NDArray[np.float64]


class Family(Enum):
    """Contenders that are drawn together."""

    LEAST_SQUARES = "least squares, and transcriptions"
    PROGRAMS = "programs on single shooting"
    PLAIN = "without derivatives"


@final
@dataclass(frozen=True)
class Contender:
    """A solver in the race.

    Attributes:
        name: in tables.
        says: what it is, in a line.
        run: ``(problem, recorded cost, start, seed) -> how it ended, and a sentence``.
        family: with whom it is drawn.
        apart: whether it runs in a process of its own, because it is other people's compiled code
            that prints, may not return, or may take the process along.
    """

    name: str
    says: str
    run: Callable[[Posed, Recorded, FloatArray, int], tuple[str, str]]
    family: Family
    apart: bool = False


@final
@dataclass(frozen=True)
class _ByResiduals:
    """A solver that minimises the cost of single shooting."""

    make: Callable[[int], object]

    def __call__(
        self,
        posed: Posed,  # noqa: ARG002
        cost: Recorded,
        start: FloatArray,
        seed: int,
    ) -> tuple[str, str]:
        """Minimise."""
        solver = cast(ResidualSolver, self.make(seed))
        with np.errstate(over="ignore", invalid="ignore"):
            found = solver.minimise(cast(Objective, cost), start)
        return found.ending.value, found.sentence


_DEFAULT: Final = LevenbergMarquardt(tolerance=1e-13, crawl=0.0)
"""The default, told to go on until 1e-6 of the cost can be judged."""
_STARTS: Final = 100
"""Starts of a search that begins anew, ``solve(question, starts=100)``: as many as there is budget
for."""


def _anew(posed: Posed, cost: Recorded, start: FloatArray, seed: int) -> tuple[str, str]:
    """The default from the given start, then from starts drawn as :func:`solve` draws them."""
    for index in range(_STARTS):
        at = draw(posed.unknown, posed.question, start, seed, index)
        with np.errstate(over="ignore", invalid="ignore"), suppress(*NO_FIT):
            _DEFAULT.minimise(cast(Objective, cost), at)
    return "converged", f"the best of {_STARTS} starts"


@final
@dataclass(frozen=True)
class _ByProgram:
    """A solver of a large nonlinear program, each iterate judged by the cost of single shooting.

    It does not simulate: its price is the processor time from its first iterate on, in simulations
    of the same problem. Writing the program down is not in it, as compiling is not in the others'.
    """

    transcription: MultipleShooting | Collocation
    solver: Any

    def __call__(
        self,
        posed: Posed,
        cost: Recorded,
        start: FloatArray,
        seed: int,  # noqa: ARG002
    ) -> tuple[str, str]:
        """Write the program down and solve it."""
        objective = posed.objective()
        horizon = Horizon.of(objective, start, True)
        solver = cast(ProgramSolver, self.solver)
        program = self.transcription.transcribe(horizon, solver.stagewise)
        unknown = posed.unknown
        began: list[float] = []
        judging = 0.0

        def report(scaled: FloatArray) -> None:
            nonlocal judging
            now = process_time()
            if not began:
                began.append(now)
            spent = now - began[0] - judging
            cost.note(unknown.clip(scaled * unknown.scale), 1.0 + spent / posed.simulation_s)
            judging += process_time() - now

        found = solver.solve(program, report)
        return found.ending.value, found.sentence


_THESIS: Final = NelderMead(
    iterations=262, first_step=0.05, restarts=0, adaptive=False, tolerance=1e-4
)
"""fminsearch as MATLAB documents it: edges of 5 %, the coefficients of Nelder and Mead."""


def _plugin(name: str, says: str) -> Contender:
    return Contender(name, says, _ByResiduals(lambda _: DenseProgram(name)), Family.PROGRAMS, True)


CONTENDERS: Final[Mapping[str, Contender]] = {
    one.name: one
    for one in (
        Contender(
            "gauss_newton", "Levenberg-Marquardt on exact sensitivities: the default",
            _ByResiduals(lambda _: _DEFAULT), Family.LEAST_SQUARES,
        ),
        Contender(
            "gauss_newton_starts", "the same from up to 100 starts: solve(starts=100)",
            _anew, Family.LEAST_SQUARES,
        ),
        Contender(
            "scipy_exact", "scipy least_squares on exact sensitivities",
            _ByResiduals(lambda _: ScipyLeastSquares()), Family.LEAST_SQUARES,
        ),
        Contender(
            "scipy_differences", "scipy least_squares by finite differences",
            _ByResiduals(lambda _: FiniteDifferences()), Family.LEAST_SQUARES,
        ),
        Contender(
            "ipopt_single", "IPOPT on single shooting",
            _ByResiduals(lambda _: DenseProgram("ipopt")), Family.LEAST_SQUARES, apart=True,
        ),
        Contender(
            "ipopt_multiple", "IPOPT on multiple shooting",
            _ByProgram(MultipleShooting(), Ipopt(iterations=150)), Family.LEAST_SQUARES, apart=True,
        ),
        Contender(
            "ipopt_collocation", "IPOPT on collocation",
            _ByProgram(Collocation(), Ipopt(iterations=150)), Family.LEAST_SQUARES, apart=True,
        ),
        Contender(
            "fatrop", "FATROP on multiple shooting; tells its end only",
            _ByProgram(MultipleShooting(8), Fatrop(iterations=150)), Family.LEAST_SQUARES,
            apart=True,
        ),
        _plugin("sqpmethod", "CasADi's SQP method on single shooting"),
        _plugin("feasiblesqpmethod", "CasADi's feasible SQP on single shooting"),
        _plugin("uno", "Uno on single shooting"),
        _plugin("sleqp", "SLEQP on single shooting"),
        _plugin("alpaqa", "alpaqa (PANOC) on single shooting"),
        _plugin("qrsqp", "CasADi's QR-SQP on single shooting"),
        _plugin("scpgen", "CasADi's SCPgen on single shooting"),
        _plugin("blocksqp", "blockSQP on single shooting"),
        _plugin("madnlp", "MadNLP on single shooting"),
        Contender(
            "nelder_mead", "the simplex search: what many theses use",
            _ByResiduals(lambda _: NelderMead()), Family.PLAIN,
        ),
        Contender(
            "nelder_mead_thesis", "the same as the thesis had it: MATLAB's simplex, 262 iterations",
            _ByResiduals(lambda _: _THESIS), Family.PLAIN,
        ),
        Contender(
            "cma_es", "CMA-ES in a box around the start",
            _ByResiduals(lambda seed: CmaEs(seed=seed, evaluations=1_000_000)), Family.PLAIN,
        ),
        Contender(
            "differential_evolution", "differential evolution in the same box",
            _ByResiduals(lambda seed: DifferentialEvolution(seed=seed)), Family.PLAIN,
        ),
        Contender(
            "particle_swarm", "a particle swarm in the same box",
            _ByResiduals(lambda seed: ParticleSwarm(seed=seed)), Family.PLAIN, apart=True,
        ),
        Contender(
            "nlopt_bobyqa", "BOBYQA of NLopt: a quadratic model without derivatives",
            _ByResiduals(lambda _: Nlopt("LN_BOBYQA")), Family.PLAIN,
        ),
        Contender(
            "nlopt_sbplx", "subplex of NLopt",
            _ByResiduals(lambda _: Nlopt("LN_SBPLX")), Family.PLAIN,
        ),
        Contender(
            "nlopt_crs2", "controlled random search of NLopt in the same box",
            _ByResiduals(lambda _: Nlopt("GN_CRS2_LM", boxed=True)), Family.PLAIN,
        ),
        Contender(
            "nlopt_lbfgs", "L-BFGS of NLopt on the gradient",
            _ByResiduals(lambda _: Nlopt("LD_LBFGS")), Family.PROGRAMS,
        ),
        Contender(
            "nlopt_slsqp", "SLSQP of NLopt on the gradient",
            _ByResiduals(lambda _: Nlopt("LD_SLSQP")), Family.PROGRAMS,
        ),
    )
}  # fmt: skip
"""Contenders by name."""
