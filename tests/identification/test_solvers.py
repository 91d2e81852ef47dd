"""Every residual solver on one question, its bounds, priors and losses, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from piezo_opt import datasets
from piezo_opt.effects import BoucWen, PiezoGain, SecondOrder
from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.multiple_shooting import MultipleShooting
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.problem import Identification, Loss, Prior, Shape, Start
from piezo_opt.identification.solvers.base import ResidualSolver, Solution
from piezo_opt.identification.solvers.box import Box
from piezo_opt.identification.solvers.cma_es import CmaEs
from piezo_opt.identification.solvers.differential_evolution import DifferentialEvolution
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.solvers.nelder_mead import NelderMead
from piezo_opt.identification.solvers.nonlinear_program import Ipopt
from piezo_opt.identification.solvers.scipy_least_squares import ScipyLeastSquares
from piezo_opt.identification.transcription import SingleShooting
from piezo_opt.identification.unknowns import Unknowns, theta_of, unknowns
from piezo_opt.values import Values

SOLVERS: tuple[ResidualSolver, ...] = (
    LevenbergMarquardt(),
    ScipyLeastSquares(),
    NelderMead(),
    CmaEs(),
    DifferentialEvolution(tolerance=1e-9),
)
BEGIN = {"piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 4e-8, "bouc_wen.beta": 2e-2}
LOWEST = 1.690e-7
"""Misfit of plain Bouc-Wen on the thesis' loop with the mechanics of its Eq. 3.5 [m]."""


def loop() -> Identification:
    """The thesis' measured loop in the thesis' own setting."""
    return Identification(
        PiezoGain() + BoucWen() + SecondOrder(),
        datasets.load("thesis/hysteresis"),
        values=BEGIN,
        fixed={"second_order.omega": 8.0321, "second_order.zeta": 0.1992},
        start=Start.REST,
    )


def begun(
    question: Identification, values: Mapping[str, float] | None = None
) -> tuple[Unknowns, np.ndarray]:
    start = Values.nominal(question.model).with_({**BEGIN, **(values or {})})
    listed = unknowns(question, start)
    return listed, theta_of(listed, start)


def run(
    question: Identification, solver: object, values: Mapping[str, float] | None = None
) -> tuple[Solution, Monitor, Unknowns]:
    listed, theta = begun(question, values)
    monitor = Monitor(listed.names)
    return SingleShooting().identify(question, listed, theta, solver, monitor), monitor, listed


def cost_of(question: Identification, theta: np.ndarray) -> float:
    listed, start = begun(question)
    objective = Objective(question, listed, start, Monitor(listed.names))
    return objective.cost(objective.residual(theta))


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
def test_every_solver_reaches_the_optimum_of_the_loop(solver: ResidualSolver) -> None:
    solution, monitor, listed = run(loop(), solver)
    reference, *_ = run(loop(), LevenbergMarquardt())
    assert solution.ending is Ending.CONVERGED
    assert monitor.trace.rms[-1] == pytest.approx(LOWEST, rel=5e-4)
    assert_allclose(solution.theta / listed.scale, reference.theta / listed.scale, atol=2e-3)


def test_the_search_by_simplex_needs_ten_times_the_simulations() -> None:
    _, newton, _ = run(loop(), LevenbergMarquardt())
    _, simplex, _ = run(loop(), NelderMead())
    assert simplex.evaluations.total >= 10 * newton.evaluations.total


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
def test_bounds_are_kept_and_touched(solver: ResidualSolver) -> None:
    low = 6e-3
    question = replace(loop(), bounds={"bouc_wen.beta": (low, 1.0)})
    seen: list[float] = []
    listed, theta = begun(question)
    place = listed.names.index("bouc_wen.beta")
    objective = Objective(question, listed, theta, Monitor(listed.names))
    residual, linearised = objective.residual, objective.linearised
    objective.residual = lambda at: (seen.append(float(at[place])), residual(at))[1]  # type: ignore[method-assign]
    objective.linearised = lambda at, **_: (seen.append(float(at[place])), linearised(at))[1]  # type: ignore[method-assign]
    solution = solver.minimise(objective, theta)
    assert min(seen) >= low
    # The free optimum lies below the bound, so the bounded one is on it.
    free, *_ = run(loop(), LevenbergMarquardt())
    assert free.theta[place] < low
    assert solution.theta[place] == pytest.approx(low, rel=1e-3)


