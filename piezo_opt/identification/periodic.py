"""Whether a residual repeats with the position: the error of an interferometer, of an encoder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

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
_BINS: Final = int(20 * (_MOST + _ASIDE))
"""Bins of the way, of which a residual is summed: a twentieth of the shortest period wide."""
_PEAK: Final = 10.0
"""Power of a line over the highest that is left beside it. Of noise, whose powers there are
exponentially distributed, one spectrum in thousands shows that."""
_TRIED: Final = 3
"""Highest peaks that are tried: where a record dwells at few positions, a line has copies."""
_QUICK: Final = 0.5
"""Share of its steps from sample to sample in which the position must move by less than half a
period: along a way that is steady, a shorter period would look like a longer one."""


def period(position: FloatArray, residual: FloatArray) -> float | None:
    """The period [m] with which a residual repeats along the position; None where it does not.

        P(k) = |sum_i r_i exp(-2 pi i k y_i / Y)|^2

    with the stroke Y and k cycles over it: a line is a k with far more power than what is left of
    its surroundings without it. With it they may hold its copies, where the record dwells at few
    positions.

    Args:
        position: modelled reading (N,) [m].
        residual: (N,) [m].
    """
    stroke = float(np.ptp(position))
    if stroke <= 0.0:
        return None
    steps = np.abs(np.diff(position))
    most = min(_MOST, 0.5 * stroke / float(np.quantile(steps[steps > 0.0], _QUICK)))
    bins = np.rint((position - position.min()) * ((_BINS - 1) / stroke)).astype(np.intp)
    counts = np.bincount(bins, minlength=_BINS)
    sums = np.asarray(np.bincount(bins, residual, _BINS), dtype=float)
    power = _power(sums, most + _ASIDE)
    cycles = _FINE * np.arange(power.size)
    peaks = np.r_[False, (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]), False]
    inside = np.flatnonzero(peaks & (cycles >= _LEAST) & (cycles <= most))
    found, most_above = None, _PEAK
    for peak in inside[np.argsort(-power[inside])][:_TRIED]:
        line = _line(counts, sums, float(cycles[peak]))
        rest = _power(sums - counts * line.values, most + _ASIDE)
        aside = np.abs(cycles - cycles[peak])
        around = rest[(aside > _LOBE) & (aside <= _ASIDE)].max(initial=0.0)
        if power[peak] > most_above * around:
            found, most_above = line, power[peak] / max(around, np.finfo(float).tiny)
    return None if found is None else stroke / found.cycles


@final
@dataclass(frozen=True, eq=False)
class _Line:
    """A sine along the way: how many cycles of it there are, and its values (bins,)."""

    cycles: float
    values: FloatArray


def _line(counts: NDArray[np.intp], sums: FloatArray, near: float) -> _Line:
    """The sine nearest to a number of cycles that explains most of a residual.

    Args:
        counts, sums: of the residual over bins of the way.
        near: cycles that it has, to a step of the spectrum.
    """
    way, root = np.linspace(0.0, 1.0, _BINS), np.sqrt(counts)
    means = sums / np.maximum(root, 1.0)

    def values(cycles: float) -> FloatArray:
        waves = np.exp(2j * np.pi * cycles * way)
        columns = np.column_stack([waves.real, waves.imag])
        size, *_ = np.linalg.lstsq(columns * root[:, None], means, rcond=None)
        return np.asarray(columns @ size)

    best = scipy.optimize.minimize_scalar(
        lambda cycles: -float(sums @ values(cycles)),
        bounds=(near - _FINE, near + _FINE),
        method="bounded",
    )
    return _Line(float(best.x), values(float(best.x)))


def _power(sums: FloatArray, most: float) -> FloatArray:
    """The spectrum of sums over bins of the way, every ``_FINE`` cycles up to ``most``."""
    # The way ends at the middle of the last bin.
    whole = np.fft.rfft(sums, round((_BINS - 1) / _FINE))
    return np.asarray(np.abs(whole[: int(most / _FINE) + 1]) ** 2)
