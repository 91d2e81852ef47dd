"""What to play after a ladder: one experiment for each group, and those for what was hidden."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from piezo_opt.diagnosis.advice.experiment import Advice
from piezo_opt.diagnosis.advice.revealing import reveal
from piezo_opt.diagnosis.advice.splitting import advise
from piezo_opt.diagnosis.scores import effective_samples
from piezo_opt.diagnosis.told import Step
from piezo_opt.effects.base import Effect
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit


def experiments(
    fit: Fit,
    steps: Sequence[Step],
    final: Fit,
    offered: Sequence[Effect],
    noise: float,
    *,
    hidden: bool,
    threads: int = 2,
) -> tuple[tuple[Advice, ...], tuple[str, ...]]:
    """What to play after a ladder: for every group it could not split, and for what it hid.

    Args:
        fit: the baseline.
        steps: accepted effects with their groups.
        final: the fit at the top.
        offered: every effect that was considered.
        noise: root mean square of the reading's noise [m].
        hidden: whether to look for drives that show what the records could not.
        threads: drives that are judged at a time.

    Returns:
        the experiments, and the names that no candidate drive would show (or split).
    """
    # Slow noise carries less news a sample; what is left unexplained counts as noise.
    news = effective_samples(final.residuals) / final.residuals.size
    level = max(noise, final.rms) / float(np.sqrt(news))
    found: list[Advice] = []
    before = fit
    for step in steps:
        group = [e for n in step.group for e in offered if e.name == n]
        if len(step.group) > 1:
            # Without a size or a drive there is no experiment; the group is named anyway.
            with suppress(PiezoOptError):
                found.append(advise(before, group, level, threads=threads))
        before = step.fit
    if not hidden:
        return tuple(found), ()
    shown, never = reveal(final, offered, level, threads=threads)
    return (*found, *shown), never
