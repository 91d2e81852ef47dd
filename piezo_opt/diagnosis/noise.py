"""The noise floor: what no model can explain, from periods, or from the record itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.following import follows_drive
from piezo_opt.diagnosis.slow_noise import correlation
from piezo_opt.identification import Fit
from piezo_opt.measurement import Measurement
from piezo_opt.measurement.spectra import density, frequencies
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

REMEMBERED: Final = 8
"""Fits of which the rules that ask in turn are answered once."""
_ABOVE = 1.1
"""Residual over the level at the highest frequencies up to which that is the floor."""
_BY_CHANCE = 0.01
"""Corrected p-value above which what is left does not follow the drive."""


@final
@dataclass(frozen=True)
class NoiseFloor:
    """Root mean square of the reading's noise [m], where it comes from, and how sure.

    Attributes:
        rms: estimate [m].
        low, high: 95 % range [m].
        measured: whether it comes from repetitions (else from the residual: from the record's
            highest frequencies, a lower bound, unless all of it is first-order noise).
        sentence: the same in words.
    """

    rms: float
    low: float
    high: float
    measured: bool
    sentence: str


@lru_cache(maxsize=REMEMBERED)
def noise_floor(fit: Fit) -> NoiseFloor:
    """Noise of the reading over the records of a fit.

    From the differences between periods where every record has at least two; from those of the
    residual where every drive plays the same again (what the model explains of a reading that still
    settles is no noise; the first repetition is left out where there are three). Otherwise from the
    spectrum of the residual in the upper third of the frequencies, taken as the level of white
    noise, and never below what rounding alone leaves (step / sqrt(12)). A residual whose whole
    spectrum is that of first-order noise (see :mod:`slow_noise`), and which does not follow the
    drive, is the floor itself.

    Source: Pintelon & Schoukens (2012), System Identification, 2nd ed., sec. 2.5.
    """
    records = fit.records
    if all(r.periods >= 2 for r in records):
        values = [r.noise_from_periods() for r in records]
        rms = float(np.sqrt(np.mean(np.square(values))))
        dof = sum((r.periods - 1) * len(r) / max(1, r.periods) for r in records)
        spread = 1.96 / np.sqrt(2.0 * max(1.0, dof))
        return NoiseFloor(
            rms,
            rms * (1.0 - min(0.9, spread)),
            rms * (1.0 + spread),
            True,
            f"The noise floor is {show(rms, 'm')} rms, from the differences between periods.",
        )
    repeated = [_repeated(fit.residual(i), r) for i, r in enumerate(records)]
    measured = [r for r in repeated if r is not None]
    if len(measured) == len(records):
        return _measured(measured)
    power, count, rounding = 0.0, 0.0, 0.0
    samples = 0
    for index, record in enumerate(records):
        level, bins = _high_frequency(fit.residual(index), record)
        n = int(record.counted.sum())
        power += n * level
        count += bins
        samples += n
        step = record.resolution
        rounding += n * (step**2 / 12.0 if step is not None else 0.0)
    rms = float(np.sqrt(max(power, rounding) / samples))
    slow = correlations(fit) if fit.rms > _ABOVE * rms else None
    if slow is not None and follows_drive(fit, BasePoint(fit), fit.rms)[0] > _BY_CHANCE:
        return _slow(fit, slow)
    spread = 1.96 / np.sqrt(2.0 * max(2.0, count))
    rounded = rounding > power
    sentence = (
        f"The noise floor is {show(rms, 'm')} rms, "
        + (
            "what the rounding of the reading alone leaves"
            if rounded
            else "from the highest frequencies of the record; slower noise would come on top"
        )
        + ". Repeat the drive at least twice to measure it."
    )
    return NoiseFloor(rms, rms * (1.0 - min(0.9, spread)), rms * (1.0 + spread), False, sentence)


def _repeated(residual: FloatArray, record: Measurement) -> FloatArray | None:
    """(repetitions, samples of one) of a residual whose drive plays the same again; else None."""
    samples = record.repetition
    if samples is None or residual.size < 2 * samples:
        return None
    whole = residual.size // samples
    parts = residual[residual.size - whole * samples :].reshape(whole, samples)
    return parts[1:] if whole > 2 else parts


def _measured(parts: list[FloatArray]) -> NoiseFloor:
    """The floor from what differs between repetitions of the drive."""
    freedom = sum((p.shape[0] - 1) * p.shape[1] for p in parts)
    squares = sum(float(np.sum((p - p.mean(axis=0)) ** 2)) for p in parts)
    rms = float(np.sqrt(squares / freedom))
    spread = min(0.9, 1.96 / np.sqrt(2.0 * freedom))
    times = " and ".join(str(p.shape[0]) for p in parts)
    return NoiseFloor(
        rms, rms * (1.0 - spread), rms * (1.0 + spread), True,
        f"The noise floor is {show(rms, 'm')} rms, from what differs between {times} repetitions "
        "of the drive.",
    )  # fmt: skip


def correlations(fit: Fit) -> list[float] | None:
    """Correlations from sample to sample where all residuals are first-order noise; else None."""
    if not all(record.uniform for record in fit.records):
        return None
    found = [
        correlation(fit.residual(index), rounded=record.resolution is not None)
        for index, record in enumerate(fit.records)
    ]
    sure = [rho for rho in found if rho is not None]
    return sure if len(sure) == len(found) else None


def _slow(fit: Fit, correlations: list[float]) -> NoiseFloor:
    """The floor of a fit that leaves first-order noise and nothing else."""
    # Squares of first-order noise are correlated by rho^2.
    independent = sum(
        fit.residual(index).size * (1.0 - rho**2) / (1.0 + rho**2)
        for index, rho in enumerate(correlations)
    )
    spread = min(0.9, 1.96 / np.sqrt(2.0 * max(2.0, independent)))
    shown = " and ".join(f"{rho:.2f}" for rho in correlations)
    return NoiseFloor(
        fit.rms, fit.rms * (1.0 - spread), fit.rms * (1.0 + spread), False,
        f"The noise floor is {show(fit.rms, 'm')} rms: all that is left looks like noise "
        f"correlated from sample to sample by {shown}. Repeat the drive at least twice to "
        "measure it.",
    )  # fmt: skip


def _high_frequency(residual: FloatArray, record: Measurement) -> tuple[float, float]:
    """Variance of white noise at the level of the upper third of the spectrum, and its bins."""
    n = residual.size
    if n < 64 or not record.uniform:
        # Second differences forget everything that is smooth from sample to sample.
        second = np.diff(residual, 2)
        mad = float(np.median(np.abs(second - np.median(second))))
        return (1.4826 * mad) ** 2 / 6.0, n / 3.0
    length = min(n, max(64, n // 8))
    top = density(residual, rate=1.0, length=length)[frequencies(length, 1.0) > 1.0 / 3.0]
    # The median of a spectrum averaged over few segments lies below its mean.
    segments = max(1.0, 2.0 * n / length - 1.0)
    bias = (1.0 - 1.0 / (9.0 * segments)) ** 3
    return float(np.median(top)) / bias * 0.5, top.size * segments / 2.0
