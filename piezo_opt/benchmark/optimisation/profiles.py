"""Data and performance profiles: which share of the cases is solved, and at what price.

    t_ps = least price at which solver s has  f <= f_L + tau (f_0 - f_L)  on case p
    data profile          d_s(kappa) = |{p : t_ps / (k_p + 1) <= kappa}| / |{p}|
    performance profile   rho_s(alpha) = |{p : t_ps / min_s t_ps <= alpha}| / |{p}|

with the cost f_0 at the start, the best known f_L, and k_p unknowns.

Sources: More & Wild (2009), SIAM J. Optim. 20(1), 172-191; Dolan & More (2002), Mathematical
Programming 91(2), 201-213.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Curve:
    """A solver's profile: a staircase from nothing.

    Attributes:
        at: (m,) ascending abscissae of its steps.
        share: (m,) share of the cases solved from there on.
    """

    at: FloatArray
    share: FloatArray

    def __call__(self, where: float) -> float:
        """Share at an abscissa."""
        return float(self.share[self.at <= where].max(initial=0.0))

    def reaches(self, share: float) -> float:
        """Least abscissa at which so large a share is solved; infinite where it never is."""
        there = self.at[self.share >= share - 1e-12]
        return float(there[0]) if there.size else float("inf")

    @property
    def last(self) -> float:
        """Share that it solves in the end."""
        return float(self.share[-1]) if self.share.size else 0.0


def work(
    prices: FloatArray, costs: FloatArray, first: float, least: float, tolerance: float
) -> float:
    """Price at which a run has solved its case; infinite where it has not.

    Args:
        prices: (m,) ascending prices of the costs.
        costs: (m,) costs.
        first: cost at the start.
        least: best known cost.
        tolerance: share of what there is to be gained that may be left.
    """
    target = max(tolerance * first + (1.0 - tolerance) * least, least)
    there = np.flatnonzero(costs <= target)
    return float(prices[there[0]]) if there.size else float("inf")


def data_profile(works: Mapping[str, FloatArray], sizes: FloatArray) -> dict[str, Curve]:
    """Shares by simulations for each unknown and one more.

    Args:
        works: (cases,) prices of each solver, infinite for what it has not solved.
        sizes: (cases,) number of unknowns.
    """
    return {name: _curve(own / (sizes + 1.0)) for name, own in works.items()}


def performance_profile(works: Mapping[str, FloatArray]) -> dict[str, Curve]:
    """Shares by the price over that of the cheapest solver there.

    Args:
        works: as for :func:`data_profile`. Whom it leaves out counts for nobody's ratio.
    """
    least = np.min(np.array(list(works.values())), axis=0)
    solved = np.isfinite(least)
    ratios = {}
    for name, own in works.items():
        ratio = np.full(own.size, np.inf)
        ratio[solved] = own[solved] / least[solved]
        ratios[name] = _curve(ratio)
    return ratios


def _curve(where: FloatArray) -> Curve:
    ordered = np.sort(where[np.isfinite(where)])
    return Curve(ordered, np.arange(1, ordered.size + 1) / max(1, where.size))
