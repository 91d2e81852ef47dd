"""Whether a residual repeats with the position: the error of an interferometer, of an encoder."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_FINE: Final = 0.25
"""Steps of the spectrum, in cycles over the stroke."""
_LEAST, _MOST = 5.0, 400.0
"""Cycles over the stroke that are looked at: fewer are a bend, which other tests see."""
_LOBE, _ASIDE = 3.0, 8.0
"""Cycles within which a line is as wide as the stroke makes it, even where a sine dwells at its
ends, and those up to which its surroundings are looked at."""
_PEAK: Final = 10.0
"""Power of a line over the highest beside it. Of noise, whose powers there are exponentially
distributed, one spectrum in thousands shows that."""
_QUICK: Final = 0.9
"""Share of the samples between which the position must move by less than half a period."""


def period(position: FloatArray, residual: FloatArray) -> float | None:
    """The period [m] with which a residual repeats along the position; None where it does not.

        P(k) = |sum_i r_i exp(-2 pi i k y_i / Y)|^2

    with the stroke Y and k cycles over it: a line is a k with far more power than its surroundings.

    Args:
        position: modelled reading (N,) [m].
        residual: (N,) [m].
    """
    stroke = float(np.ptp(position))
    quick = float(np.quantile(np.abs(np.diff(position)), _QUICK)) if position.size > 1 else 0.0
    if stroke <= 0.0 or quick <= 0.0:
        return None
    most = min(_MOST, 0.5 * stroke / quick)
    power = _power((position - position.min()) / stroke, residual, most + _ASIDE)
    cycles = _FINE * np.arange(power.size)
    peaks = np.r_[False, (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]), False]
    inside = np.flatnonzero(peaks & (cycles >= _LEAST) & (cycles <= most))
    if inside.size == 0:
        return None
    near, far = round(_LOBE / _FINE), round(_ASIDE / _FINE)
    beside = np.ones(2 * far + 1, dtype=bool)
    beside[far - near : far + near + 1] = False
    around = scipy.ndimage.maximum_filter(power, footprint=beside, mode="nearest")
    best = inside[np.argmax(power[inside] / np.maximum(around[inside], 1e-300))]
    if power[best] <= _PEAK * around[best]:
        return None
    before, at, after = power[best - 1 : best + 2]
    shift = 0.5 * (before - after) / (before - 2.0 * at + after)
    return stroke / float(cycles[best] + _FINE * shift)


def _power(way: FloatArray, residual: FloatArray, most: float) -> FloatArray:
    """The spectrum over a way of length 1, every ``_FINE`` cycles up to ``most``.

    By the transform of sums over bins, a twentieth of the shortest period wide.
    """
    bins = int(20 * (_MOST + _ASIDE))
    sums = np.bincount((way * (bins - 1)).round().astype(np.intp), residual, bins)
    # The way ends at the middle of the last bin.
    whole = np.fft.rfft(sums, round((bins - 1) / _FINE))
    return np.asarray(np.abs(whole[: int(most / _FINE) + 1]) ** 2)
