"""The whole work on a stage with several axes: responses, models, error on held-out records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.linear_models.modal import ModalModel
from piezo_opt.linear_models.modal_fit import ModalFit, fit_modes
from piezo_opt.linear_models.modal_judging import AxesError, LevelError, axes_error
from piezo_opt.linear_models.response_matrix import ResponseMatrix, response_matrix
from piezo_opt.measurement import AxesCampaign, AxesRecord

SCHEMA: Final = "piezo_opt.axes/1"
ONE_MODEL: Final = "one model, amplitude-dependent"
LINEAR_EACH: Final = "linear, one for each amplitude"
LINEAR_ALL: Final = "linear, one for all amplitudes"
_AS_GOOD: Final = 1.01
"""Error over that of the best up to which fewer modes are as good. An rms over n complex numbers is
sure to 1 / (2 sqrt(n)), one percent for n = 2500: two realisations of three axes whose error stands
in some four hundred lines around the resonances."""
_SEARCH_STEPS: Final = 10
"""Steps of each fit of a search: enough to rank numbers of modes."""


@final
@dataclass(frozen=True, eq=False)
class ModeRow:
    """One number of modes of a search, and its error on held-out realisations [1]."""

    modes: int
    error: float


@final
@dataclass(frozen=True, eq=False)
class AxesFit:
    """What was learnt of a stage with several axes.

    Attributes:
        model: fitted to all realisations; tabled over amplitude where there are several.
        judged: the same fitted without the held-out realisations; None when none were held out.
        linear: for each amplitude a linear model, without the held-out realisations.
        responses: response matrix of each amplitude, all realisations.
        errors: by kind of model, its error on held-out realisations.
        search: numbers of modes that were tried.
        records, test: all realisations, and the held-out ones.
        interrupted: whether Ctrl-C or a limit of time ended the work.
    """

    model: ModalModel
    judged: ModalModel | None
    linear: tuple[ModalModel, ...]
    responses: tuple[ResponseMatrix, ...]
    errors: tuple[tuple[str, AxesError], ...]
    search: tuple[ModeRow, ...]
    records: AxesCampaign
    test: AxesCampaign | None
    interrupted: bool

    def __str__(self) -> str:
        pieces = [str(one) for one in self.responses]
        if self.search:
            pieces.append(
                "modes  held-out error %\n"
                + "\n".join(f"{row.modes:>5}  {100.0 * row.error:>16.2f}" for row in self.search)
            )
        pieces.append(str(self.model))
        if self.test is not None:
            pieces.append(f"Simulation of {len(self.test)} realisations that no fit has seen:")
        pieces += [f"{label}\n{error}" for label, error in self.errors]
        if self.interrupted:
            pieces.append("Interrupted: this is the best so far.")
        return "\n\n".join(pieces)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units; ``model`` is read by `piezo-opt axes simulate`."""
        return {
            "schema": SCHEMA,
            "model": self.model.to_dict(),
            "held_out": [] if self.test is None else [one.name for one in self.test],
            "errors": [{"model": label, **error.to_dict()} for label, error in self.errors],
            "search": [{"modes": row.modes, "error": row.error} for row in self.search],
            "distortion_and_noise": [
                {
                    "amplitude": one.amplitude.tolist(),
                    "distortion": one.shares()[0].tolist(),
                    "noise": one.shares()[1].tolist(),
                }
                for one in self.responses
            ],
            "interrupted": self.interrupted,
        }


