"""Marks that an instrument writes where it has no reading: 9.9e37, -9999."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import BoolArray, FloatArray
from piezo_opt.measurement.findings.finding import Finding, Weight, answers, stretches_of, where
from piezo_opt.measurement.findings.left_out import leaving_out
from piezo_opt.measurement.findings.usual import MOST_CALM, drive_is_calm
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_APART = 20.0
"""A mark is so many times further from the median than the furthest reading: twenty full scales."""
_MOST = 0.1
"""Share of a record that may be marks."""


def overloads(record: Measurement) -> Iterator[Finding]:
    """Values so far off all others that they are no values.

    The distances from the median are sorted; marks begin where one is twenty times the one before.
    A pulse is no mark: there the drive is far off, too.
    """
    counted = record.counted
    marks = _far(record.position, counted)
    pulses = _far(record.drive, np.ones(len(record), dtype=np.bool_))
    found = stretches_of(marks & ~pulses)
    if found and float(drive_is_calm(record.drive, found).mean()) >= MOST_CALM:
        worst = float(record.position[marks][0])
        many = int(marks.sum())
        yield Finding(
            "overload",
            Weight.MENDED,
            f"{many} reading{'s are' if many > 1 else ' is'} far beyond all others "
            f"({worst:.3g} {record.position_unit}): marks of an overload or of a missing value, at "
            f"{where(record.time, found)}.",
            "They are left out and the drive there is kept; --accept overload counts them.",
            found,
            leaving_out(found),
        )
    driven = stretches_of(pulses & ~marks)
    # A short pulse of a drive is answered by the reading, a mark is not.
    if driven and _unanswered(record.position, driven):
        worst = float(record.drive[pulses][0])
        yield Finding(
            "drive_overload",
            Weight.REFUSED,
            f"The drive is {show(worst, record.drive_unit)} at {where(record.time, driven)}, far "
            "beyond all others, and the reading does not follow: marks of an overload or of a "
            "missing value.",
            answers(
                "drive_overload",
                "puts a straight line in their place and leaves those readings out",
            ),
            driven,
            leaving_out(driven, drive=True),
        )


def _far(values: FloatArray, judged: BoolArray) -> BoolArray:
    """(N,) mask of the values beyond the first wide gap in the distances from the median."""
    middle = float(np.median(values[judged]))
    off = np.abs(values - middle)
    counted = off[judged]
    most = int((1.0 - _MOST) * counted.size)
    order = np.sort(np.partition(counted, most)[most:])
    near, next_ = order[:-1], order[1:]
    apart = np.flatnonzero((near > 0.0) & (next_ > _APART * near))
    if apart.size == 0:
        return np.zeros(values.size, dtype=np.bool_)
    return np.asarray(off > _APART / 2.0 * near[apart[0]]) & judged


def _unanswered(reading: FloatArray, stretches: tuple[tuple[int, int], ...]) -> bool:
    """Whether the reading moves at the marks no more than it does elsewhere."""
    near = np.zeros(reading.size, dtype=np.bool_)
    for a, b in stretches:
        near[max(0, a - 1) : b + 10] = True
    moves = np.abs(np.diff(reading))
    elsewhere = ~(near[1:] | near[:-1])
    if not elsewhere.any():
        return False
    return float(moves[near[1:]].max()) <= 2.0 * float(moves[elsewhere].max())
