"""Runs of readings where the sensor lost its target, or stopped."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.findings.finding import Finding, Weight, where
from piezo_opt.measurement.findings.left_out import leaving_out
from piezo_opt.measurement.findings.usual import MOST_CALM, drive_is_calm, large_moves
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_JUMP, _VISIBLE, _FEW = 5.0, 0.01, 0.02
"""A run is entered or left by so many times the largest usual step, and by so much of the range; no
more than two in a hundred steps are such."""
_LONGEST, _SHARE = 64, 0.01
"""Samples of the longest run, and its share of a long record."""
_MOST = 0.1
"""Share of the record in such runs beyond which they are what the actuator does."""
_FROZEN, _MOVES = 8, 0.05
"""A sensor that stopped gives so many equal readings while the drive goes so much of its range."""
_BEFORE = 20
"""Samples before a run in which the drive must not have moved more than usual."""


def dropouts(record: Measurement) -> Iterator[Finding]:
    """Readings at one level that the reading jumps to and back from, or held and then caught up.

    Two or more readings at a level that the reading jumps to and back from while the drive does
    what it usually does. Or equal ones that stand still while the drive moves on in one direction,
    and then a jump to where it should be: a backlash stands still, too, but has nothing to catch
    up.
    """
    y = record.position
    jumps, usual = large_moves(y, _JUMP, _FEW)
    jumps = jumps[np.abs(np.diff(y)[jumps]) > _VISIBLE * np.ptp(y)]
    longest = max(_LONGEST, int(_SHARE * y.size))
    lost: list[tuple[int, int]] = []
    caught: list[tuple[int, int]] = []
    k = 0
    while k < jumps.size:
        first = int(jumps[k]) + 1
        last = int(jumps[k + 1]) + 1 if k + 1 < jumps.size else y.size
        run = y[first:last]
        if 2 <= run.size <= longest and np.ptp(run) <= 2.0 * usual and _back(y, first, last, usual):
            lost.append((first, last))
            k += 2
            continue
        if (begin := _stood(y, record.drive, first)) is not None:
            caught.append((begin, first))
        k += 1
    yield from _told(record, "dropout", tuple(lost))
    yield from _told(record, "frozen", tuple(caught))


def _back(y: FloatArray, first: int, last: int, usual: float) -> bool:
    """Whether a run is left as it was entered, to where the reading should be by then."""
    if last >= y.size:
        return False
    into, out = float(y[first] - y[first - 1]), float(y[last] - y[last - 1])
    gone = abs(float(y[last] - y[first - 1]))
    size = min(abs(into), abs(out))
    return into * out < 0.0 and gone < 0.5 * size + usual * (last - first)


def _stood(y: FloatArray, drive: FloatArray, end: int) -> int | None:
    """Where the reading began to stand still before ``end``, while the drive went on."""
    begin = end - 1
    while begin > 0 and y[begin - 1] == y[end - 1]:
        begin -= 1
    moves = np.diff(drive[begin:end])
    if end - begin < _FROZEN or begin == 0:
        return None
    on = abs(float(drive[end - 1] - drive[begin])) > _MOVES * np.ptp(drive)
    # The first of equal readings is right.
    return begin + 1 if on and (moves * moves[0] >= 0.0).all() else None


def _told(record: Measurement, name: str, found: tuple[tuple[int, int], ...]) -> Iterator[Finding]:
    many = sum(j - i for i, j in found)
    if not found or many > _MOST * len(record):
        return
    if float(drive_is_calm(record.drive, found, before=_BEFORE).mean()) < MOST_CALM:
        return
    levels = sorted({f"{show(float(record.position[i]), record.position_unit)}" for i, _ in found})
    told = ", ".join(levels[:3]) + (" ..." if len(levels) > 3 else "")
    what = (
        f"{many} readings at a level ({told}) that the reading jumps to and back from: a lost "
        "target or a rail"
        if name == "dropout"
        else f"{many} equal readings ({told}) while the drive goes on, and then a jump to where "
        "the reading should be: the sensor stopped"
    )
    yield Finding(
        name,
        Weight.MENDED,
        f"{what}, at {where(record.time, found)}.",
        f"They are left out and the drive there is kept; --accept {name} counts them.",
        found,
        leaving_out(found),
    )
