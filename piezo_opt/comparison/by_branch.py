"""Where on the drive-displacement plane the error lives, loading and unloading apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
import scipy

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.over_time import ALARM
from piezo_opt.comparison.words import brief
from piezo_opt.measurement import FloatArray

_PROMINENT: Final = 0.4
"""Share of the rms that a mean must reach to be worth a sentence."""


@final
@dataclass(frozen=True, eq=False)
class ByBranch:
    """The error on the rising (loading) and falling (unloading) branch, by drive.

    Attributes:
        edges: (B+1,) edges of the drive bins [V].
        loading_mean, unloading_mean: (B,) mean error in each bin [m]; NaN in an empty one.
        loading_rms, unloading_rms: (B,) rms error in each bin [m]; NaN in an empty one.
        loading_count, unloading_count: (B,) samples in each bin.
        sentence: what stands out; empty when nothing does.
    """

    edges: FloatArray
    loading_mean: FloatArray
    unloading_mean: FloatArray
    loading_rms: FloatArray
    unloading_rms: FloatArray
    loading_count: FloatArray
    unloading_count: FloatArray
    sentence: str


def by_branch(misfit: Misfit) -> ByBranch:
    """Sort the counted samples by branch and by drive, in up to 12 bins a branch.

    The branch comes from the whole record, so that the first counted sample has one too.
    """
    bins = int(np.clip(misfit.error.size // 10, 2, 12))
    edges = np.linspace(misfit.drive.min(), misfit.drive.max(), bins + 1)
    which = np.clip(np.searchsorted(edges, misfit.drive, side="right") - 1, 0, bins - 1)
    counts, means, sizes = {}, {}, {}
    for sign in (1.0, -1.0):
        mine = misfit.branch == sign
        weight = np.bincount(which[mine], minlength=bins).astype(np.float64)
        with np.errstate(invalid="ignore", divide="ignore"):
            total = np.bincount(which[mine], misfit.error[mine], minlength=bins)
            square = np.bincount(which[mine], misfit.error[mine] ** 2, minlength=bins)
            means[sign], sizes[sign] = total / weight, np.sqrt(square / weight)
        counts[sign] = weight
    sentences = [
        text
        for sign, name in ((1.0, "loading"), (-1.0, "unloading"))
        if (text := _sentence(misfit, name, edges, means[sign], counts[sign]))
    ]
    return ByBranch(
        edges=edges,
        loading_mean=means[1.0],
        unloading_mean=means[-1.0],
        loading_rms=sizes[1.0],
        unloading_rms=sizes[-1.0],
        loading_count=counts[1.0],
        unloading_count=counts[-1.0],
        sentence=" ".join(sentences),
    )


def _sentence(
    misfit: Misfit, name: str, edges: FloatArray, mean: FloatArray, count: FloatArray
) -> str:
    """The stretch of neighbouring bins with the largest mean, if chance cannot explain it."""
    size = misfit.rms
    if size == 0.0:
        return ""
    score = np.where(count > 0, np.nan_to_num(mean), 0.0) * np.sqrt(count) / size
    limit = -float(scipy.special.ndtri(ALARM / (4 * mean.size)))
    strong = (np.abs(score) > limit) & (np.abs(np.nan_to_num(mean)) > _PROMINENT * size)
    if not strong.any():
        return ""
    peak = int(np.argmax(np.where(strong, np.abs(score), 0.0)))
    sign = np.sign(mean[peak])
    first = last = peak
    while first > 0 and strong[first - 1] and np.sign(mean[first - 1]) == sign:
        first -= 1
    while last < mean.size - 1 and strong[last + 1] and np.sign(mean[last + 1]) == sign:
        last += 1
    part = slice(first, last + 1)
    average = float(np.sum(mean[part] * count[part]) / np.sum(count[part]))
    return (
        f"On the {name} branch the measurement reads "
        f"{brief(abs(average), misfit.record.position_unit)} "
        f"{'higher' if average > 0 else 'lower'} than the model between "
        f"{_tidy(edges[first], edges)} and {_tidy(edges[last + 1], edges)} "
        f"{misfit.record.drive_unit}."
    )


def _tidy(value: float, edges: FloatArray) -> str:
    """A drive rounded to a thousandth of its range: 62.5, not 62.49999."""
    step = 10.0 ** np.floor(np.log10(float(np.ptp(edges)) / 100.0))
    return f"{np.round(value / step) * step + 0.0:.6g}"
