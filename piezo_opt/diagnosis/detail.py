"""A fit in all the detail that it pays for, one step after the other."""

from __future__ import annotations

from piezo_opt.diagnosis.refinements import plausible, refinements
from piezo_opt.diagnosis.rung import STRONG, race
from piezo_opt.identification import Fit

_ROUNDS = 4


def in_detail(fit: Fit, threads: int) -> Fit:
    """The fit with whatever detail of its effects BIC strongly wants; itself where it wants none.

    Args:
        fit: the fit.
        threads: refits that run at a time.
    """
    for _ in range(_ROUNDS):
        finer = [r for r in race(fit, refinements(fit), threads) if plausible(r)]
        best = max(finer, key=lambda r: r.delta_bic, default=None)
        if best is None or best.delta_bic < STRONG:
            break
        fit = best.fit
    return fit
