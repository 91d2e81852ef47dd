"""A reading that is even in the drive: the butterfly of a ferroelectric that is switched."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.findings.finding import Finding, Weight

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_BINS, _EXPLAINED, _EVEN = 24, 0.8, 0.5
"""The loop is read in so many bins a branch; it must be most of the reading, and at least half of
it even."""


def butterflies(record: Measurement) -> Iterator[Finding]:
    """The loop's mean over both branches is even in the drive, about the drive's middle.

    The share of the reading's variance that a curve for each branch explains (a quasi-static
    loop), and the share of that which is even. A model that is a monotone function of its drive,
    with a loop, is odd but for its asymmetry.
    """
    u, y = record.drive, record.position
    low, high = float(u.min()), float(u.max())
    if not low < 0.0 < high or min(-low, high) < 0.5 * max(-low, high):
        return
    rising = np.gradient(u) > 0.0
    cell = np.minimum(((u - low) / (high - low) * _BINS).astype(np.intp), _BINS - 1)
    curve, left = _by_cell(2 * cell + rising, y)
    total = float(np.var(y))
    if total == 0.0 or left > (1.0 - _EXPLAINED) * total:
        return
    both = curve.reshape(_BINS, 2).mean(axis=1)
    if not np.isfinite(both).all():
        return
    both = both - both.mean()
    even = (both + both[::-1]) / 2.0
    share = float(np.sum(even**2) / np.sum(both**2))
    if share < _EVEN:
        return
    yield Finding(
        "butterfly",
        Weight.REFUSED,
        f"{100 * share:.0f} % of the loop is even in the drive: the reading turns back in the "
        "middle of a stroke of the drive, as the butterfly of a ferroelectric does whose "
        "polarisation is switched. No model here describes that.",
        "Drive it on one side of its coercive field (a bias), or cut the record to one such "
        "stretch; --accept butterfly fits it anyway.",
    )


def _by_cell(cell: np.ndarray, y: FloatArray) -> tuple[FloatArray, float]:
    """Mean of each cell (2 _BINS,), and the variance that is left."""
    count = np.bincount(cell, minlength=2 * _BINS)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(cell, weights=y, minlength=2 * _BINS) / count
    left = float(np.mean((y - mean[cell]) ** 2))
    return np.asarray(mean, dtype=np.float64), left
