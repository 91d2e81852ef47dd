"""Variance of sums of correlated terms: how sure a score is, and how many samples carry news."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def wald(column: FloatArray, r: FloatArray) -> float:
    """Squared score over its variance, about chi-squared with one degree when absent.

    The variance is taken from what is left after the column has explained its share, so that a
    true effect does not hide behind itself. Three estimates see different things, and the largest
    is taken: a score must not look surer than under any of them.

        sigma^2 S'S                     white noise
        sum_k w_k gamma_k S'_t S_(t+k)  stationary noise of autocovariance gamma, any column
        Newey and West's                noise that is larger where the column is

    with flat-top weights w over the residual's memory and Bartlett's. Newey and West's rests on few
    products where a column is large at few samples, as after steps.

    Sources: Newey & West (1987), Econometrica 55(3), 703-708; Politis & Romano (1995), J. Time
    Series Analysis 16(1), 67-103 (flat-top weights).
    """
    return _score(column, r)[0]


def chance(column: FloatArray, r: FloatArray) -> float:
    """Probability of so large a score by noise alone, for one column looked at.

    Student's t instead of chi-squared: a variance estimated over L lags of N samples is as
    uncertain as one from about 3 N / L independent ones.

    Source: Kiefer & Vogelsang (2005), Econometric Theory 21(6), 1130-1164 (such variances are not
    consistent, and normal tails are too thin); Priestley (1981), Spectral Analysis and Time
    Series, sec. 6.2 (equivalent degrees of freedom).
    """
    squared, lags = _score(column, r)
    degrees = max(1.0, 3.0 * r.size / (lags + 1.0))
    return float(2.0 * scipy.special.stdtr(degrees, -np.sqrt(squared)))


def _score(column: FloatArray, r: FloatArray) -> tuple[float, int]:
    """The statistic of a column, and the lags over which its variance was summed."""
    power = float(column @ column)
    if power == 0.0:
        return 0.0, 0
    along = float(column @ r)
    left = r - column * (along / power)
    lags = memory(left)
    weights = 2.0 * np.minimum(1.0, 2.0 * (1.0 - np.arange(lags + 1) / (lags + 1.0)))
    weights[0] = 1.0
    white = float(np.mean(left**2)) * power
    stationary = float(np.sum(weights * _lagged(left, lags) * _lagged(column, lags))) / left.size
    own = left.size * long_run_variance(column * left, lags)
    return along**2 / max(white, stationary, own, np.finfo(float).tiny), lags


def long_run_variance(terms: FloatArray, lags: int) -> float:
    """Newey and West's variance of sqrt(N) times the mean of correlated terms, over some lags."""
    products = _lagged(terms, lags)
    fading = 2.0 * (1.0 - np.arange(lags + 1) / (lags + 1.0))
    fading[0] = 1.0
    return float(fading @ products) / terms.size


def _lagged(x: FloatArray, lags: int) -> FloatArray:
    """sum_t x_t x_(t+k) for k = 0..lags < N."""
    # Zeros behind it keep so many lags from meeting its beginning.
    size = scipy.fft.next_fast_len(x.size + lags, real=True)
    spectrum = scipy.fft.rfft(x, size)
    power = spectrum.real**2 + spectrum.imag**2
    return np.asarray(scipy.fft.irfft(power, size)[: lags + 1])


def _correlated(r: FloatArray) -> FloatArray:
    """Autocorrelation from lag 0 to the first one within twice the deviation of white noise's,
    1 / sqrt(N), or to a quarter of the length."""
    products = _lagged(r - r.mean(), r.size // 4)
    if not products[0] > 0.0:
        return np.zeros(1)
    rho = products / products[0]
    none = np.flatnonzero(rho < 2.0 / np.sqrt(r.size))
    return np.asarray(rho[: int(none[0]) + 1] if none.size else rho)


def memory(r: FloatArray) -> int:
    """Lags that matter for a long-run variance: twice the fall of the autocorrelation."""
    return min(2 * (_correlated(r).size - 1), r.size // 4)


def effective_samples(r: FloatArray) -> float:
    """Independent samples that carry as much as N correlated ones, N / (1 + 2 sum rho)."""
    return r.size / max(1.0, 1.0 + 2.0 * float(_correlated(r)[1:].sum()))
