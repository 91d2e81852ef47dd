"""A counter or a phase that starts again at its end: the reading falls by its whole range."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray, IndexArray
from piezo_opt.measurement.findings.finding import Finding, Weight, answers, where
from piezo_opt.measurement.findings.usual import drive_is_calm
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_NEARLY, _ALIKE, _MOST = 0.8, 0.05, 0.1
"""A wrap is a step of nearly the whole range; all are alike to so much of it; no more than a tenth
of the steps are such."""


def wraps(record: Measurement) -> Iterator[Finding]:
    """Two steps or more of nearly the whole range, without one of the drive.

    With the steps removed the reading must be smooth there and go further than one range: what a
    square wave does is neither.
    """
    y = record.position
    spread = float(np.ptp(y))
    step = np.diff(y)
    at = np.flatnonzero(np.abs(step) > _NEARLY * spread)
    if not 2 <= at.size <= _MOST * y.size or at[0] == 0 or at[-1] == step.size - 1:
        return
    # Readings far off the rest are marks, not the other end of a range.
    low, high = np.quantile(y, (0.01, 0.99))
    if high - low < _NEARLY * spread:
        return
    # What the reading would have done there anyway is what it does before and after.
    expected = (step[at - 1] + step[at + 1]) / 2.0
    sizes = np.sign(step[at]) * (step[at] - expected)
    if np.ptp(sizes) > _ALIKE * spread:
        return
    found = tuple((int(k) + 1, int(k) + 2) for k in at)
    if not drive_is_calm(record.drive, found).all():
        return
    turn = _roundest(sizes)
    whole = _unwrapped(y, at, turn)
    smooth = float(np.abs(np.diff(whole)[at]).max()) <= 3.0 * float(
        np.max(np.abs(np.delete(step, at)), initial=0.0)
    )
    if not smooth or np.ptp(whole) < 1.05 * turn:
        return

    def mend(old: Measurement) -> tuple[Measurement, ...]:
        return (old.with_(position=_unwrapped(old.position, at, turn)),)

    yield Finding(
        "wrapped",
        Weight.REFUSED,
        f"The reading jumps by {show(turn, record.position_unit)}, nearly its whole range, "
        f"{at.size} times without a step of the drive: a counter or a phase that wraps, at "
        f"{where(record.time, found)}.",
        answers("wrapped", f"adds {show(turn, record.position_unit)} at each jump"),
        found,
        mend,
    )


def _unwrapped(y: FloatArray, at: IndexArray, turn: float) -> FloatArray:
    turns = np.zeros(y.size)
    turns[at + 1] = -np.sign(y[at + 1] - y[at])
    return np.asarray(y + turn * np.cumsum(turns), dtype=np.float64)


def _roundest(sizes: FloatArray) -> float:
    """The number with the fewest digits within two standard errors of the mean of ``sizes``."""
    mean = float(np.mean(sizes))
    error = float(np.std(sizes)) / np.sqrt(sizes.size) if sizes.size > 2 else 0.002 * mean
    for digits in range(1, 12):
        round_ = float(f"{mean:.{digits - 1}e}")
        if abs(round_ - mean) <= 2.0 * error:
            return round_
    return mean
