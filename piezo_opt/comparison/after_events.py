"""How the error moves after a step or a reversal of the drive, in logarithmic time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, final

import numpy as np
import scipy

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.over_time import ALARM
from piezo_opt.comparison.turns import rests
from piezo_opt.comparison.words import brief
from piezo_opt.measurement import FloatArray

_PROMINENT: Final = 0.5
"""Share of the rms that the means must range over to be worth a sentence."""
_A_DECADE: Final = 5


@final
@dataclass(frozen=True, eq=False)
class AfterEvents:
    """Mean error against the time since the drive last came to rest, or turned.

    Attributes:
        kind: ``"step"`` when the drive rests after its movements, else ``"reversal"``.
        events: number of events.
        since: (B,) time since the event, geometric mean of the bin [s].
        mean: (B,) mean of the error in the direction of the event's movement [m]: positive
            where the measurement has gone further than the model.
        uncertainty: (B,) standard error of that mean for a white error [m].
        sentence: what stands out; empty when nothing does.
    """

    kind: Literal["step", "reversal"]
    events: int
    since: FloatArray
    mean: FloatArray
    uncertainty: FloatArray
    sentence: str


def after_events(misfit: Misfit) -> AfterEvents:
    """Average the counted errors over all events, in five bins a decade of time.

    Where at least a fifth of the record are rests after a movement, those are the events, and
    only the rest itself is averaged; else each turn of the drive, up to the next.
    """
    record = misfit.record
    first, last, sign = rests(record.drive)
    kind: Literal["step", "reversal"] = "step"
    if np.sum(last - first) < 0.2 * len(record):
        kind = "reversal"
        turns = misfit.turns
        first, last = turns[1:-1] + 1, turns[2:] + 1
        sign = np.sign(record.drive[turns[2:]] - record.drive[turns[1:-1]])
    error = np.where(record.counted, record.position - misfit.modelled, np.nan)
    since: list[FloatArray] = []
    signed: list[FloatArray] = []
    used = 0
    for a, b, direction in zip(first, last, sign, strict=True):
        # The drive reached its new level at a (or turned at a - 1); before that nothing happened.
        origin = record.time[a] if kind == "step" else record.time[a - 1]
        part = slice(a + 1, b) if kind == "step" else slice(a, b)
        usable = np.isfinite(error[part])
        if usable.any():
            used += 1
            since.append(record.time[part][usable] - origin)
            signed.append(direction * error[part][usable])
    if not used:
        nothing = np.zeros(0)
        return AfterEvents(kind, 0, nothing, nothing, nothing, "")
    return _binned(misfit, kind, used, np.concatenate(since), np.concatenate(signed))


def _binned(
    misfit: Misfit,
    kind: Literal["step", "reversal"],
    events: int,
    since: FloatArray,
    signed: FloatArray,
) -> AfterEvents:
    decades = np.log10(since)
    low = float(decades.min())
    which = np.floor((decades - low) * _A_DECADE + 1e-9).astype(np.int64)
    count = np.bincount(which).astype(np.float64)
    kept = count >= 2
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (np.bincount(which, signed) / count)[kept]
        centre = 10.0 ** (np.bincount(which, decades) / count)[kept]
    uncertainty = misfit.rms / np.sqrt(count[kept])
    sentence = _sentence(misfit, kind, centre, mean, uncertainty)
    return AfterEvents(kind, events, centre, mean, uncertainty, sentence)


def _sentence(
    misfit: Misfit,
    kind: Literal["step", "reversal"],
    since: FloatArray,
    mean: FloatArray,
    uncertainty: FloatArray,
) -> str:
    if mean.size < 3 or misfit.rms == 0.0:
        return ""
    # A constant is not a matter of time; the mean over the bins is removed before the test.
    weight = 1.0 / uncertainty**2
    moved = mean - np.sum(weight * mean) / np.sum(weight)
    chance = float(scipy.special.chdtrc(mean.size - 1, np.sum(weight * moved**2)))
    sure = uncertainty <= 0.5 * misfit.rms
    if chance > ALARM or not sure.any() or float(np.ptp(mean[sure])) < _PROMINENT * misfit.rms:
        return ""
    known = np.flatnonzero(sure)
    ends = known[np.argmin(mean[known])], known[np.argmax(mean[known])]
    early, late = int(min(ends)), int(max(ends))
    unit = misfit.record.position_unit
    event = "a step" if kind == "step" else "a reversal"
    text = (
        f"{brief(float(since[early]), 's')} after {event} of the drive the measurement is "
        f"{_ahead(float(mean[early]), unit)} the model, "
        f"{brief(float(since[late]), 's')} after it {_ahead(float(mean[late]), unit)} it"
    )
    lag = np.log10(since[sure])
    if lag.size >= 4 and np.ptp(lag) >= 0.7:
        slope, level = np.polyfit(lag, mean[sure], 1, w=np.sqrt(weight[sure]))
        left = mean[sure] - (slope * lag + level)
        centred = mean[sure] - np.average(mean[sure], weights=weight[sure])
        share = 1.0 - float(np.sum(weight[sure] * left**2) / np.sum(weight[sure] * centred**2))
        if share > 0.9:
            text += f": {brief(abs(float(slope)), unit)} a decade of time"
    return text[0].upper() + text[1:] + "."


def _ahead(value: float, unit: str) -> str:
    return f"{brief(abs(value), unit)} {'ahead of' if value > 0 else 'behind'}"
