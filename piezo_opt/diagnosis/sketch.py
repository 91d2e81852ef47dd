"""A long record is searched on its worst fifth, then confirmed on all of it.

What a set of effects costs grows with the samples, how many sets have to be asked does not. The
fifth on which the base model errs most holds what happens once; a fifth that is long itself is
searched on *its* worst fifth first. Sets that lead on a part are fitted to everything. Where one
leaves only noise, no more than its details are asked there; else the search goes on on everything,
and finds what is slower than the part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from piezo_opt.diagnosis.book import Start
from piezo_opt.diagnosis.frontier import Effort
from piezo_opt.diagnosis.noise import is_noise
from piezo_opt.diagnosis.refit import SETTLED, refit
from piezo_opt.diagnosis.search import search
from piezo_opt.effects.base import Effect
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit
from piezo_opt.identification.stretch import stretch
from piezo_opt.measurement import FloatArray, Measurement
from piezo_opt.simulation import INITIAL
from piezo_opt.stopping import TimeLimit

LONG = 100_000
"""Samples from which a record is long: a fifth is as many as a base model is chosen on."""
_PARTS = 5
"""Parts of which the worst one is searched. With a cost that grows with the samples, parts of parts
take a quarter of what all of them would, and each is long enough to show what is five times slower
than the last one could."""


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
    """The best sets of the worst parts, and where they begin on the whole records.

    Args:
        fit: the base model on the whole records.
        offered, withheld, effort, least, threads, tell: as of a search.
        seconds: after which the best so far is given; None for no limit.

    Returns:
        nothing where no record is long, or the base model leaves only noise.

    Raises:
        KeyboardInterrupt: it was ended otherwise.
    """
    if not any(_long(record) for record in fit.records) or is_noise(fit, least):
        return []
    short = [
        _worst(record, fit.residual(i)) if _long(record) else record
        for i, record in enumerate(fit.records)
    ]
    kept = {k: v for k, v in fit.values.items() if not k.startswith(INITIAL)}
    try:
        foot = refit(fit.question.with_records(short), kept, SETTLED)
    except NO_FIT:
        return []
    samples = sum(len(record) for record in short)
    limit = TimeLimit(seconds)
    heard = limit.checking(tell)

    def told(sentence: str) -> None:
        heard(f"on {samples} samples: {sentence}")

    def begun() -> list[Start]:
        half = None if seconds is None else 0.5 * seconds
        return sketched(foot, offered, withheld, effort, least, threads, heard, half)

    found = search(foot, offered, withheld, effort, least, threads, told, limit, begun)
    if found.interrupted and not limit.passed:
        raise KeyboardInterrupt
    book = found.book
    best = [members for members in book.level if members != book.base]
    begin = [
        {k: v for k, v in book[members].values.items() if not k.startswith(INITIAL)}
        for members in best
    ]
    # What a part says of time constants longer than itself may lead a fit of everything astray.
    fresh = [Start(members, None) for members in best]
    return [*fresh, *(Start(members, values) for members, values in zip(best, begin, strict=True))]


def _long(record: Measurement) -> bool:
    return len(record) > LONG and record.period is None


def _worst(record: Measurement, residual: FloatArray) -> Measurement:
    """The part with the largest sum of squares of a residual on the counted samples."""
    square = np.zeros(len(record))
    square[record.counted] = residual**2
    total = np.concatenate([[0.0], np.cumsum(square)])
    samples = len(record) // _PARTS
    begin = int(np.argmax(total[samples:] - total[:-samples]))
    return stretch(record, slice(begin, begin + samples))
