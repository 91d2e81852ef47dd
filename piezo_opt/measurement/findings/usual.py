"""How a signal usually moves from sample to sample, which says what is unusual."""

from __future__ import annotations

import numpy as np

from piezo_opt.measurement.arrays import BoolArray, FloatArray, IndexArray

AROUND = 3
"""Samples on either side in which a drive that moves may have caused what is seen."""

MOST_CALM = 0.75
"""Share of the places at which the drive must be calm: where it is not, it may be by chance."""


def sharpness(values: FloatArray) -> FloatArray:
    """(N - 1,) how far each move of a signal is off the mean of the moves next to it."""
    step = np.diff(values)
    sharp = np.zeros(step.size)
    sharp[1:-1] = np.abs(step[1:-1] - (step[:-2] + step[2:]) / 2.0)
    return sharp


def large_moves(values: FloatArray, times: float, most: float) -> tuple[IndexArray, float]:
    """Moves that stand apart from all others, and the largest of those others.

    The sizes are sorted; the large ones end at the widest gap of at least ``times`` among the
    largest ``most`` (a share) of them.
    """
    size = np.abs(np.diff(values))
    many = max(2, int(most * size.size))
    top = np.arange(size.size)
    if many < size.size - 1:
        top = np.argpartition(size, size.size - 1 - many)[size.size - 1 - many :]
    top = top[np.lexsort((top, -size[top]))]
    ranked = size[top]
    ratio = ranked[:-1] / np.maximum(ranked[1:], np.finfo(np.float64).tiny)
    k = int(np.argmax(ratio))
    if ratio[k] < times or ranked[k + 1] == 0.0:
        return np.zeros(0, dtype=np.intp), float(ranked[0])
    return np.sort(top[: k + 1]), float(ranked[k + 1])


def drive_is_calm(
    drive: FloatArray, stretches: tuple[tuple[int, int], ...], before: int = AROUND
) -> BoolArray:
    """For each stretch, whether the drive moves near it no more than it usually does.

    That is twice what nine of ten of its moves are below, within ``before`` samples before and
    :data:`AROUND` after.
    """
    moves = np.abs(np.diff(drive))
    most = 2.0 * float(np.quantile(moves, 0.9))
    calm = [
        bool(moves[max(0, a - 1 - before) : b + AROUND].max(initial=0.0) <= most)
        for a, b in stretches
    ]
    return np.array(calm, dtype=np.bool_)
