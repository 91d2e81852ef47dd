"""At which amplitude of the drive the error lives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
import scipy

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.over_time import ALARM
from piezo_opt.comparison.words import brief
from piezo_opt.measurement import FloatArray

_RATIO: Final = 1.6


@final
@dataclass(frozen=True, eq=False)
class ByAmplitude:
    """The error by how far the drive swings between one turn and the next.

    Attributes:
        swing: (B,) mean swing of the half cycles in each bin [V].
        rms: (B,) rms error in those half cycles [m].
        count: (B,) samples.
        sentence: what stands out; empty when nothing does.
    """

    swing: FloatArray
    rms: FloatArray
    count: FloatArray
    sentence: str


def by_amplitude(misfit: Misfit) -> ByAmplitude:
    """Sort the counted samples by the swing of their half cycle, in up to 6 bins.

    A record of one amplitude has one bin.
    """
    turns = misfit.turns
    counted = np.flatnonzero(misfit.record.counted)
    half = np.searchsorted(turns[1:-1], counted, side="left")
    swing = np.abs(np.diff(misfit.record.drive[turns]))[half]
    widest = float(swing.max())
    bins = 6
    which = np.clip((swing / widest * bins).astype(np.int64), 0, bins - 1)
    count = np.bincount(which, minlength=bins).astype(np.float64)
    kept = count >= 8
    if not kept.any():
        kept = count == count.max()
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(which, swing, minlength=bins) / count
        rms = np.sqrt(np.bincount(which, misfit.error**2, minlength=bins) / count)
    mean, rms, count = mean[kept], rms[kept], count[kept]
    return ByAmplitude(mean, rms, count, _sentence(misfit, mean, rms, count))


def _sentence(misfit: Misfit, swing: FloatArray, rms: FloatArray, count: FloatArray) -> str:
    if swing.size < 2 or swing[-1] < 1.5 * swing[0] or min(rms[0], rms[-1]) == 0.0:
        return ""
    ratio = float(rms[-1] / rms[0])
    larger, smaller = (-1, 0) if ratio > 1.0 else (0, -1)
    quotient = max(ratio, 1.0 / ratio)
    if quotient < _RATIO:
        return ""
    chance = float(scipy.special.fdtrc(count[larger], count[smaller], quotient**2))
    if 2.0 * chance > ALARM:
        return ""
    unit, drive = misfit.record.position_unit, misfit.record.drive_unit
    return (
        f"The error {'grows' if ratio > 1.0 else 'falls'} with the swing of the drive: "
        f"{brief(float(rms[0]), unit)} rms at {brief(float(swing[0]), drive)}, "
        f"{brief(float(rms[-1]), unit)} at {brief(float(swing[-1]), drive)}."
    )
