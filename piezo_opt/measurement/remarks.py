"""What the sampling of a record hides, and which readings look wrong, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import signal

from piezo_opt.measurement.arrays import FloatArray, IndexArray
from piezo_opt.measurement.between import Between
from piezo_opt.measurement.clock import Clock
from piezo_opt.units import show

_LONE, _FAR, _VISIBLE = 5.0, 10.0, 0.01
"""A reading stands alone where it is off what is around it by so many times what all but one in a
thousand are, by so many times the median third difference, and by so large a share of the range."""
_AROUND = 3
"""Samples on either side in which the drive must not move more than it usually does."""


def gap_remarks(clock: Clock) -> Iterator[str]:
    """On what happened while nothing was sampled."""
    if clock.gaps:
        before, after = max(clock.gaps, key=lambda gap: gap[1] - gap[0])
        yield (
            f"{len(clock.gaps)} gap{'s' if len(clock.gaps) > 1 else ''} in time, the widest "
            f"from {before:g} s to {after:g} s: the drive inside is not known."
        )
    elif not clock.uniform:
        steps = np.diff(clock.time)
        yield (
            f"Sampled unevenly, {show(float(steps.min()), 's')} to "
            f"{show(float(steps.max()), 's')} apart."
        )


def resolution_remarks(reading: FloatArray, step: float | None, unit: str) -> Iterator[str]:
    """On what rounding the reading to steps [unit] leaves."""
    spread = float(np.ptp(reading))
    if step is not None and step > 2e-3 * spread:
        yield (
            f"The reading comes in steps of {show(step, unit)}, "
            f"{100 * step / spread:.1f} % of its range: rounding alone leaves about "
            f"{show(step / np.sqrt(12.0), unit)} rms."
        )


def outlier_remarks(
    time: FloatArray, drive: FloatArray, reading: FloatArray, unit: str
) -> Iterator[str]:
    """On readings that neither what comes before nor what comes after leads to."""
    alone = lone_readings(drive, reading)
    if alone.size:
        first = int(alone[0])
        many = alone.size > 1
        yield (
            f"{alone.size} reading{'s' if many else ''} stand{'' if many else 's'} alone, far off "
            f"what comes before and after, {'the first ' if many else ''}at {time[first]:g} s "
            f"(sample {first + 1}, {show(float(reading[first]), unit)}): a fit bends to reach "
            f"{'them' if many else 'it'}; leave {'those rows' if many else 'that row'} out, or "
            "take a robust loss."
        )


def lone_readings(drive: FloatArray, reading: FloatArray) -> IndexArray:
    """Indices of readings that stand alone while the drive moves no more than usual.

    Every reading but two at either end is compared with the cubic through the two before and the
    two after it. A jump and a peak are off that as well, but there the neighbours differ, or rise
    with it. A record that rings or steps has many such readings, and none stands alone.
    """
    n = reading.size
    if n < 16:
        return np.zeros(0, dtype=np.intp)
    off = np.zeros(n)
    near, beyond = reading[1:-3] + reading[3:-1], reading[:-4] + reading[4:]
    off[2:-2] = np.abs(reading[2:-2] - (4.0 * near - beyond) / 6.0)
    unlike = np.maximum(np.abs(reading[3:-1] - reading[1:-3]), np.abs(near - beyond))
    off[2:-2][unlike > 0.5 * off[2:-2]] = 0.0
    most = max(3, n // 1000)
    order = np.argsort(-off)
    least = max(
        _LONE * float(off[order[most]]), _FAR * float(np.median(np.abs(np.diff(reading, 3)))),
        _VISIBLE * float(np.ptp(reading)),
    )  # fmt: skip
    moves = np.abs(np.diff(drive))
    usual = 2.0 * float(np.quantile(moves, 0.9))
    found = [
        k for k in order[:most]
        if off[k] > least and moves[max(0, k - _AROUND) : k + _AROUND].max() <= usual
    ]  # fmt: skip
    return np.sort(np.array(found, dtype=np.intp))


def aliasing_remarks(clock: Clock, drive: FloatArray, between: Between) -> Iterator[str]:
    """On what is faster than the samples."""
    if between is Between.BANDLIMITED:
        return
    spread = float(np.ptp(drive))
    jumps = np.flatnonzero(np.abs(np.diff(drive)) > 0.3 * spread) + 1
    if jumps.size >= 3:
        dwell = float(np.median(np.diff(jumps)))
        # Dwelling between the jumps is what makes it a step drive and not a fast sine.
        flat = np.count_nonzero(np.abs(np.diff(drive)) <= 0.02 * spread)
        if dwell <= 8 and flat >= 0.25 * drive.size:
            yield (
                f"The drive steps every {dwell:g} samples, so the answer to a step is not "
                f"sampled: nothing above {show(clock.rate / 2, 'Hz')} can be identified, and a "
                "resonance fitted to this record is an artefact of its sampling."
            )
            return
    fraction = _fast_fraction(clock, drive)
    if fraction > 0.2:
        yield (
            f"{100 * fraction:.0f} % of the drive's power lies above a quarter of the sampling "
            f"rate ({show(clock.rate / 4, 'Hz')}): aliasing is likely and what happens between "
            "samples is not known; sample faster."
        )


def _fast_fraction(clock: Clock, drive: FloatArray) -> float:
    """Share of the drive's power above half the Nyquist frequency, on its longest even stretch."""
    steps = np.diff(clock.time)
    breaks = np.flatnonzero(np.abs(steps - clock.step) > 0.05 * clock.step)
    bounds = np.concatenate([[-1], breaks, [steps.size]])
    longest = int(np.argmax(np.diff(bounds)))
    even = drive[bounds[longest] + 1 : bounds[longest + 1] + 1]
    if even.size < 16:
        return 0.0
    power = np.abs(np.fft.rfft(signal.detrend(even) * np.hanning(even.size))) ** 2
    total = float(power.sum())
    return float(power[power.size // 2 + 1 :].sum()) / total if total > 0 else 0.0
