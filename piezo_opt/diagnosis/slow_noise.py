"""Whether what is left is noise that is correlated from sample to sample, and nothing else."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

LEAST: Final = 1000
"""Samples below which a spectrum does not tell slow noise from structure."""
_CORRELATIONS: Final = np.arange(0.0, 0.921, 0.02)
"""Beyond 0.92 noise would be as slow as what it hides."""
_WHITE: Final = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""White part beside the correlated one, as rounding leaves it, over the latter's innovation."""
_CANDIDATES: Final = tuple((float(rho), white) for white in _WHITE for rho in _CORRELATIONS)
_BINS: Final = 8
"""Of the lowest band; each one above is wider by half, so that a band is a third of its frequency
and more."""
_WIDER: Final = 1.5
_TAPERED: Final = 1.94
"""Ordinates of a Hann-tapered periodogram that carry the news of one."""
_RARE: Final = 1e-3
_LINE: Final = 9.0
"""Ordinate over the spectrum, beyond the logarithm of their number: chance gives it once in
8,000 records."""
_PEAKED: Final = 0.5
"""Excess kurtosis of the innovations: pulses after a step have a broad spectrum, too..."""
_FLAT: Final = 1.0
"""...and minus that of the residual: so has what switches between two levels, or swings."""


def correlation(residual: FloatArray, *, rounded: bool = False) -> float | None:
    """Correlation from sample to sample where a residual is first-order noise; None where not.

    The spectrum is compared with that of a first-order autoregression and white noise,

        S(f) = s^2 (1 / (1 - 2 rho cos(2 pi f) + rho^2) + w),    f in cycles a sample,

    in bands, by Whittle's likelihood. Structure is seen as a band too full (chi-squared at 0.1 %),
    as a line, or as pulses and levels (kurtosis): then this is not noise alone.

    Args:
        residual: evenly sampled residual [m], (N,).
        rounded: whether the reading was rounded; else w is zero: white noise below something slow
            is what a disturbance looks like.

    Source: Whittle (1953), Arkiv foer Matematik 2(5), 423-434; Brockwell & Davis (1991), Time
    Series, 2nd ed., ch. 10 (periodogram, test for hidden periodicities).
    """
    n = residual.size
    r = residual - residual.mean()
    largest = float(np.abs(r).max(initial=0.0))
    if n < LEAST or largest == 0.0:
        return None
    r = r / largest  # only the shape counts, and fourth powers overflow
    lag_one = float(r[1:] @ r[:-1] / (r @ r))
    if _kurtosis(r) < -_FLAT or _kurtosis(r[1:] - lag_one * r[:-1]) > _PEAKED:
        return None
    power = np.square(np.abs(np.fft.rfft(r * np.hanning(n)))[1 : n // 2])
    edges, count, expected, most = _expected(n)
    tried = slice(None) if rounded else slice(_CORRELATIONS.size)
    ratio = np.add.reduceat(power, edges) / count / expected[tried]
    ratio /= (ratio @ count / power.size)[:, None]
    deviance = 2.0 * ((ratio - 1.0 - np.log(ratio)) @ (count / _TAPERED))
    best = int(np.argmin(deviance))
    if deviance[best] > most:
        return None
    level = power / _spectrum(n, *_CANDIDATES[best])
    lines = level.max() > (np.log(level.size) + _LINE) * level.mean()
    return None if lines else lag_one


def _kurtosis(r: FloatArray) -> float:
    """Excess kurtosis of values about zero."""
    return float(np.mean(r**4) / np.mean(r**2) ** 2) - 3.0


def _spectrum(samples: int, rho: float, white: float) -> FloatArray:
    """Spectrum of a candidate at the frequencies of a periodogram, but zero and the last."""
    f = np.arange(1, samples // 2) / samples
    return np.asarray(1.0 / (1.0 - 2.0 * rho * np.cos(2.0 * np.pi * f) + rho**2) + white)


@lru_cache(maxsize=8)
def _expected(samples: int) -> tuple[NDArray[np.intp], FloatArray, FloatArray, float]:
    """First bins of the bands, bins in each, the candidates' mean power there, one a row, and the
    deviance that noise hardly exceeds."""
    size = samples // 2 - 1
    edges = _edges(size)
    count = np.diff(np.append(edges, size)).astype(float)
    # One candidate at a time: a million samples would need gigabytes otherwise.
    mean = np.stack([np.add.reduceat(_spectrum(samples, *c), edges) / count for c in _CANDIDATES])
    return edges, count, mean, float(scipy.special.chdtri(count.size - 3, _RARE))


def _edges(size: int) -> NDArray[np.intp]:
    """First bins of bands that grow with the frequency."""
    edges, width = [0], float(_BINS)
    while edges[-1] + 2.0 * width < size:
        edges.append(edges[-1] + int(width))
        width *= _WIDER
    return np.array(edges)
