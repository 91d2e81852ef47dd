"""Residuals drawn anew in blocks that keep their correlation in time."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def block_length(residual: FloatArray) -> int:
    """Length of the blocks of a circular block bootstrap; 1 where nothing is correlated.

        b = (2 g^2 / d)^(1/3) n^(1/3),   g = sum |k| w(k / m) R(k),   d = 4/3 (sum w(k / m) R(k))^2

    with the autocovariance R, a trapezoidal window w of half width m = 2 l, and l the lag after
    which the correlation stays within 2 sqrt(lg n / n) for max(5, sqrt(lg n)) lags.

    Args:
        residual: (n,) in the order of time.

    Sources: Politis & White (2004), Econometric Reviews 23(1), 53-70; Patton, Politis & White
    (2009), Econometric Reviews 28(4), 372-375.
    """
    n = residual.size
    quiet = max(5, int(np.sqrt(np.log10(n))))
    most = int(np.ceil(np.sqrt(n))) + quiet
    most = min(most, n - 1)
    centred = residual - residual.mean()
    size = scipy.fft.next_fast_len(n + most, real=True)
    spectrum = scipy.fft.rfft(centred, size)
    covariance = scipy.fft.irfft(np.abs(spectrum) ** 2, size)[: most + 1] / n
    if not covariance[0] > 0.0:
        return 1
    band = 2.0 * np.sqrt(np.log10(n) / n)
    outside = np.abs(covariance[1:] / covariance[0]) >= band
    last = most
    for lag in range(most - quiet + 1):
        if not outside[lag : lag + quiet].any():
            last = lag
            break
    if last == 0:
        return 1
    width = min(2 * last, most)
    lags = np.arange(1, width + 1)
    window = np.clip(2.0 * (1.0 - lags / width), 0.0, 1.0)
    spread = 2.0 * float(np.sum(window * lags * covariance[lags]))
    level = float(covariance[0]) + 2.0 * float(np.sum(window * covariance[lags]))
    longest = int(np.ceil(min(3.0 * np.sqrt(n), n / 3.0)))
    if not level > 0.0:
        return longest
    ideal = (1.5 * (spread / level) ** 2 * n) ** (1.0 / 3.0)
    return int(np.clip(np.ceil(ideal), 1, longest))


def drawn(residual: FloatArray, length: int, generator: np.random.Generator) -> FloatArray:
    """As many residuals as there are, in blocks from anywhere; the end goes on at the beginning.

    Args:
        residual: (n,) in the order of time.
        length: of a block.
        generator: of random numbers.

    Source: Politis & Romano (1992), in Exploring the Limits of Bootstrap, 263-270.
    """
    n = residual.size
    starts = generator.integers(0, n, size=-(-n // length))
    index = (starts[:, None] + np.arange(length)).ravel()[:n]
    return np.asarray(residual[index % n])
