"""The default solver, on problems whose answers are known by hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, cast, final

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import HystereticForce, Spring
from piezo_opt.identification import Ending
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Linearised, Objective
from piezo_opt.identification.problem import Shape
from piezo_opt.identification.solvers import levenberg_marquardt as solver_module
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.transcription import SingleShooting
from piezo_opt.identification.unknowns import Unknown, Unknowns, theta_of
from piezo_opt.measurement import FloatArray
from piezo_opt.units import show
from tests.identification.truth import LINE, MOVING, STILL, TRUTH, loops, objective_of, record

TIME, DRIVE = loops(200)
D, Y0 = "piezo_gain.d", "offset.y0"


@dataclass
class Valley:
    """Rosenbrock's function as residuals: 10 (y - x^2), 1 - x. Zero at (1, 1)."""

    low: float = -10.0

    def __post_init__(self) -> None:
        self.unknowns = Unknowns(
            (
                Unknown("x", "x", None, 1.0, self.low, 10.0, None),
                Unknown("y", "y", None, 1.0, -10.0, 10.0, None),
            ),
            po.Values({}),
            1,
        )
        self.monitor = Monitor(self.unknowns.names)

    def residual(self, theta: FloatArray) -> FloatArray:
        return np.array([10.0 * (theta[1] - theta[0] ** 2), 1.0 - theta[0]])

    def linearised(self, theta: FloatArray, most: float = np.inf) -> Linearised:
        return Linearised(self.residual(theta), np.array([[-20.0 * theta[0], 10.0], [-1.0, 0.0]]))

    def robust(self, point: Linearised) -> Linearised:
        return point

    def cost(self, residual: FloatArray) -> float:
        return 0.5 * float(residual @ residual)

    def rms(self, residual: FloatArray) -> float:
        return float(np.sqrt(np.mean(residual**2)))

    def cost_at(self, point: Linearised) -> float:
        return self.cost(point.residual)

    def rms_at(self, point: Linearised) -> float:
        return self.rms(point.residual)


def descended(valley: Valley, **choices: Any) -> tuple[FloatArray, Ending, str]:
    solver = LevenbergMarquardt(**choices)
    solution = solver.minimise(cast(Objective, valley), np.array([-1.2, 1.0]))
    return solution.theta, solution.ending, solution.sentence


def test_derivatives_whose_squares_overflow_are_of_no_use() -> None:
    """Each is a number, their sum is none; the console hears nothing of it."""
    assert Linearised(np.zeros(2), np.eye(2)).usable
    assert not Linearised(np.zeros(2), 1e154 * np.eye(2)).usable


def test_the_end_of_a_zero_residual_problem_is_quadratic() -> None:
    valley = Valley()
    theta, ending, _ = descended(valley)
    assert ending is Ending.CONVERGED
    np.testing.assert_allclose(theta, 1.0, atol=1e-10)
    error = np.linalg.norm(valley.monitor.trace.values - 1.0, axis=1)
    near = np.flatnonzero((error < 0.3) & (error > 1e-5))
    # Digits double: e' <= C e^2 once near, up to the damping that is left (below 1e-2).
    for k in near:
        assert error[k + 1] < 20.0 * error[k] ** 2 + 1e-2 * error[k]
    assert error.size < 30


def test_the_cost_never_rises() -> None:
    valley = Valley()
    descended(valley)
    assert np.all(np.diff(valley.monitor.trace.rms) < 0)


def test_bounds_hold_at_every_iterate_and_the_minimum_on_them_is_found() -> None:
    valley = Valley(low=-10.0)
    valley.unknowns = Unknowns(
        (
            Unknown("x", "x", None, 1.0, -10.0, 0.5, None),
            Unknown("y", "y", None, 1.0, -10.0, 10.0, None),
        ),
        po.Values({}),
        1,
    )
    theta, ending, _ = descended(valley)
    assert ending is Ending.CONVERGED
    # With x at most 0.5 the first residual can still be made 0, by y = x^2.
    np.testing.assert_allclose(theta, [0.5, 0.25], atol=1e-6)
    assert theta[0] == 0.5
    assert valley.monitor.trace.values[:, 0].max() <= 0.5


