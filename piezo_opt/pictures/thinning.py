"""Curves for a screen: as many points as it can show, with no peak lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MOST_POINTS = 4000
"""Of one trace; wider screens are not in sight."""


def window(time: FloatArray, begin: float | None, end: float | None) -> slice:
    """Samples between two instants [s], and one beyond each end, so that lines reach the edge."""
    first = 0 if begin is None else max(0, int(np.searchsorted(time, begin)) - 1)
    last = (
        time.size if end is None else min(time.size, int(np.searchsorted(time, end, "right")) + 1)
    )
    return slice(first, max(last, first + 2))


def envelope(
    time: FloatArray, signals: list[FloatArray], most: int = MOST_POINTS
) -> tuple[FloatArray, list[FloatArray]]:
    """Signals (N,) on one clock with at most ``most`` points, smallest and largest of each stretch.

    Of every stretch of samples each signal keeps its smallest and its largest value, in the order
    in which they come. NaN, where a signal has no sample, is left out; a stretch of NaN stays NaN.
    Signals that are short enough come back as they are.
    """
    count = time.size
    if count <= most:
        return time, signals
    width = -(-count // (most // 2))
    rows = -(-count // width)
    padding = rows * width - count
    begins = np.arange(rows) * width
    middles = np.minimum(begins + width // 2, count - 1)
    clock = np.column_stack([time[begins], time[middles]]).ravel()
    # The last stretch may be too short to have a middle of its own.
    clock[-1] = time[-1]
    found = []
    for signal in signals:
        padded = np.concatenate([signal, np.full(padding, np.nan)]).reshape(rows, width)
        gone = np.isnan(padded)
        holes = gone.any()
        low = np.where(gone, np.inf, padded) if holes else padded
        high = np.where(gone, -np.inf, padded) if holes else padded
        first, second = low.argmin(axis=1), high.argmax(axis=1)
        at = np.arange(rows)
        smallest, largest = padded[at, first], padded[at, second]
        falling = first > second
        pair = np.where(
            falling[:, np.newaxis],
            np.column_stack([largest, smallest]),
            np.column_stack([smallest, largest]),
        )
        found.append(pair.ravel())
    return clock, found


def outline(signals: list[FloatArray], most: int = MOST_POINTS) -> NDArray[np.intp]:
    """Samples that draw a curve in a plane: the ends of every stretch along each signal.

    Returns:
        indices, ascending, at most ``most``.
    """
    count = signals[0].size
    if count <= most:
        return np.arange(count)
    width = -(-count // ((most - 2) // (2 * len(signals))))
    rows = -(-count // width)
    begins = np.arange(rows) * width
    inside = [
        begins
        + extreme(np.pad(one, (0, rows * width - count), "edge").reshape(rows, width), axis=1)
        for one in signals
        for extreme in (np.argmin, np.argmax)
    ]
    at = np.sort(np.concatenate([[0], *inside, [count - 1]]).clip(max=count - 1))
    return at[np.diff(at, prepend=-1) > 0]


def lasting(signals: list[FloatArray]) -> NDArray[np.intp]:
    """Samples that draw any stretch of a record that is a tenth of it or longer, found once.

    They are the extremes of ten times as many stretches as a screen shows, so that each of what is
    drawn (:func:`envelope`, :func:`outline`) still has its own.

    Returns:
        indices, ascending.
    """
    return outline(signals, 10 * MOST_POINTS * len(signals))


def stretches(time: FloatArray, inside: NDArray[np.bool_], most: int = 400) -> FloatArray:
    """Instants (K, 2) [s] at which stretches of samples begin and end, at most ``most`` of them.

    Where there are more, those with the shortest pauses between them are taken together: a screen
    shows no more. A stretch reaches half a step beyond its first and last sample.
    """
    edges = np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    if not begins.size:
        return np.zeros((0, 2))
    between = 0.5 * (time[1:] + time[:-1])
    first = np.concatenate([[time[0]], between])[begins]
    last = np.concatenate([between, [time[-1]]])[ends]
    if begins.size > most:
        pauses = first[1:] - last[:-1]
        kept = np.sort(np.argsort(pauses)[-(most - 1) :])
        first = np.concatenate([first[:1], first[1:][kept]])
        last = np.concatenate([last[:-1][kept], last[-1:]])
    return np.column_stack([first, last])
