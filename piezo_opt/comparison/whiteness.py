"""Is what is left over noise? Auto- and cross-correlation with their band."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
import scipy

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.measurement import FloatArray

LAGS: Final = 20
LEVEL: Final = 0.999
_FEWEST_LAGS: Final = 10


@final
@dataclass(frozen=True, eq=False)
class Whiteness:
    """Correlations of the error with itself and with the drive.

    Attributes:
        lags: (2L+1,) lags -L..L in samples.
        autocorrelation: (2L+1,) of the error; 1 at lag 0.
        cross_correlation: (2L+1,) of the error with the drive; at a positive lag the drive came
            first.
        band: a white error stays within +- band at each lag with 99.9 % probability.
        autocorrelation_outside: share of the lags 1..L outside the band.
        cross_correlation_outside: share of all lags outside the band.
        p_value: probability that white noise of this length correlates as much (Ljung-Box).
        sentence: what that means.
    """

    lags: FloatArray
    autocorrelation: FloatArray
    cross_correlation: FloatArray
    band: float
    autocorrelation_outside: float
    cross_correlation_outside: float
    p_value: float
    sentence: str

    @property
    def conclusive(self) -> bool:
        """Whether the record is long enough for the test to mean something."""
        return self.lags.size > 2 * _FEWEST_LAGS

    @property
    def white(self) -> bool:
        """Whether no lag leaves the band and Ljung-Box passes at the 0.1 % level.

        White noise fails this in about two of a hundred records: twenty lags, one in a thousand
        each.
        """
        return self.p_value >= 1.0 - LEVEL and self.autocorrelation_outside == 0.0


def whiteness(misfit: Misfit, lags: int = LAGS) -> Whiteness:
    """Correlate the error of one record, on its counted samples, less its mean.

        r(k) = sum_t e(t) e(t+k) / sum e^2,    c(k) = sum_t e(t+k) v(t) / (|e| |v|)
        Q = N (N + 2) sum_{k=1..L} r(k)^2 / (N - k)  ~  chi^2(L),    band = 3.29 / sqrt(N)

    Lags count samples; those of an unevenly sampled record are not equally long.

    Source: Ljung (1999), System Identification, 2nd ed., sec. 16.6; Ljung & Box (1978),
    Biometrika 65, 297-303.
    """
    error = misfit.error - misfit.error.mean()
    drive = misfit.drive - misfit.drive.mean()
    count = error.size
    most = min(lags, count // 2)
    auto = _correlated(error, error, most)
    cross = _correlated(error, drive, most)
    band = float(scipy.special.ndtri(0.5 + 0.5 * LEVEL)) / float(np.sqrt(count))
    ahead = auto[most + 1 :]
    lag = np.arange(1, most + 1)
    statistic = count * (count + 2) * float(np.sum(ahead**2 / (count - lag)))
    p_value = float(scipy.special.chdtrc(most, statistic))
    outside = int(np.count_nonzero(np.abs(ahead) > band))
    along = int(np.count_nonzero(np.abs(cross) > band))
    return Whiteness(
        lags=np.arange(-most, most + 1, dtype=np.float64),
        autocorrelation=auto,
        cross_correlation=cross,
        band=band,
        autocorrelation_outside=outside / most,
        cross_correlation_outside=along / cross.size,
        p_value=p_value,
        sentence=_sentence(p_value, outside, most, along, cross.size),
    )


def _correlated(first: FloatArray, second: FloatArray, most: int) -> FloatArray:
    """(2 most + 1,) sum_t first(t+k) second(t) / (|first| |second|) at lags -most..most."""
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    if size == 0.0:
        return np.zeros(2 * most + 1)
    n = first.size
    after = [first[k:] @ second[: n - k] for k in range(most + 1)]
    if first is second:  # which is even
        return np.array([*after[:0:-1], *after]) / size
    before = [first[: n - k] @ second[k:] for k in range(most, 0, -1)]
    return np.array([*before, *after]) / size


def _sentence(p_value: float, outside: int, most: int, along: int, lags: int) -> str:
    if most < _FEWEST_LAGS:
        return "Too few samples to tell noise from structure."
    white = p_value >= 1.0 - LEVEL and outside == 0
    if white and along == 0:
        return (
            f"What is left passes as white noise (p = {p_value:.2g}) and does not correlate "
            "with the drive."
        )
    if white:
        text = f"What is left passes as white noise (p = {p_value:.2g})"
    else:
        text = (
            f"What is left is not white: {outside} of {most} lags of its autocorrelation "
            f"{'lies' if outside == 1 else 'lie'} outside the 99.9 % band"
        )
    if along:
        text += (
            f", {'but' if white else 'and'} it correlates with the drive at {along} of {lags} lags"
        )
    return text + "."