@final
@dataclass
class Leaning(Valley):
    """Residuals J (theta - aim) with columns that lean on each other; x is bounded."""

    highest: float = 10.0
    aim: tuple[float, ...] = (3.0, -2.0, 1.0)

    def __post_init__(self) -> None:
        tops = (self.highest, 10.0, 10.0)
        self.unknowns = Unknowns(
            tuple(
                Unknown(n, n, None, 1.0, -10.0, t, None) for n, t in zip("xyz", tops, strict=True)
            ),
            po.Values({}),
            1,
        )
        self.monitor = Monitor(self.unknowns.names)
        self.jacobian = np.array([[1.0, 1.0, 0.0], [1.0, 1.02, 0.1], [1.0, 0.98, 0.2], [0, 0, 1]])

    def residual(self, theta: FloatArray) -> FloatArray:
        return self.jacobian @ (theta - np.array(self.aim)) + np.array([0.1, 0.0, -0.1, 0.05])

    def linearised(self, theta: FloatArray, most: float = np.inf) -> Linearised:
        self.monitor.with_sensitivities += 1
        return Linearised(self.residual(theta), self.jacobian)


def test_what_leans_on_an_unknown_at_its_bound_follows_at_once() -> None:
    # Free, x and y run far along their common valley; x stops at 0.5, where y belongs elsewhere.
    problem = Leaning(highest=0.5)
    solution = LevenbergMarquardt(tolerance=1e-12).minimise(
        cast(Objective, problem), np.array([0.0, 0.0, 0.0])
    )
    j, pinned = problem.jacobian, np.array([0.5, 0.0, 0.0])
    others = np.linalg.lstsq(j[:, 1:], -problem.residual(pinned), rcond=None)[0]
    np.testing.assert_allclose(solution.theta, [0.5, *others], atol=1e-4)
    # Five approaches by nine tenths, one touch, and no step refused on the way; cut off
    # without the others it is refused over and over.
    assert problem.monitor.with_sensitivities <= 10


def test_where_nothing_is_to_be_gained_nothing_is_simulated() -> None:
    problem = Leaning()
    at = np.linalg.lstsq(problem.jacobian, -problem.residual(np.zeros(3)), rcond=None)[0]
    nearly = at + 1e-6
    solution = LevenbergMarquardt(tolerance=1e-6).minimise(cast(Objective, problem), nearly)
    assert solution.ending is Ending.CONVERGED
    assert problem.monitor.with_sensitivities == 1
    np.testing.assert_array_equal(solution.theta, nearly)


def test_the_limit_of_iterations_says_how_to_go_on() -> None:
    valley = Valley()
    theta, ending, sentence = descended(valley, iterations=3)
    assert ending is Ending.LIMIT
    assert "after 3 iterations" in sentence
    assert "start=fit" in sentence
    assert valley.monitor.trace.rms.size == 4
    np.testing.assert_array_equal(theta, valley.monitor.best)


def test_on_a_linear_problem_what_a_stopped_search_promises_is_kept() -> None:
    measured = record(STILL, TRUTH, TIME, DRIVE, noise=1e-9)
    question = po.Identification(LINE, measured)
    wrong = {D: 3e-7, Y0: 0.0}
    stopped = po.solve(question, start=wrong, solver=LevenbergMarquardt(iterations=0))
    best = po.solve(question, start=wrong)
    assert stopped.rms > 2.0 * best.rms
    assert stopped.outcome.promised == pytest.approx(best.rms, rel=1e-6)
    assert best.outcome.promised is None
    assert f"promise {show(best.rms, 'm')}" in stopped.outcome.sentence