@pytest.mark.parametrize("shape", [Shape.SOFT_L1, Shape.HUBER, Shape.CAUCHY])
def test_a_robust_loss_has_one_optimum(shape: Shape) -> None:
    record = datasets.load("thesis/hysteresis")
    position = np.array(record.position)
    position[[9, 30]] += 3e-6
    question = replace(loop().with_records(record.with_(position=position)), loss=Loss(shape, 2e-7))
    mine, _, listed = run(question, LevenbergMarquardt(tolerance=1e-13))
    theirs, *_ = run(question, ScipyLeastSquares())
    _, theta = begun(question)
    program = MultipleShooting().identify(question, listed, theta, Ipopt(), Monitor(listed.names))
    assert_allclose(theirs.theta / listed.scale, mine.theta / listed.scale, atol=2e-4)
    assert_allclose(program.theta / listed.scale, mine.theta / listed.scale, atol=2e-4)
    # The loss is at work: least squares follows the outliers to other values.
    square, *_ = run(replace(question, loss=Loss()), LevenbergMarquardt())
    assert np.abs((square.theta - mine.theta) / listed.scale).max() > 0.01


def test_a_prior_has_one_optimum() -> None:
    question = replace(loop(), noise=1.7e-7, priors={"bouc_wen.alpha": Prior(5e-8, 1e-9)})
    mine, _, listed = run(question, LevenbergMarquardt(tolerance=1e-13))
    theirs, *_ = run(question, ScipyLeastSquares())
    _, theta = begun(question)
    program = MultipleShooting().identify(question, listed, theta, Ipopt(), Monitor(listed.names))
    assert_allclose(theirs.theta / listed.scale, mine.theta / listed.scale, atol=1e-5)
    assert_allclose(program.theta / listed.scale, mine.theta / listed.scale, atol=1e-5)
    alpha = listed.names.index("bouc_wen.alpha")
    assert mine.theta[alpha] == pytest.approx(5e-8, abs=2e-9)
    free, *_ = run(loop(), LevenbergMarquardt())
    assert free.theta[alpha] > 6e-8


@pytest.mark.parametrize("solver", [CmaEs(seed=3), DifferentialEvolution(seed=3, generations=20)])
def test_a_seed_repeats_a_search_and_leaves_the_global_stream_alone(
    solver: ResidualSolver,
) -> None:
    np.random.seed(5)  # noqa: NPY002
    untouched = np.random.get_state()[1].copy()  # type: ignore[union-attr]  # noqa: NPY002
    one, *_ = run(loop(), solver)
    two, *_ = run(loop(), solver)
    assert_allclose(one.theta, two.theta, rtol=0, atol=0)
    other, *_ = run(loop(), replace(solver, seed=4))  # type: ignore[type-var]
    assert not np.array_equal(other.theta, one.theta)
    assert np.array_equal(np.random.get_state()[1], untouched)  # type: ignore[index]  # noqa: NPY002


@pytest.mark.parametrize(
    "solver",
    [
        NelderMead(iterations=5),
        CmaEs(evaluations=30),
        DifferentialEvolution(generations=2),
        ScipyLeastSquares(evaluations=3),
    ],
    ids=lambda s: s.name,
)
def test_a_limit_is_said_with_the_remedy(solver: ResidualSolver) -> None:
    solution, monitor, _ = run(loop(), solver)
    assert solution.ending is Ending.LIMIT
    assert "start=fit" in solution.sentence
    assert cost_of(loop(), solution.theta) == pytest.approx(monitor.best_cost)


