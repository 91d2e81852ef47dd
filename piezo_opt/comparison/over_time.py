"""Where in time the error lives."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, final

import numpy as np
import scipy

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.words import brief
from piezo_opt.measurement import FloatArray

ALARM: Final = 1e-4
"""Probability with which each sentence is said of white noise."""
_RATIO: Final = 1.6


@final
@dataclass(frozen=True, eq=False)
class OverTime:
    """The error in windows of equal numbers of samples.

    Attributes:
        edges: (W+1,) instants at which the windows begin and end [s].
        rms: (W,) of the error in each window [m].
        mean: (W,) of the error in each window [m].
        sentence: what stands out; empty when nothing does.
    """

    edges: FloatArray
    rms: FloatArray
    mean: FloatArray
    sentence: str


def over_time(misfit: Misfit) -> OverTime:
    """Cut the counted samples into up to 20 windows of at least 8 samples each."""
    count = misfit.error.size
    windows = int(np.clip(count // 8, 1, 20))
    cuts = np.linspace(0, count, windows + 1).round().astype(np.int64)
    parts = [misfit.error[a:b] for a, b in pairwise(cuts)]
    rms = np.array([np.sqrt(np.mean(part**2)) for part in parts])
    mean = np.array([np.mean(part) for part in parts])
    edges = np.append(misfit.time[cuts[:-1]], misfit.time[-1])
    sentence = _sentence(misfit, edges, rms, np.diff(cuts)) if windows > 1 else ""
    return OverTime(edges, rms, mean, sentence)


def _sentence(misfit: Misfit, edges: FloatArray, rms: FloatArray, sizes: FloatArray) -> str:
    worst = int(np.argmax(rms))
    usual = float(np.sqrt(np.mean(np.delete(rms, worst) ** 2)))
    if usual == 0.0:
        return ""
    ratio = float(rms[worst]) / usual
    rest = misfit.error.size - int(sizes[worst])
    if ratio < _RATIO:
        return ""
    chance = float(scipy.special.fdtrc(sizes[worst], rest, ratio**2)) * rms.size
    if chance > ALARM:
        return ""
    unit = misfit.record.position_unit
    return (
        f"Between {edges[worst]:.4g} s and {edges[worst + 1]:.4g} s the error is "
        f"{brief(float(rms[worst]), unit)} rms, {ratio:.1f} times that of the rest of the record."
    )