def test_a_search_that_has_slowed_down_too_far_off_is_given_up() -> None:
    valley = Valley()
    solver = LevenbergMarquardt(beyond=0.5)
    solution = solver.minimise(cast(Objective, valley), np.array([-1.2, 1.0]))
    rms = valley.monitor.trace.rms
    assert solution.ending is Ending.LIMIT
    assert f"after {rms.size - 1} iterations" in solution.sentence
    np.testing.assert_array_equal(solution.theta, valley.monitor.trace.values[-1])
    assert solution.point is not None
    assert valley.rms(solution.point.residual) == rms[-1] > 0.5
    # From the fifth iteration on, at the first that lowers the error by less than a fifth.
    assert [i for i in range(5, rms.size) if rms[i] > 0.8 * rms[i - 1]] == [rms.size - 1]


@pytest.mark.parametrize(
    ("start", "beyond", "fifth"), [((-1.2, 1.0), 1.6, 0.74), ((-9.5, 9.0), 0.5, 1.03)]
)
def test_who_is_near_enough_or_still_falls_fast_goes_on_to_the_end(
    start: tuple[float, float], beyond: float, fifth: float
) -> None:
    valley = Valley()
    solver = LevenbergMarquardt(beyond=beyond)
    solution = solver.minimise(cast(Objective, valley), np.array(start))
    assert solution.ending is Ending.CONVERGED
    assert valley.monitor.trace.rms[5] == pytest.approx(fifth, abs=0.01)


def test_a_start_without_a_finite_simulation_fails_with_the_remedy() -> None:
    valley = Valley()
    solution = LevenbergMarquardt().minimise(cast(Objective, valley), np.array([np.nan, 1.0]))
    assert solution.ending is Ending.FAILED
    assert "values={...}" in solution.sentence


def line(noise: FloatArray | float = 0.0, name: str = "record") -> po.Measurement:
    return po.Measurement(TIME, DRIVE, 1e-7 * DRIVE + 3e-7 + noise, name=name)


def solved(
    question: po.Identification, start: Mapping[str, float] | None = None
) -> dict[str, float]:
    objective, theta = objective_of(question, start or {})
    found = LevenbergMarquardt(tolerance=1e-14).minimise(objective, theta).theta
    return dict(zip(objective.unknowns.names, found.tolist(), strict=True))


def white(seed: int, size: float) -> FloatArray:
    return np.asarray(size * np.random.default_rng(seed).normal(size=TIME.size))


def test_a_linear_problem_is_the_normal_equations() -> None:
    record = line(white(0, 1e-8))
    found = solved(po.Identification(LINE, record))
    d, y0 = np.polyfit(DRIVE, record.position, 1)
    assert found == pytest.approx({D: d, Y0: y0}, rel=1e-9)


def test_a_prior_pulls_as_computed_by_hand() -> None:
    record, noise = line(white(1, 1e-8)), 1e-8
    prior = po.Prior(1.002e-7, 4e-11)
    found = solved(po.Identification(LINE, record, priors={D: prior}, noise=noise))
    j = np.column_stack([DRIVE, np.ones_like(DRIVE)])
    normal = j.T @ j / noise**2 + np.diag([1.0 / prior.std**2, 0.0])
    right = j.T @ record.position / noise**2 + np.array([prior.mean / prior.std**2, 0.0])
    d, y0 = np.linalg.solve(normal, right)
    assert found == pytest.approx({D: d, Y0: y0}, rel=1e-8)
    free = solved(po.Identification(LINE, record))
    # The prior is as sharp as the record: the answer lies well between the two.
    assert 0.2 < (found[D] - free[D]) / (prior.mean - free[D]) < 0.8


def test_weights_weigh_squares() -> None:
    steep = po.Measurement(TIME, DRIVE, 2e-7 * DRIVE, name="steep")
    flat = po.Measurement(TIME, DRIVE, 1e-7 * DRIVE, name="flat")
    question = po.Identification(LINE, [steep, flat], weights=(3.0, 1.0), fixed={"offset.y0": 0.0})
    found = solved(question)
    assert found[D] == pytest.approx((3.0 * 2e-7 + 1e-7) / 4.0, rel=1e-9)