@pytest.mark.parametrize("solver", SOLVERS[1:], ids=lambda s: s.name)
def test_points_without_a_finite_simulation_are_passed_over(solver: ResidualSolver) -> None:
    listed, theta = begun(loop())
    objective = Objective(loop(), listed, theta, Monitor(listed.names))
    residual = objective.residual
    calls = [0]

    def broken(at: np.ndarray) -> np.ndarray:
        calls[0] += 1
        return np.full(51, np.inf) if calls[0] % 5 == 4 else residual(at)

    objective.residual = broken  # type: ignore[method-assign]
    first = objective.cost(residual(theta))
    solution = solver.minimise(objective, theta)
    assert np.isfinite(solution.theta).all()
    assert objective.cost(residual(solution.theta)) < 0.5 * first
    objective.residual = lambda at: np.full(51, np.nan)  # type: ignore[method-assign]  # noqa: ARG005
    lost = replace(solver, **_short(solver)).minimise(objective, theta)  # type: ignore[type-var]
    assert lost.ending is Ending.FAILED
    assert "start values" in lost.sentence


def _short(solver: ResidualSolver) -> dict[str, int]:
    return {"generations": 2} if solver.name == "differential_evolution" else {}


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.name)
def test_an_interrupt_goes_through_and_the_best_is_kept(solver: ResidualSolver) -> None:
    listed, theta = begun(loop())
    monitor = Monitor(listed.names)
    objective = Objective(loop(), listed, theta, monitor)
    residual, linearised = objective.residual, objective.linearised
    calls = [0]

    def interrupted(of: Callable[[np.ndarray], Any]) -> Callable[[np.ndarray], Any]:
        def counted(at: np.ndarray, **_: float) -> Any:
            calls[0] += 1
            if calls[0] == 12:
                raise KeyboardInterrupt
            return of(at)

        return counted

    objective.residual = interrupted(residual)  # type: ignore[method-assign]
    objective.linearised = interrupted(linearised)  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        solver.minimise(objective, theta)
    assert monitor.best is not None
    assert objective.cost(residual(monitor.best)) == pytest.approx(monitor.best_cost)
    assert monitor.best_cost <= objective.cost(residual(theta))


def test_the_box_is_finite_holds_the_start_and_goes_both_ways() -> None:
    question = replace(loop(), fixed={}, bounds={"second_order.omega": (1.0, np.inf)})
    listed, theta = begun(question)
    box = Box.around(Objective(question, listed, theta, Monitor(listed.names)), theta)
    assert np.isfinite(box.low).all()
    assert np.isfinite(box.high).all()
    assert (box.low >= listed.low).all()
    assert (box.high <= listed.high).all()
    assert_allclose(box.outside(box.inside(theta)), theta, rtol=1e-12, atol=1e-22)
    corners = np.random.default_rng(0).uniform(size=(100, theta.size))
    for corner in corners:
        assert_allclose(box.inside(box.outside(corner)), corner, atol=1e-9)
    omega = listed.names.index("second_order.omega")
    assert box.by_ratio[omega]
    middle = box.outside(np.full(theta.size, 0.5))[omega]
    assert middle == pytest.approx(np.sqrt(box.low[omega] * box.high[omega]))


def test_a_program_solver_cannot_take_residuals_and_the_other_way_round() -> None:
    with pytest.raises(ModelError, match="MultipleShooting"):
        run(loop(), Ipopt())
    listed, theta = begun(loop())
    with pytest.raises(ModelError, match="SingleShooting"):
        MultipleShooting().identify(
            loop(), listed, theta, LevenbergMarquardt(), Monitor(listed.names)
        )


@pytest.mark.parametrize(
    "build",
    [
        lambda: NelderMead(iterations=0),
        lambda: CmaEs(first_step=0.0),
        lambda: DifferentialEvolution(population=0),
        lambda: Ipopt(tolerance=0.0),
    ],
)
def test_choices_without_sense_are_refused(build: object) -> None:
    with pytest.raises(InputError, match="give"):
        build()  # type: ignore[operator]
