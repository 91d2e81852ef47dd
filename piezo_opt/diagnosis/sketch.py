"""A long record is searched on the stretch where the base model errs most, then on all of it.

What a set of effects costs grows with the samples, how many sets have to be asked does not. The
best sets of the stretch are where the search of everything begins: what happens once is in the
stretch, because the base model errs there, and what is slower than the stretch is left to the
search of everything.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from piezo_opt.diagnosis.book import Start
from piezo_opt.diagnosis.refit import refit
from piezo_opt.diagnosis.search import Effort, search
from piezo_opt.effects.base import Effect
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit
from piezo_opt.identification.stretch import stretch
from piezo_opt.measurement import FloatArray, Measurement
from piezo_opt.simulation import INITIAL
from piezo_opt.stopping import TimeLimit

STRETCH = 20_000
"""Samples of a stretch: as many as are enough to choose a base model."""
LONG = 5
"""Stretches from which a record is long: a search asks some hundred fits, and each of the few that
the whole record is then asked takes so many times as long."""
_STEPS = 40
"""Iterations of the base model's fit on the stretch, which begins at that of everything."""


def is_long(fit: Fit) -> bool:
    """Whether any record is worth being searched on a stretch first."""
    return any(_long(record) for record in fit.records)


def sketched(
    fit: Fit,
    offered: Sequence[Effect],
    withheld: Sequence[str],
    effort: Effort,
    least: float,
    threads: int,
    tell: Callable[[str], None],
    seconds: float | None,
) -> list[Start]:
    """The best sets of the stretches, and where they begin on the whole records.

    Args:
        fit: the base model on the whole records.
        offered, withheld, effort, least, threads, tell: as of a search.
        seconds: after which the best so far is given; None for no limit.

    Raises:
        KeyboardInterrupt: it was ended otherwise.
    """
    short = [
        _worst(record, fit.residual(i)) if _long(record) else record
        for i, record in enumerate(fit.records)
    ]
    kept = {k: v for k, v in fit.values.items() if not k.startswith(INITIAL)}
    try:
        foot = refit(fit.question.with_records(short), kept, _STEPS)
    except NO_FIT:
        return []
    limit = TimeLimit(seconds)

    def told(sentence: str) -> None:
        tell(f"on a stretch: {sentence}")

    found = search(foot, offered, withheld, effort, least, threads, limit.checking(told), limit)
    if found.interrupted and not limit.passed:
        raise KeyboardInterrupt
    return [
        Start(
            members,
            {k: v for k, v in found.book[members].values.items() if not k.startswith(INITIAL)},
        )
        for members in found.book.leading[: effort.beam]
    ]  # fmt: skip


def _long(record: Measurement) -> bool:
    return len(record) > LONG * STRETCH and record.period is None


def _worst(record: Measurement, residual: FloatArray) -> Measurement:
    """The stretch with the largest sum of squares of a residual on the counted samples."""
    square = np.zeros(len(record))
    square[record.counted] = residual**2
    total = np.concatenate([[0.0], np.cumsum(square)])
    begin = int(np.argmax(total[STRETCH:] - total[:-STRETCH]))
    return stretch(record, slice(begin, begin + STRETCH))