def identify_axes(
    records: AxesRecord | Iterable[AxesRecord] | AxesCampaign,
    modes: int | Sequence[int] = tuple(range(2, 26, 2)),
    *,
    real: int = 2,
    held_out: int = 2,
    compare: bool = True,
    progress: Callable[[str], None] | None = None,
) -> AxesFit:
    """Response matrices, one model of all axes and amplitudes, and its honest error.

    The last ``held_out`` realisations of every amplitude are kept from a first fit and simulated
    with it; then the model that is handed back is fitted to all of them, from there. Several
    numbers of modes are tried on the middle amplitude, each judged on its held-out realisations;
    the smallest whose error is within one percent of the best is taken, and once two in a row are
    no better the others are not tried.

    Args:
        records: realisations with a period, of one or several amplitudes.
        modes: number of modes, or those to try, rising.
        real: real poles, for creep and amplifier.
        held_out: realisations of every amplitude that judge; 0 for none.
        compare: whether linear models are fitted and judged beside it.
        progress: told what goes on. Ctrl-C gives the best so far.

    Raises:
        InputError: as `fit_modes` and `AxesCampaign.parted`.
    """
    campaign = AxesCampaign.of(records)
    train, test = campaign, None
    if held_out:
        train, test = campaign.parted(held_out)
    responses = tuple(response_matrix(one) for one in campaign.levels)
    counts = (modes,) if isinstance(modes, int) else tuple(modes)
    if not counts:
        raise InputError("no number of modes is given: give one, 18, or several")
    search: tuple[ModeRow, ...] = ()
    count = counts[0]
    if len(counts) > 1:
        if test is None:
            raise InputError(
                f"{len(counts)} numbers of modes are judged on held-out realisations, and none are "
                "held out: give one number, or hold some out"
            )
        middle = len(responses) // 2
        own, kept = train.levels[middle], test.levels[middle]
        search, best, whole = _searched(own, kept, counts, real, progress)
        if not whole:
            error = axes_error(best, kept)
            return AxesFit(
                best, best, (best,), (responses[middle],), ((LINEAR_EACH, error),), search,
                campaign, kept, interrupted=True,
            )  # fmt: skip
        count = best.modes
    label = ONE_MODEL if len(responses) > 1 else LINEAR_EACH
    first = fit_modes(train, count, real=real, progress=_named(progress, label))
    found = AxesFit(
        first.model, None if test is None else first.model, (), responses, (), search, campaign,
        test, first.interrupted,
    )  # fmt: skip
    if test is None:
        return found
    found = replace(found, errors=((label, axes_error(first.model, test)),))
    if first.interrupted:
        return found
    try:
        last = fit_modes(
            campaign, count, real=real, start=first.model, progress=_named(progress, "all records")
        )
    except KeyboardInterrupt:
        return replace(found, interrupted=True)
    found = replace(found, model=last.model, interrupted=last.interrupted)
    if found.interrupted or not compare or len(responses) == 1:
        return found
    try:
        return _compared(found, train, test, count, real, progress)
    except KeyboardInterrupt:
        return replace(found, interrupted=True)


def _compared(
    found: AxesFit,
    train: AxesCampaign,
    test: AxesCampaign,
    count: int,
    real: int,
    progress: Callable[[str], None] | None,
) -> AxesFit:
    """With linear models beside it."""
    fits: list[ModalFit] = []
    levels: list[LevelError] = []
    for own, kept in zip(train.levels, test.levels, strict=True):
        fits.append(fit_modes(own, count, real=real, progress=_named(progress, LINEAR_EACH)))
        if fits[-1].interrupted:
            return replace(found, interrupted=True)
        levels += axes_error(fits[-1].model, kept).levels
    each = AxesError(tuple(levels), found.errors[0][1].units)
    pooled = fit_modes(train, count, real=real, pooled=True, progress=_named(progress, LINEAR_ALL))
    if pooled.interrupted:
        return replace(found, interrupted=True)
    together = axes_error(pooled.model, test)
    return replace(
        found, linear=tuple(one.model for one in fits),
        errors=(*found.errors, (LINEAR_EACH, each), (LINEAR_ALL, together)),
    )  # fmt: skip


def _searched(
    own: AxesCampaign,
    kept: AxesCampaign,
    counts: Sequence[int],
    real: int,
    progress: Callable[[str], None] | None,
) -> tuple[tuple[ModeRow, ...], ModalModel, bool]:
    """Numbers of modes with their errors, the model of the one to take, whether all were tried.

    Raises:
        KeyboardInterrupt: before there was one.
    """
    rows: list[ModeRow] = []
    models: list[ModalModel] = []
    whole = True
    for count in counts:
        try:
            fit = fit_modes(
                own, count, real=real, iterations=_SEARCH_STEPS, progress=_named(progress, "search")
            )
        except KeyboardInterrupt:
            if not rows:
                raise
            whole = False
            break
        models.append(fit.model)
        rows.append(ModeRow(count, axes_error(fit.model, kept).levels[0].mean))
        if fit.interrupted:
            whole = False
            break
        errors = np.array([row.error for row in rows])
        if len(rows) > 2 and bool(np.all(_AS_GOOD * errors[-2:] > errors[:-2].min())):
            break
    least = min(row.error for row in rows)
    chosen = next(k for k, row in enumerate(rows) if row.error <= _AS_GOOD * least)
    return tuple(rows), models[chosen], whole


def _named(progress: Callable[[str], None] | None, what: str) -> Callable[[str], None] | None:
    return None if progress is None else lambda sentence: progress(f"{what}: {sentence}")
