"""The colour of the noise: a linear prediction that turns it white; and whether it does.

    e_t = r_t - a_1 r_(t-1) - ... - a_p r_(t-p)

Errors of rivals are compared after this filter, because samples of correlated noise do not count
one each. It is estimated from what the closest fit leaves (:mod:`book`); while that is no noise, an
answer alone is judged by it, so that what a model lacks is not taken for the noise's colour. What
is white has its power spread evenly over time and over frequency (:func:`crowded`).

Source: Brockwell & Davis (1991), Time Series, 2nd ed., ch. 5 (Levinson, Durbin) and 9 (order).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_MOST = 8
"""Highest order: rounding and a sensor's filter take two each, what is slower is no colour."""
_FEWEST = 50
"""Samples a coefficient: below it their errors are beyond a seventh."""
LEVEL: Final = 1e-3
"""Level of every test of noise, corrected for what it looks at: of a hundred records at most one
may be told wrongly, and a diagnosis asks three tests of the fits of a few sets."""
TWICE = 2.0
"""Mean power beyond which a stretch holds as much beside the noise as the noise itself."""


@final
@dataclass(frozen=True)
class Colour:
    """A prediction filter of noise.

    Attributes:
        coefficients: a_1 ... a_p; none for white noise.
        lengths: counted samples of each record, which are filtered one by one.
    """

    coefficients: tuple[float, ...]
    lengths: tuple[int, ...]

    @staticmethod
    def white(lengths: Sequence[int]) -> Colour:
        """No filter."""
        return Colour((), tuple(lengths))

    @staticmethod
    def of(residual: FloatArray, lengths: Sequence[int], most: int = _MOST) -> Colour:
        """The filter of the order that BIC wants, ``most`` at most, for a residual (M,)."""
        parts = np.split(residual, np.cumsum(lengths)[:-1])
        most = min(most, residual.size // _FEWEST)
        products = np.zeros(most + 1)
        for part in parts:
            for lag in range(min(most, part.size - 1) + 1):
                products[lag] += float(part[lag:] @ part[: part.size - lag])
        best: tuple[float, tuple[float, ...]] = (np.inf, ())
        if products[0] <= 0.0:
            return Colour((), tuple(lengths))
        price = float(np.log(residual.size))
        for order in range(most + 1):
            taken = (
                scipy.linalg.solve_toeplitz(products[:order], products[1 : order + 1])
                if order else np.zeros(0)
            )  # fmt: skip
            power = float(products[0] - taken @ products[1 : order + 1])
            if power <= 0.0:
                break
            cost = residual.size * float(np.log(power)) + order * price
            if cost < best[0]:
                best = (cost, tuple(taken.tolist()))
        return Colour(best[1], tuple(lengths))

    def whitened(self, columns: FloatArray) -> FloatArray:
        """Columns (M, ...) after the filter; the first p samples of each record are zero."""
        order = len(self.coefficients)
        if order == 0:
            return columns
        done = np.zeros(columns.shape)
        parts = np.cumsum(self.lengths)[:-1]
        for part, filtered in zip(np.split(columns, parts), np.split(done, parts), strict=True):
            filtered[order:] = part[order:]
            for lag, a in enumerate(self.coefficients, 1):
                filtered[order:] -= a * part[order - lag : part.shape[0] - lag]
        return done

    @property
    def news(self) -> float:
        """Independent samples that carry as much of a mean as one of noise of the first order:
        (1 - a) / (1 + a)."""
        a = sum(self.coefficients)
        return (1.0 - a) / (1.0 + a)

    def density(self, samples: int) -> FloatArray:
        """Power of the noise over that of e, at the frequencies k / N, 0 < k < N / 2."""
        turn = np.exp(-2j * np.pi * np.arange(1, (samples + 1) // 2) / samples)
        transfer = 1.0 - sum(a * turn**lag for lag, a in enumerate(self.coefficients, 1))
        return np.asarray(np.broadcast_to(1.0 / np.abs(transfer) ** 2, turn.shape))


def crowded(power: FloatArray, freedom: int) -> NDArray[np.bool_]:
    """Where (n,) powers of white noise would not be as they are: in stretches that hold too much.

    The share of L of n powers, each chi-squared with f degrees of freedom, has the distribution
    Beta(L f / 2, (n - L) f / 2). Asked are all stretches of 1, 2, 4, ... powers side by side, 2 n
    in all; what is found holds twice the mean as well.

    Args:
        power: squares over time, or a periodogram.
        freedom: of each: 1 of a square, 2 of an ordinate.

    Source: Fisher (1929), Proc. Royal Society A 125, 54-59, asks the largest ordinate alone.
    """
    n, total = power.size, float(power.sum())
    found = np.zeros(n, dtype=np.bool_)
    sums, size = power, 1
    while sums.size > 1 and total > 0.0:
        inside, outside = 0.5 * freedom * size, 0.5 * freedom * (n - size)
        most = 1.0 - scipy.special.betaincinv(outside, inside, LEVEL / (2 * n))
        over = sums > total * max(most, TWICE * size / n)
        found[: over.size * size] |= np.repeat(over, size)
        sums = sums[: sums.size // 2 * 2].reshape(-1, 2).sum(axis=1)
        size *= 2
    return found
