"""A problem as every contender gets it: one cost function, known best, measured prices."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.optimisation.cases import CASES
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import (
    Identification,
    LevenbergMarquardt,
    NelderMead,
    ScipyLeastSquares,
)
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.solvers.base import ResidualSolver
from piezo_opt.identification.unknowns import Unknowns, theta_of, unknowns
from piezo_opt.simulation import Accuracy
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

_SEARCHES: Final = 40
"""Starts of the search for the best value, with another seed than the race's."""
_ROUNDS: Final = 2
_TIMES: Final = 40
"""Repetitions of what is timed; the fastest counts, as it was disturbed least."""
_TRIES: Final = 200
_BESIDE: Final = 1.05
"""Factor by which points lie beside the best, where the Jacobian is checked."""


@final
@dataclass(frozen=True, eq=False)
class Posed:
    """A variant of a problem.

    Attributes:
        name, variant: which.
        question: what is asked.
        unknown: the unknowns (k).
        accuracy: sub-steps of each record; they stay, or everybody would minimise another cost.
        best: (k,) the best known values.
        least: the best known cost [m^2].
        ratio: price of a simulation with sensitivities over that of one without, measured here.
        simulation_s: [s] that a simulation takes, measured here.
        slopes: error of the exact Jacobian against finite differences, see :func:`jacobian_error`.
        compile_s: [s] until the first simulation had run with sensitivities and without.
    """

    name: str
    variant: int
    question: Identification
    unknown: Unknowns
    accuracy: tuple[Accuracy, ...]
    best: FloatArray
    least: float
    ratio: float
    simulation_s: float
    slopes: float
    compile_s: float

    def objective(self) -> Objective:
        """The cost, with a counter of its own."""
        monitor = Monitor(self.unknown.names)
        return Objective(self.question, self.unknown, self.best, monitor, accuracy=self.accuracy)

    def start(self, seed: int) -> tuple[FloatArray, float]:
        """Start number ``seed`` within the problem's reach of the best values, and its cost."""
        objective = self.objective()
        return _start(objective, self.best, CASES[self.name].reach, [31, seed, self.variant])


def posed(name: str, variant: int = 0) -> Posed:
    """Make a problem ready: simulate, find its best value, measure prices, check the Jacobian.

    The best value is the lowest that Levenberg-Marquardt reaches from values near the truth and
    from forty other starts, gone on with by SciPy's trust region and by a simplex in turn: none of
    it is part of the race.
    """
    began = time.perf_counter()
    question, near = CASES[name].pose(variant)
    begin = Values({**Values.nominal(question.model), **near})
    unknown = unknowns(question, begin)
    theta = theta_of(unknown, begin)
    objective = _cut(Objective(question, unknown, theta, Monitor(unknown.names)), theta, name)
    objective.residual(theta)
    objective.linearised(theta)
    compile_s = time.perf_counter() - began
    best, least = _best(objective, theta, CASES[name].reach, variant)
    plain = _fastest(lambda: objective.residual(best))
    exact = _fastest(lambda: objective.linearised(best))
    return Posed(
        name, variant, question, unknown, objective.accuracy, best, least,
        max(1.0, exact / plain), plain, _slopes(objective, best, variant), compile_s,
    )  # fmt: skip


def _cut(objective: Objective, theta: FloatArray, name: str) -> Objective:
    """The same cost on sub-steps that are cut as the problem asks for."""
    times = CASES[name].cut
    if times == 1:
        return objective
    finer = tuple(
        replace(one, substeps=replace(one.substeps, times=times * one.substeps.times))
        for one in objective.accuracy
    )
    monitor = Monitor(objective.unknowns.names)
    return Objective(objective.question, objective.unknowns, theta, monitor, accuracy=finer)


def _slopes(objective: Objective, best: FloatArray, variant: int) -> float:
    """Median error of the Jacobian at three points beside the best, which may be a corner."""
    points = [_start(objective, best, _BESIDE, [53, k, variant])[0] for k in range(3)]
    return float(np.median([jacobian_error(objective, point) for point in points]))


def _best(
    objective: Objective, theta: FloatArray, reach: float, variant: int
) -> tuple[FloatArray, float]:
    exact = LevenbergMarquardt(iterations=500, tolerance=1e-14, crawl=0.0)
    best, least = theta, np.inf
    for search in range(_SEARCHES + 1):
        start = theta
        if search:
            start, _ = _start(objective, theta, reach, [97, search, variant])
        try:
            found = exact.minimise(objective, start).theta
        except NO_FIT:
            continue
        cost = objective.cost(objective.residual(found))
        if cost < least:
            best, least = found, cost
    # Corners and valleys stop one method where another goes on.
    polishers: tuple[ResidualSolver, ...] = (
        ScipyLeastSquares(evaluations=300, tolerance=1e-15),
        NelderMead(iterations=1500, first_step=0.01, restarts=2, tolerance=1e-14),
        exact,
    )
    for polisher in polishers * _ROUNDS:
        polished = polisher.minimise(objective, best).theta
        cost = objective.cost(objective.residual(polished))
        if cost < least:
            best, least = polished, cost
    return best, least


def _start(
    objective: Objective, centre: FloatArray, reach: float, seed: list[int]
) -> tuple[FloatArray, float]:
    """A finite point whose unknowns are each a factor within the reach away from a centre's."""
    unknown = objective.unknowns
    generator = np.random.default_rng(seed)
    small = np.abs(centre) < 1e-3 * unknown.scale
    for _ in range(_TRIES):
        toss = generator.uniform(-1.0, 1.0, size=centre.size)
        moved = np.where(small, toss * (reach - 1.0) * unknown.scale, centre * reach**toss)
        theta = unknown.clip(moved)
        with np.errstate(over="ignore", invalid="ignore"):
            cost = objective.cost(objective.residual(theta))
        if np.isfinite(cost):
            return theta, cost
    return centre, objective.cost(objective.residual(centre))


def _fastest(act: Callable[[], object]) -> float:
    least = np.inf
    for _ in range(_TIMES):
        began = time.perf_counter()
        act()
        least = min(least, time.perf_counter() - began)
    return float(least)


def jacobian_error(objective: Objective, theta: FloatArray) -> float:
    """Largest error of the exact Jacobian's columns against central differences of fourth order.

        df/dx = (8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / 12 h + O(h^4)

    Relative to each column, at the better of some step lengths: too long ones cut corners, too
    short ones drown in rounding. An unknown that would have to step over its bound is moved inside.

    Args:
        objective: the residuals.
        theta: a point.
    """
    unknown = objective.unknowns
    size = np.maximum(np.abs(theta), 1e-3 * unknown.scale)
    at = np.clip(theta, unknown.low + 3e-3 * size, unknown.high - 3e-3 * size)
    exact = objective.linearised(at).jacobian
    worst = 0.0
    for k in range(at.size):
        errors = []
        for share in (1e-3, 1e-4, 1e-5, 1e-6):
            step = np.zeros(at.size)
            step[k] = share * size[k]
            near = objective.residual(at + step) - objective.residual(at - step)
            far = objective.residual(at + 2.0 * step) - objective.residual(at - 2.0 * step)
            slope = (8.0 * near - far) / (12.0 * step[k])
            column = float(np.linalg.norm(exact[:, k]))
            errors.append(float(np.linalg.norm(slope - exact[:, k])) / (column or 1.0))
        worst = max(worst, min(errors))
    return worst