@pytest.mark.parametrize("shape", [po.Shape.SOFT_L1, po.Shape.HUBER, po.Shape.CAUCHY])
def test_a_robust_loss_shrugs_off_outliers(shape: po.Shape) -> None:
    noise = white(2, 1e-9)
    # 2 % of the samples, all to one side, where they tilt the line most.
    top = np.argsort(DRIVE)[-4:]
    noise[top] += 5e-6
    record = line(noise)
    plain = solved(po.Identification(LINE, record))
    robust = solved(po.Identification(LINE, record, loss=po.Loss(shape, 3e-9)))
    assert abs(plain[D] - 1e-7) > 5e-10
    assert abs(robust[D] - 1e-7) < 0.1 * abs(plain[D] - 1e-7)


def test_a_robust_minimum_is_where_its_cost_is_flat() -> None:
    noise = white(3, 1e-8)
    noise[::25] += 3e-7
    loss = po.Loss(po.Shape.HUBER, 2e-8)
    objective, theta = objective_of(po.Identification(LINE, line(noise), loss=loss), {})
    found = LevenbergMarquardt(tolerance=1e-13).minimise(objective, theta).theta
    best = objective.cost(objective.residual(found))
    # Huber's cost by hand: r^2/2 inside, scale (|r| - scale/2) outside.
    r = np.abs(objective.residual(found))
    by_hand = np.where(r <= 2e-8, 0.5 * r**2, 2e-8 * (r - 1e-8)).sum()
    assert best == pytest.approx(by_hand, rel=1e-12)
    for step in ([1e-12, 0.0], [-1e-12, 0.0], [0.0, 1e-10], [0.0, -1e-10]):
        assert objective.cost(objective.residual(found + np.array(step))) > best


def test_the_gain_stops_at_its_bound_and_the_offset_follows() -> None:
    record = line()
    found = solved(po.Identification(LINE, record, bounds={D: (0.0, 0.8e-7)}), {D: 0.5e-7})
    assert found[D] == 0.8e-7
    assert found[Y0] == pytest.approx(3e-7 + 0.2e-7 * DRIVE.mean(), rel=1e-6)


@final
@dataclass
class Stiff(Valley):
    """A force over omega^2 is known to a thousandth, omega itself hardly: zero at (4, 16)."""

    relative: bool = True

    def __post_init__(self) -> None:
        self.unknowns = Unknowns(
            (
                Unknown("omega", "omega", None, 1.0, 0.0, 1e3, None, self.relative),
                Unknown("force", "force", None, 1.0, 0.0, 1e6, None, self.relative),
            ),
            po.Values({}),
            1,
        )
        self.monitor = Monitor(self.unknowns.names)

    def residual(self, theta: FloatArray) -> FloatArray:
        omega, force = theta
        return np.array([1e3 * (force / omega**2 - 1.0), np.log(omega / 4.0)])

    def linearised(self, theta: FloatArray, most: float = np.inf) -> Linearised:
        omega, force = theta
        rows = [[-2e3 * force / omega**3, 1e3 / omega**2], [1.0 / omega, 0.0]]
        return Linearised(self.residual(theta), np.array(rows))


def test_a_force_grows_with_the_square_of_the_frequency_in_a_straight_line() -> None:
    """In logarithms the valley is straight; without, it is climbed in small steps."""
    spent = {}
    for relative in (True, False):
        valley = Stiff(relative=relative)
        solver = LevenbergMarquardt(tolerance=1e-12)
        solution = solver.minimise(cast(Objective, valley), np.array([1.0, 1.5]))
        np.testing.assert_allclose(solution.theta, [4.0, 16.0], rtol=1e-6)
        spent[relative] = valley.monitor.trace.rms.size
    assert spent[True] < 15
    assert spent[False] > 2 * spent[True]


def test_from_nothing_a_force_begins_straight() -> None:
    valley = Stiff()
    solver = LevenbergMarquardt(tolerance=1e-12)
    solution = solver.minimise(cast(Objective, valley), np.array([4.0, 0.0]))
    np.testing.assert_allclose(solution.theta, [4.0, 16.0], rtol=1e-6)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -1e101])
def test_a_sensitivity_that_diverges_is_seen_beside_sound_residuals(wrong: float) -> None:
    residual, jacobian = np.ones(3), np.ones((3, 2))
    assert Linearised(residual, jacobian).usable
    assert not Linearised(residual, np.where(np.eye(3, 2) > 0, wrong, jacobian)).usable
    assert not Linearised(np.array([1.0, wrong, 1.0]), jacobian).usable


