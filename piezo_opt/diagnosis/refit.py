"""A fit good enough to compare sets by."""

from __future__ import annotations

from collections.abc import Mapping

from piezo_opt.identification import (
    Ending,
    Fit,
    Identification,
    LevenbergMarquardt,
    SingleShooting,
    solve,
)
from piezo_opt.simulation import TOLERANCE
from piezo_opt.values import Values

CLOSE = 1e-5
"""Decrease of the cost in one iteration at which a refit ends: with ten thousand samples a tenth
of what one number more costs (ln N) in the criterion."""
SETTLED = 80
"""Iterations after which a fit that is built upon has converged or never will."""


def refit(
    question: Identification, start: Mapping[str, float], iterations: int, *, mend: bool = True,
    most: float = float("inf"), tolerance: float = TOLERANCE,
) -> Fit:  # fmt: skip
    """Fit from given values, without statistics.

    Args:
        question: the question.
        start: where it begins; may hold numbers of another model, which are left alone.
        iterations: most steps taken.
        mend: whether sub-steps that have become too coarse are chosen anew.
        most: sub-steps a sample beyond which there is no such fit.
        tolerance: error of the scheme as a share of the reading's range, with which it begins.

    Raises:
        KeyboardInterrupt: somebody interrupted it; the search ends, not only this fit.
        ModelError, InputError, ArithmeticError: there is no such fit.
    """
    solver = LevenbergMarquardt(iterations=iterations, tolerance=CLOSE)
    coarse = SingleShooting(
        refine=False, mend=float("inf") if mend else 0.0, most=most, tolerance=tolerance
    )
    begun = Values(start)
    fit = solve(question, start=begun, solver=solver, transcription=coarse, statistics=False)
    if fit.outcome.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    return fit
