"""What the sampling of a record hides, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.between import Between
from piezo_opt.measurement.clock import Clock
from piezo_opt.measurement.spectra import without_line
from piezo_opt.units import show


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


def aliasing_remarks(clock: Clock, drive: FloatArray, between: Between) -> Iterator[str]:
    """On what is faster than the samples."""
    if between is Between.BANDLIMITED:
        return
    spread = float(np.ptp(drive))
    jumps = np.flatnonzero(np.abs(np.diff(drive)) > 0.3 * spread) + 1
    if jumps.size >= 3:
        dwell = float(np.median(np.diff(jumps)))
        # Dwelling between the jumps is what makes it a step drive and not a fast sine, or the
        # fast end of a sweep.
        among = np.abs(np.diff(drive[jumps[0] - 1 : jumps[-1] + 1]))
        if dwell <= 8 and np.mean(among <= 0.02 * spread) >= 0.25:
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
    power = np.abs(np.fft.rfft(without_line(even) * np.hanning(even.size))) ** 2
    total = float(power.sum())
    return float(power[power.size // 2 + 1 :].sum()) / total if total > 0 else 0.0
