"""Differential evolution: a global baseline without derivatives."""

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
from piezo_opt.identification.solvers.box import Box
from piezo_opt.identification.solvers.scalar import NOT_FINITE, ScalarCost

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True)
class DifferentialEvolution:
    """A population spread over a finite box around the start, bred by differences.

    Args:
        seed: of the random numbers; the same seed gives the same search.
        generations: most generations.
        population: members for each unknown.
        tolerance: spread of the costs over the population, relative to their mean, at
            convergence.

    References: Storn & Price (1997), J. Global Optim. 11, 341-359.
    """

    seed: int = 0
    generations: int = 1000
    population: int = 15
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        if self.generations < 1 or self.population < 1:
            raise InputError(
                f"DifferentialEvolution(generations={self.generations}, "
                f"population={self.population}): give at least one of each."
            )

    @property
    def name(self) -> str:
        """Name in tables."""
        return "differential_evolution"

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum."""
        monitor = objective.monitor
        theta = objective.unknowns.clip(start)
        box = Box.around(objective, theta)
        cost = ScalarCost(objective, theta)

        def value(at: FloatArray) -> float:
            return cost(box.outside(at))

        def report(intermediate_result: scipy.optimize.OptimizeResult) -> None:
            if cost.finite:
                monitor.iterate(box.outside(intermediate_result.x), cost.best_rms)

        bounds = scipy.optimize.Bounds(np.zeros(theta.size), np.ones(theta.size))
        found: Any = scipy.optimize.differential_evolution(
            value, bounds, x0=box.inside(theta),
            rng=np.random.default_rng(self.seed), maxiter=self.generations,
            popsize=self.population, tol=self.tolerance, polish=False, callback=report,
        )  # fmt: skip
        if not cost.finite:
            return Solution(theta, Ending.FAILED, NOT_FINITE)
        end = box.outside(np.asarray(found.x, dtype=float))
        if not found.success:
            return Solution(
                end, Ending.LIMIT,
                f"Stopped after {self.generations} generations while the population was still "
                "spread; finish with solve(question, start=fit), or raise generations.",
            )  # fmt: skip
        return Solution(end, Ending.CONVERGED, "the population shrank to a point")
