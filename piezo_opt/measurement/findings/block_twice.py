"""A block of samples that is written twice: a buffer that was read before it was filled."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import BoolArray, FloatArray
from piezo_opt.measurement.checks import FEWEST_SAMPLES
from piezo_opt.measurement.findings.finding import Finding, Weight, answers, stretches_of, where

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_SHORTEST, _MOST = 32, 0.5
"""Samples that must repeat in a row; a record of which half repeats is periodic and computed."""


def blocks_twice(record: Measurement) -> Iterator[Finding]:
    """Drive and reading repeat to the last digit, for 32 samples or more, what they were before.

    A reading without noise repeats with its drive, and a coarse one may: lags at which the
    drive goes on repeating beyond the block are not looked at, nor readings of few levels.
    """
    y, u = record.position, record.drive
    n = y.size
    if n < 4 * _SHORTEST or np.unique(y[: 20 * _SHORTEST]).size < 8 * _SHORTEST:
        return
    lag = _commonest_lag(y, u)
    if lag is None:
        return
    same = np.zeros(n, dtype=np.bool_)
    same[lag:] = (y[lag:] == y[:-lag]) & (u[lag:] == u[:-lag])
    blocks = tuple((a, b) for a, b in stretches_of(same) if b - a >= _SHORTEST)
    total = sum(b - a for a, b in blocks)
    if not blocks or total > _MOST * n or _drive_repeats(u, lag, same):
        return
    first = blocks[0]
    times = [(float(record.time[a]), float(record.time[b - 1])) for a, b in blocks]

    def mend(old: Measurement) -> tuple[Measurement, ...]:
        parts: list[tuple[float | None, float]] = []
        begin: float | None = None
        for start, stop in times:
            parts.append((begin, start))
            begin = stop + old.step / 2.0
        cut = [
            old.slice(*ends)
            for ends in (*parts, (begin, None))
            if np.count_nonzero(_inside(old.time, *ends)) >= FEWEST_SAMPLES
        ]
        return tuple(one.rename(f"{old.name} {i + 1}") for i, one in enumerate(cut))

    yield Finding(
        "block_twice",
        Weight.REFUSED,
        f"{total} samples are those {lag} samples before them, to the last digit, at "
        f"{where(record.time, blocks)}: a block that was written twice"
        f"{', right after itself' if first[1] - first[0] == lag else ''}. What was measured then "
        "is lost.",
        answers("block_twice", "cuts it out and reads what is before and after as records"),
        blocks,
        mend,
    )


def _inside(time: FloatArray, begin: float | None, end: float | None) -> BoolArray:
    low = -np.inf if begin is None else begin
    return np.asarray((time >= low) & (time < (np.inf if end is None else end)))


def _commonest_lag(y: FloatArray, u: FloatArray) -> int | None:
    """The lag at which windows of the record come again, by their hashes; None where none do."""
    width = _SHORTEST // 2
    mixed = _hashed(y, u, width)
    sorted_ = np.sort(mixed)  # many times faster than their order, and mostly enough
    if np.count_nonzero(sorted_[1:] == sorted_[:-1]) < _SHORTEST - width:
        return None
    order = np.argsort(mixed, kind="stable")
    pairs = np.flatnonzero(mixed[order][1:] == mixed[order][:-1])
    lags = order[pairs + 1] - order[pairs]
    # Neighbours with the same window are a constant stretch.
    lags = lags[lags >= width]
    if lags.size < _SHORTEST - width:
        return None
    values, counts = np.unique(lags, return_counts=True)
    return int(values[np.argmax(counts)])


def _hashed(y: FloatArray, u: FloatArray, width: int) -> np.ndarray:
    """A hash (N - width + 1,) of ``width`` samples from each one on: a sum of mixed bits."""
    with np.errstate(over="ignore"):
        bits = y.view(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        bits ^= u.view(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)
        bits ^= bits >> np.uint64(29)
        bits *= np.uint64(0xBF58476D1CE4E5B9)
        total = np.concatenate([np.zeros(1, np.uint64), np.cumsum(bits, dtype=np.uint64)])
        return np.asarray(total[width:] - total[:-width])


def _drive_repeats(u: FloatArray, lag: int, same: BoolArray) -> bool:
    """Whether the drive comes again at this lag where the reading does not, too."""
    again = np.abs(u[lag:] - u[:-lag]) <= 2e-3 * np.ptp(u)
    return bool(np.mean(again[~same[lag:]]) > 0.5)