def test_every_point_is_simulated_once_and_with_its_sensitivities() -> None:
    """A point that is taken needs them next, and one that is refused is not looked at again."""
    objective, theta = objective_of(po.Identification(LINE, line(white(0, 1e-8))), {D: 2e-7})
    LevenbergMarquardt().minimise(objective, theta)
    assert objective.monitor.simulations == 0
    assert objective.monitor.with_sensitivities <= 4
    # Around Rosenbrock's bend steps are refused.
    valley = Valley()
    seen: list[tuple[float, ...]] = []
    costs: list[float] = []

    def told(at: np.ndarray, **_: float) -> Linearised:
        found = Valley().linearised(at)
        seen.append(tuple(at))
        costs.append(valley.cost(found.residual))
        return found

    valley.linearised = told  # type: ignore[method-assign]
    valley.residual = None  # type: ignore[method-assign, assignment]
    LevenbergMarquardt().minimise(cast(Objective, valley), np.array([-1.2, 1.0]))
    assert len(set(seen)) == len(seen)
    assert any(after > before for before, after in pairwise(costs))


def test_the_solution_knows_its_residual_and_jacobian() -> None:
    objective, theta = objective_of(po.Identification(LINE, line(white(0, 1e-8))), {D: 2e-7})
    solution = LevenbergMarquardt().minimise(objective, theta)
    assert solution.point is not None
    fresh = objective.linearised(solution.theta)
    np.testing.assert_array_equal(solution.point.residual, fresh.residual)
    np.testing.assert_array_equal(solution.point.jacobian, fresh.jacobian)


def test_a_point_on_other_sub_steps_is_not_the_solution_s() -> None:
    question = po.Identification(LINE, line(white(0, 1e-8)))
    objective, theta = objective_of(question, {D: 2e-7})
    for refine in (False, True):
        solution = SingleShooting(refine=refine).identify(
            question, objective.unknowns, theta, None, Monitor(objective.unknowns.names)
        )
        assert (solution.point is None) == refine


def test_sub_steps_that_err_by_what_is_left_are_chosen_anew_even_for_a_comparison() -> None:
    """A search finds where the scheme errs in its favour: two loops in series, at drive steps."""
    time = np.arange(400) / 20.0
    drive = np.repeat(np.array([0.0, 60.0, 10.0, 45.0, 5.0, 55.0, 20.0, 30.0]), 50)
    model = STILL + Spring() + HystereticForce()
    calm = {
        D: 1.2e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 0.03, "bouc_wen.gamma": 5e-3,
        "offset.y0": 0.0, "hysteretic_force.alpha": 0.0, "hysteretic_force.beta": 1e3,
    }  # fmt: skip
    steep = {**calm, "hysteretic_force.alpha": 4e5, "hysteretic_force.beta": 8e6}
    blank = po.Measurement(time, drive, 1e-7 * drive, allow_saturated=True)
    record = blank.with_(position=po.simulate(model, blank, steep).reading)
    question = po.Identification(model, record, start=po.Start.REST)
    objective, theta = objective_of(question, calm)
    assert not objective.mended(theta)
    there = theta_of(objective.unknowns, po.Values({**po.Values.nominal(model), **steep}))
    before = objective.rms(objective.residual(there))
    assert objective.mended(there)
    after = objective.rms(objective.residual(there))
    assert before > 1e-9 > 10.0 * after
    # So a comparison of models is never won by sub-steps chosen elsewhere.
    solution = SingleShooting(refine=False).identify(
        question, objective.unknowns, theta, Jump(there), Monitor(objective.unknowns.names)
    )
    assert solution.point is not None
    assert objective.rms(solution.point.residual) == pytest.approx(after)
    # Who leaves too much with the new ones is told so, and not fitted with them.
    off = 1e-7
    beside = theta_of(
        objective.unknowns, po.Values({**po.Values.nominal(model), **steep, "offset.y0": off})
    )
    for mend, runs in ((0.9 * off, 1), (1.1 * off, 2)):
        jump = Jump(beside)
        fit = po.solve(
            question, start=calm, solver=jump, statistics=False,
            transcription=SingleShooting(refine=False, mend=mend),
        )  # fmt: skip
        assert jump.runs == runs
        assert fit.rms == pytest.approx(off, rel=0.01)
    # Unless that is left for later, for those that are worth it.
    for mend, left in ((0.0, before), (np.inf, after)):
        fit = po.solve(
            question, start=calm, solver=Jump(there), statistics=False,
            transcription=SingleShooting(refine=False, mend=mend),
        )  # fmt: skip
        assert fit.rms == pytest.approx(left)


