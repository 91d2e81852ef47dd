"""A fit good enough to compare sets by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import final

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
FIRST, ROUNDS = 5, 4
"""Iterations of the first round of a race, and rounds after it; each one doubles the iterations."""
SETTLED = FIRST * 2**ROUNDS
"""Iterations after which a fit that is built upon has converged or never will."""


@final
class Halted(KeyboardInterrupt):
    """A refit was interrupted, and the search with it; ``fit`` is the best so far."""

    def __init__(self, fit: Fit) -> None:
        super().__init__()
        self.fit = fit


def refit(
    question: Identification, start: Mapping[str, float], iterations: int, *, mend: bool = True,
    most: float = float("inf"), tolerance: float = TOLERANCE,
    check: Callable[[], None] | None = None,
) -> Fit:  # fmt: skip
    """Fit from given values, without statistics.

    Args:
        question: the question.
        start: where it begins; may hold numbers of another model, which are left alone.
        iterations: most steps taken.
        mend: whether sub-steps that have become too coarse are chosen anew.
        most: sub-steps a sample beyond which there is no such fit.
        tolerance: error of the scheme as a share of the reading's range, with which it begins.
        check: called at each iteration; interrupts the fit where its time is over.

    Raises:
        Halted: it was interrupted; the search ends, not only this fit.
        ModelError, InputError, ArithmeticError: there is no such fit.
    """
    solver = LevenbergMarquardt(iterations=iterations, tolerance=CLOSE)
    coarse = SingleShooting(
        refine=False, mend=float("inf") if mend else 0.0, most=most, tolerance=tolerance
    )
    begun = Values(start)
    fit = solve(
        question, start=begun, solver=solver, transcription=coarse, statistics=False,
        progress=None if check is None else lambda _: check(),
    )  # fmt: skip
    if fit.outcome.ending is Ending.INTERRUPTED:
        raise Halted(fit)
    return fit
