"""Data that decides: what is held out, and whether a richer model really predicts it better."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.scores import long_run_variance
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit, Identification
from piezo_opt.measurement import Measurement
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

SHARE = 0.3
"""Last part of a lone record that is held out and simulated through."""
_TENTH = 0.9**2
_UNSEEN = 0.1**2
FOREIGN, _LEVEL = 3.0, 1.02**2
"""Held-out error over the fitted one from which it is of something else, and how far it may rise
then."""
FEWEST = 300
"""Counted samples below which a record is too short to be parted."""


@final
@dataclass(frozen=True, eq=False)
class HeldOut:
    """What to fit on, what to judge on, and how that was chosen.

    Attributes:
        question: the question on the part that is fitted.
        record: the record judged on; None where nothing could be held out.
        sentence: the choice in words.
    """

    question: Identification
    record: Measurement | None
    sentence: str
    # Each rule of the ladder asks about the same few fits; forgotten with the fit.
    _errors: WeakKeyDictionary[Fit, FloatArray | None] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )


def hold_out(question: Identification, test: Measurement | None) -> HeldOut:
    """Choose what is held out: the given record, else the last part of a lone one, else nothing."""
    records = question.campaign.records
    if test is not None:
        return HeldOut(question, test, f"Judged on the record '{test.name}', which is not fitted.")
    if len(records) > 1:
        *fitted, last = records
        return HeldOut(
            question.with_records(tuple(fitted)),
            last,
            f"Judged on the record '{last.name}', held out from the fit.",
        )
    record = records[0]
    if record.period is not None or int(record.counted.sum()) < FEWEST:
        why = "periodic" if record.period is not None else "too short to be parted"
        return HeldOut(
            question, None, f"The record is {why}: nothing is held out, BIC alone decides."
        )
    at = float(record.time[int((1.0 - SHARE) * len(record))])
    train, held = record.split(at=at)
    return HeldOut(
        question.with_records(train),
        held,
        f"Judged on the last {100 * SHARE:.0f} % of the record, simulated through from the fit.",
    )


def error_on(fit: Fit, record: Measurement | None) -> FloatArray | None:
    """Counted errors of a fit on a record [m]; None without a record."""
    if record is None:
        return None
    return np.asarray((record.position - fit.predict(record, refine=False))[record.counted])


def elsewhere(fit: Fit, held: HeldOut) -> FloatArray | None:
    """Held-out errors; without end where the record cannot be simulated with this fit."""
    if held.record is None:
        return None
    if fit not in held._errors:
        try:
            error = error_on(fit, held.record)
        except (PiezoOptError, ArithmeticError):
            error = None
        finite = error is not None and np.isfinite(error).all()
        held._errors[fit] = error if finite else np.array([np.inf])
    return held._errors[fit]


def rms(error: FloatArray | None) -> float | None:
    """Root mean square, None for None."""
    return None if error is None else float(np.sqrt(np.mean(error**2)))


def worded(error: float | None) -> str:
    """A held-out error [m] in words; nothing where nothing is held out."""
    if error is None:
        return ""
    return show(error, "m") if math.isfinite(error) else "not finite"


def agrees(before: FloatArray | None, after: FloatArray | None, fitted: float = np.inf) -> bool:
    """Whether the held-out error fell by a tenth, or less but beyond chance (one-sided, 2.5 %).

    With nothing held out there is nothing to disagree; neither is there where the held-out
    record cannot see the change (it moves the prediction by less than a tenth of the error), or
    shows above all what the fitted one cannot (its error is several times the fitted one's, and
    hardly changes).

        z = mean(e0^2 - e1^2) / sqrt(long-run variance / N) > 1.96

    Args:
        before: held-out errors without the change [m].
        after: the same with it.
        fitted: error on the fitted records without the change [m].

    Source: Diebold & Mariano (1995), J. Business & Economic Statistics 13(3), 253-263.
    """
    if before is None or after is None:
        return True
    if not np.isfinite(after).all():
        return False
    power = float(np.mean(before**2))
    if float(np.mean((after - before) ** 2)) < _UNSEEN * power:
        return True
    foreign = power > (FOREIGN * fitted) ** 2
    if foreign and float(np.mean(after**2)) < _LEVEL * power:
        return True
    gain = before**2 - after**2
    mean = float(gain.mean())
    if mean <= 0:
        return False
    if float(np.mean(after**2)) < _TENTH * float(np.mean(before**2)):
        return True
    variance = long_run_variance(gain - mean)
    return mean > 1.96 * float(np.sqrt(variance / gain.size))
