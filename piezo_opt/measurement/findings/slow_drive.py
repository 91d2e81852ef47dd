"""A drive that was logged more slowly than the reading."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray, IndexArray
from piezo_opt.measurement.between import Between
from piezo_opt.measurement.findings.finding import Finding, Weight, answers
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_BLOCKS, _LONGEST, _REGULAR = 20, 200, 0.95
"""At least so many values, each held for at most so many samples, and so many of them in step."""
_ORDINARY = 0.98
"""Share of the reading's steps that are those of the actuator."""
_EVEN = 2.0
"""The reading's way in the sample of the block in which it goes furthest, over its mean way."""


def slow_drives(record: Measurement) -> Iterator[Finding]:
    """The drive changes every m-th sample only, and the reading goes on in between.

    A converter that holds the drive makes the reading step with it: most of its way then lies in
    the samples after a change. Where the way is the same in all of them, the actuator saw a
    smooth drive.
    """
    u, y = record.drive, record.position
    changes = np.flatnonzero(np.diff(u) != 0.0) + 1
    if changes.size < _BLOCKS or not record.uniform:
        return
    held = int(np.median(np.diff(changes)))
    if not 2 <= held <= _LONGEST:
        return
    phase = int(np.bincount(changes % held).argmax())
    if np.mean(changes % held == phase) < _REGULAR:
        return
    starts = np.arange(phase, u.size, held)
    if starts[0] > 0:
        starts = np.concatenate([[0], starts])
    moves = np.diff(u[starts])
    # Each move of the drive with the reading's steps from one before it to the next one.
    first = starts[1:-1]
    if first.size < _BLOCKS:
        return
    rows = first[:, np.newaxis] + np.arange(-1, held - 1)
    rows = rows[(rows[:, 0] >= 0) & (rows[:, -1] < y.size - 1)]
    sign = np.sign(moves[: rows.shape[0]])
    # Marks, lost readings and wraps are a few steps that are larger than all others.
    step = np.diff(y)
    most = float(np.quantile(np.abs(step), _ORDINARY))
    way = (np.clip(step, -most, most)[rows] * sign[:, np.newaxis]).sum(axis=0)
    if abs(way.sum()) < 1e-12 or np.abs(way).max() > _EVEN * abs(way.mean()):
        return

    def mend(old: Measurement) -> tuple[Measurement, ...]:
        # Beyond its last own sample nobody knows the drive.
        beyond = np.arange(len(old)) > starts[-1]
        return (
            old.with_(
                drive=_between(old.time, old.drive, starts),
                between=Between.LINEAR,
                left_out=old.left_out | beyond,
            ),
        )

    yield Finding(
        "slow_drive",
        Weight.REFUSED,
        f"The drive changes every {held} samples only, and the reading moves evenly in between: "
        f"the drive was logged at {show(record.rate / held, 'Hz')}, not at "
        f"{show(record.rate, 'Hz')}.",
        answers("slow_drive", "draws the drive between its own samples"),
        (),
        mend,
    )


def _between(time: FloatArray, drive: FloatArray, starts: IndexArray) -> FloatArray:
    """The drive between its own samples: a line, or a cubic where that foretells them better.

    Judged by leaving out every second own sample.
    """
    from scipy.interpolate import CubicSpline  # slow to load, and rarely needed

    t, u = time[starts], drive[starts]
    line = np.interp(t[1:-1:2], t[::2], u[::2])
    cubic = CubicSpline(t[::2], u[::2])(t[1:-1:2])
    if np.sum((cubic - u[1:-1:2]) ** 2) < np.sum((line - u[1:-1:2]) ** 2):
        inside = np.asarray(CubicSpline(t, u)(np.minimum(time, t[-1])), dtype=np.float64)
    else:
        inside = np.interp(time, t, u)
    return inside