class Jump:
    """A solver that ends where it is told."""

    name = "jump"

    def __init__(self, to: FloatArray) -> None:
        self._to = to
        self.runs = 0

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        self.runs += 1
        return Solution(self._to, Ending.CONVERGED, "", point=objective.linearised(self._to))


@pytest.mark.parametrize("weights", [(), (1.0, 4.0)])
def test_a_cost_above_the_ceiling_is_not_simulated_to_its_end(weights: tuple[float, ...]) -> None:
    records = [line(white(k, 1e-8)).rename(f"{k}") for k in range(max(1, len(weights)))]
    for loss in (po.Loss(), po.Loss(Shape.HUBER, 1e-9)):
        question = po.Identification(LINE, records, weights=weights, loss=loss)
        objective, theta = objective_of(question, {D: 2e-7})
        whole = objective.linearised(theta)
        cost = objective.cost(whole.residual)
        robust = loss.shape is not Shape.SQUARE
        for share, known in ((0.5, robust), (0.999, robust), (1.001, True)):
            ahead = objective.linearised(theta, most=share * cost)
            assert (objective.cost(ahead.residual) == cost) == known
            assert (objective.cost(objective.residual(theta, share * cost)) == cost) == known
            if known:
                np.testing.assert_array_equal(ahead.jacobian, whole.jacobian)
            else:
                assert objective.cost(ahead.residual) == np.inf


def test_what_is_given_up_changes_no_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A refused point need not be known to its end: the path is the same to the last digit."""
    truth = {**TRUTH, "second_order.omega": 300.0, "second_order.zeta": 0.02}
    measured = record(MOVING, truth, TIME, DRIVE, noise=2e-9)
    far = {**truth, "bouc_wen.beta": 1.0}
    given_up: list[bool] = []

    def walked() -> tuple[FloatArray, FloatArray]:
        objective, theta = objective_of(po.Identification(MOVING, measured), far)
        solution = LevenbergMarquardt(iterations=40).minimise(objective, theta)
        trace = objective.monitor.trace
        return solution.theta, trace.values

    known = Objective.linearised

    def watched(self: Objective, theta: FloatArray, most: float = np.inf) -> Linearised:
        found = known(self, theta, most)
        given_up.append(bool(np.isnan(found.residual).any()))
        return found

    monkeypatch.setattr(Objective, "linearised", watched)
    short = walked()
    monkeypatch.setattr(Objective, "linearised", lambda self, theta, **_: known(self, theta))
    long = walked()
    np.testing.assert_array_equal(short[0], long[0])
    np.testing.assert_array_equal(short[1], long[1])
    assert sum(given_up) >= 3


def test_a_step_is_found_where_rounding_has_taken_the_normal_matrix_its_definiteness() -> None:
    off = 1.0 + 4.0 * np.finfo(float).eps
    normal = np.array([[1.0, off, 0.0], [off, 1.0, 0.0], [0.0, 0.0, 4.0]])
    gradient, weight = np.array([-1.0, -1.0, 4.0]), np.array([1.0, 1.0, 4.0])
    reach = np.full(3, -10.0), np.full(3, 10.0)
    step = solver_module._step(normal, gradient, weight, 0.0, np.arange(3), reach)
    # Either of the two alone would do, or both by halves; the third has its own minimum.
    assert step[0] + step[1] == pytest.approx(1.0)
    assert step[2] == pytest.approx(-1.0)
