"""A clock that jitters about an even one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.findings.finding import Finding, Weight
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_LARGEST = 0.5
"""Share of a step by which a stamp may be off: beyond it samples are missing, or the clock is
something else."""
_ROUGHER = 1.2
"""Third differences on the clock as stamped, over those on the even one, beyond which the stamps
are less true."""


def jitter(record: Measurement) -> Iterator[Finding]:
    """Stamps within half a step of an even clock, where nothing is missing.

    Whether the stamps or the samples are even is read off the signals: on the true clock they are
    smoother. Where noise hides it, the even clock is taken: instruments sample evenly, and
    programs stamp what they are given.
    """
    clock = record.clock
    if clock.uniform:
        return
    even = even_clock(record.time)
    step = float(even[1] - even[0])
    off = record.time - even
    if np.abs(off).max() > _LARGEST * step:
        return
    stamped = [_roughness(record.time, s) for s in (record.drive, record.position)]
    evened = [_roughness(even, s) for s in (record.drive, record.position)]
    ratios = [a / b if b > 0.0 else 1.0 for a, b in zip(stamped, evened, strict=True)]
    told = (
        f"The clock jitters by {show(float(np.std(off)), 's')} rms about steps of "
        f"{show(step, 's')}, and no sample is missing"
    )
    if min(ratios) < 1.0 / _ROUGHER and max(ratios) < _ROUGHER:
        yield Finding(
            "jitter",
            Weight.REMARK,
            f"{told}; the signals are smoother on the stamps than on even steps, so the samples "
            "themselves were taken unevenly.",
        )
        return

    def mend(old: Measurement) -> tuple[Measurement, ...]:
        return (old.with_(time=even_clock(old.time)),)

    yield Finding(
        "jitter",
        Weight.MENDED,
        f"{told}: the stamps jitter, not the samples.",
        "An even clock of the same step is taken; --accept jitter keeps the stamps.",
        (),
        mend,
    )


def even_clock(time: FloatArray) -> FloatArray:
    """The even clock (N,) closest to a jittering one, from the same first step.

    The step is that of the line through all stamps, rounded to what its own error leaves: a clock
    of 1 ms becomes 1 ms, not 1.0000003 ms.
    """
    n = time.size
    index = np.arange(n) - (n - 1) / 2.0
    step = float(index @ time / (index @ index))
    middle = float(time.mean())
    spread = float(np.std(time - middle - step * index))
    error = spread / np.sqrt(float(index @ index))
    for digits in range(1, 16):
        round_ = float(f"{step:.{digits - 1}e}")
        if abs(round_ - step) <= 3.0 * error:
            step = round_
            break
    first = middle - step * (n - 1) / 2.0
    # The start is rounded to the same: stamps that begin at 0 begin at 0 again.
    loose = 3.0 * spread / np.sqrt(n)
    if abs(round(first / step) * step - first) <= loose:
        first = round(first / step) * step
    return np.asarray(first + step * np.arange(n), dtype=np.float64)


def _roughness(time: FloatArray, values: FloatArray) -> float:
    """Median of |third divided differences| on a clock: small where a signal is smooth on it."""
    difference = values
    for order in (1, 2, 3):
        difference = np.diff(difference) / (time[order:] - time[:-order]) * order
    return float(np.median(np.abs(difference)))
