"""A cost that keeps a book: what has been spent, and the best that it bought."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.identification.objective import Linearised, Objective

FloatArray = NDArray[np.float64]


@final
class Spent(Exception):
    """The budget of a run is used up."""


@final
class Recorded:
    """An objective whose simulations are charged, and whose improvements are written down.

    It stands where an :class:`~piezo_opt.identification.objective.Objective` is expected.

    Args:
        objective: the cost.
        ratio: price of a simulation with sensitivities; one without costs 1.
        budget: [simulations] after which nothing is simulated any more.
        tell: called with the price and the cost of every improvement.
    """

    def __init__(
        self,
        objective: Objective,
        ratio: float,
        budget: float,
        tell: Callable[[tuple[float, float]], None] | None = None,
    ) -> None:
        self._objective = objective
        self._ratio = ratio
        self._budget = budget
        self._tell = tell
        self.spent = 0.0
        self.least = np.inf
        self.best: FloatArray | None = None
        self.prices: list[float] = []
        self.costs: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._objective, name)

    def residual(self, theta: FloatArray, most: float = np.inf) -> FloatArray:
        """As the objective's, for the price of a simulation."""
        self._charge(1.0)
        found = self._objective.residual(theta, most)
        self._look(theta, found)
        return found

    def linearised(self, theta: FloatArray, most: float = np.inf) -> Linearised:
        """As the objective's, for the price of a simulation with sensitivities."""
        self._charge(self._ratio)
        found = self._objective.linearised(theta, most)
        self._look(theta, found.residual)
        return found

    def note(self, theta: FloatArray, price: float) -> None:
        """Write down a point that was reached for a price by other means than simulations.

        Raises:
            Spent: the price is above the budget.
        """
        self.spent = max(self.spent, price)
        with np.errstate(over="ignore", invalid="ignore"):
            self._look(theta, self._objective.residual(theta))
        if price > self._budget:
            raise Spent

    def _charge(self, price: float) -> None:
        if self.spent + price > self._budget:
            raise Spent
        self.spent += price

    def _look(self, theta: FloatArray, residual: FloatArray) -> None:
        with np.errstate(over="ignore", invalid="ignore"):
            cost = self._objective.cost(residual)
        if cost < self.least:
            self.least, self.best = cost, np.array(theta)
            self.prices.append(self.spent)
            self.costs.append(cost)
            if self._tell is not None:
                self._tell((self.spent, cost))
