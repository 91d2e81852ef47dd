"""A reading that jumps to another level, and a drive that does not: two records in one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray, IndexArray
from piezo_opt.measurement.checks import FEWEST_SAMPLES
from piezo_opt.measurement.findings.finding import Finding, Weight, answers, where
from piezo_opt.measurement.findings.usual import sharpness
from piezo_opt.measurement.outliers import lone_readings
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_FAR, _VISIBLE, _MOST = 10.0, 0.05, 3
"""A jump is so many times the largest move but those next to it, and so much of the range; more
than three are what the actuator does."""
_BEFORE, _MOVED = 20, 0.2
"""Samples in which the drive must not have jumped by so much of what the jump would need."""


def jumps(record: Measurement) -> Iterator[Finding]:
    """Steps of the reading that stand out, stay, and have no cause in the drive.

    A step is what a move differs from the moves next to it. It stays when the reading less its
    straight line over the drive is shifted by half the step or more, from the quarter of the record
    before to the quarter after.
    """
    u = record.drive
    y = _without(lone_readings(u, record.position), record.position)
    n = y.size
    if n < 8 * FEWEST_SAMPLES or np.ptp(y) == 0.0:
        return
    step = np.diff(y)
    sharp, driven = sharpness(y), sharpness(u)
    rest = sharp.copy()
    found: list[int] = []
    for _ in range(_MOST):
        k = int(np.argmax(rest))
        rest[max(0, k - 2) : k + 3] = 0.0
        found.append(k)
        if sharp[found].min() > _FAR * rest.max():
            break
    else:
        return
    slope, level = np.polyfit(u, y, 1)
    off = y - slope * u - level
    gain = float(np.ptp(y) / np.ptp(u))
    for k in found:
        size = abs(float(step[k]))
        way = float(driven[max(0, k - _BEFORE) : k + 2].max())
        reach = max(FEWEST_SAMPLES, n // 4)
        before, after = off[max(0, k + 1 - reach) : k + 1], off[k + 1 : k + 1 + reach]
        if min(before.size, after.size) < FEWEST_SAMPLES:
            return
        shifted = (float(np.mean(after)) - float(np.mean(before))) * np.sign(step[k])
        caused = gain * way > _MOVED * size
        if sharp[k] < _VISIBLE * np.ptp(y) or caused or shifted < 0.5 * size:
            return
    places = tuple((k + 1, k + 2) for k in sorted(found))
    # Instants, not samples: another remedy may move the samples before this one is applied.
    cuts = [None, *(float(record.time[a]) for a, _ in places), None]

    def mend(old: Measurement) -> tuple[Measurement, ...]:
        return tuple(
            old.slice(a, b).rename(f"{old.name} {i + 1}") for i, (a, b) in enumerate(pairwise(cuts))
        )

    sizes = ", ".join(show(float(step[k]), record.position_unit) for k in sorted(found))
    yield Finding(
        "jump",
        Weight.REFUSED,
        f"The reading jumps by {sizes} and stays there, and the drive does not, at "
        f"{where(record.time, places)}: two records in one, or a knock.",
        answers("jump", f"reads it as {len(places) + 1} records, each with its own offset"),
        places,
        mend,
    )


def _without(alone: IndexArray, reading: FloatArray) -> FloatArray:
    """The reading (N,) with straight lines in the place of what stands alone."""
    if not alone.size:
        return reading
    kept = np.delete(np.arange(reading.size), alone)
    return np.interp(np.arange(reading.size), kept, reading[kept])
