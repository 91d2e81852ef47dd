"""The plainest search for a missing effect: refit the model with each one, and take the best."""

from __future__ import annotations

from collections.abc import Iterator

from piezo_opt.comparison.metrics import bic
from piezo_opt.effects.base import Effect
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Ending, Fit, Identification, solve


def refit_everything(fit: Fit, *, withhold: tuple[str, ...] = ()) -> str:
    """Name of the one effect whose refit has the least Bayesian criterion; "" where none has.

    Every form of every optional effect of the catalogue is refitted twice, from the base's values
    and from a fresh start. What makes no sense with this model and record is passed over.

    Args:
        fit: of the base.
        withhold: catalogue names that are not tried.
    """
    best, least = "", _criterion(fit)
    for effect in _forms(withhold):
        for start in (fit, None):
            try:
                question = Identification(fit.model + effect, fit.records)
                richer = solve(question, start=start, statistics=False)
            except PiezoOptError:
                continue
            if richer.outcome.ending is Ending.INTERRUPTED:
                raise KeyboardInterrupt
            if _criterion(richer) < least:
                best, least = effect.name, _criterion(richer)
    return best


def _forms(withhold: tuple[str, ...]) -> Iterator[Effect]:
    for name, kind in CATALOGUE.items():
        if name not in withhold and kind().gate is not None:
            for options in kind.variants:
                yield kind(**options)


def _criterion(fit: Fit) -> float:
    return bic(fit.residuals, len(fit.names))
