"""Evolution strategy with covariance matrix adaptation: a baseline without derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np
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
class CmaEs:
    """CMA-ES (library ``cma``) in a finite box around the start.

    Args:
        seed: of the random numbers; the same seed gives the same search.
        evaluations: most simulations.
        first_step: standard deviation of the first generation, as a share of the box.
        tolerance: spread of the costs, relative to the start's cost, at convergence.

    References: Hansen & Ostermeier (2001), Evol. Comput. 9(2), 159-195.
    """

    seed: int = 0
    evaluations: int = 20000
    first_step: float = 0.1
    tolerance: float = 1e-10

    def __post_init__(self) -> None:
        if self.evaluations < 1 or not 0 < self.first_step <= 1:
            raise InputError(
                f"CmaEs(evaluations={self.evaluations}, first_step={self.first_step}): give at "
                "least one evaluation and a first step within (0, 1]."
            )

    @property
    def name(self) -> str:
        """Name in tables."""
        return "cma_es"

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum."""
        import cma  # which brings a plotting library along: nobody else is to wait for that

        monitor = objective.monitor
        theta = objective.unknowns.clip(start)
        box = Box.around(objective, theta)
        cost = ScalarCost(objective, theta)
        # Its own stream of random numbers: the library's way is to seed numpy's global one.
        stream = np.random.default_rng(self.seed)

        def randn(*shape: int) -> Any:
            return stream.standard_normal(shape if shape else None)

        search = cma.CMAEvolutionStrategy(
            box.inside(theta), self.first_step,
            {
                "bounds": [[0.0] * theta.size, [1.0] * theta.size], "randn": randn,
                "seed": float("nan"), "verbose": -9, "maxfevals": self.evaluations,
                "tolfun": self.tolerance, "tolfunhist": 0.0, "tolx": 1e-9,
                "verb_disp": 0, "verb_log": 0,
            },
        )  # fmt: skip
        while not search.stop():
            asked = search.ask()
            search.tell(asked, [cost(box.outside(np.asarray(at))) for at in asked])
            if cost.finite:
                monitor.iterate(box.outside(np.asarray(search.result.xbest)), cost.best_rms)
        if not cost.finite:
            return Solution(theta, Ending.FAILED, NOT_FINITE)
        end = box.outside(np.asarray(search.result.xbest))
        if "maxfevals" in search.stop():
            return Solution(
                end, Ending.LIMIT,
                f"Stopped after {self.evaluations} simulations while the population was still "
                "spread; finish with solve(question, start=fit), or raise evaluations.",
            )  # fmt: skip
        return Solution(end, Ending.CONVERGED, "the population shrank to a point")
