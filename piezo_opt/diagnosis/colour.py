"""The colour of the noise: a linear prediction that turns it white, taken once for all rivals.

    e_t = r_t - a_1 r_(t-1) - ... - a_p r_(t-p)

Errors of rivals are compared after this filter, because samples of correlated noise do not count
one each. It is estimated from what the closest fit leaves (:mod:`book`), so that what a model lacks
is not taken for the noise's colour.

Source: Brockwell & Davis (1991), Time Series, 2nd ed., ch. 5 (Levinson, Durbin) and 9 (order).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_MOST = 8
"""Highest order: rounding and a sensor's filter take two each, what is slower is no colour."""
_FEWEST = 50
"""Samples a coefficient: below it their errors are beyond a seventh."""


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
    def of(residual: FloatArray, lengths: Sequence[int]) -> Colour:
        """The filter of the order that BIC wants for a residual (M,) over records."""
        parts = np.split(residual, np.cumsum(lengths)[:-1])
        most = min(_MOST, residual.size // _FEWEST)
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
