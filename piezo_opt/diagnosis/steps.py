"""Accepted effects, and what becomes of a ladder of them when one is shaped, dropped or renamed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.held_out import rms
from piezo_opt.diagnosis.rung import Rung
from piezo_opt.effects.base import Effect
from piezo_opt.identification import Fit

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Step:
    """One accepted effect.

    Attributes:
        name: the effect.
        effect: the object that was added, in the form that the ladder ended with.
        group: names that this record cannot tell it from, itself included.
        rms_before, rms_after: error on the fitted records [m].
        held_out_before, held_out_after: error on the held-out record [m], None without one.
        delta_bic: by how much BIC fell.
        p_value: of its score, corrected for the search.
        fit: the fit with it.
    """

    name: str
    effect: Effect
    group: tuple[str, ...]
    rms_before: float
    rms_after: float
    held_out_before: float | None
    held_out_after: float | None
    delta_bic: float
    p_value: float
    fit: Fit


def freedom(fit: Fit, name: str) -> int:
    """How many parameters of one effect a fit has estimated."""
    return sum(k.startswith(f"{name}.") for k in fit.names)


def step_to(
    fit: Fit,
    error: FloatArray | None,
    taken: Rung,
    after: FloatArray | None,
    group: tuple[str, ...],
) -> Step:
    """The step from a fit to the rung that was taken."""
    assert taken.suspect is not None
    return Step(
        name=taken.suspect.name,
        effect=taken.suspect.effect,
        group=group,
        rms_before=fit.rms,
        rms_after=taken.fit.rms,
        held_out_before=rms(error),
        held_out_after=rms(after),
        delta_bic=taken.delta_bic,
        p_value=taken.suspect.p_value,
        fit=taken.fit,
    )


def shaped_further(
    steps: Sequence[Step], same: int, taken: Rung, after: FloatArray | None
) -> list[Step]:
    """The same physics in a shape that one member alone does not have: no step of its own.

    What that wins is won at the top of the ladder, whichever step it shapes.
    """
    assert taken.suspect is not None
    shaped = list(steps)
    shaped[same] = replace(
        shaped[same],
        group=tuple(dict.fromkeys((*shaped[same].group, taken.suspect.name))),
        delta_bic=shaped[same].delta_bic + taken.delta_bic,
    )
    return [*shaped[:-1], topped(shaped[-1], taken.fit, rms(after))]


def topped(step: Step, fit: Fit, held_out: float | None) -> Step:
    """The last step, which ends at this fit and its held-out error [m]."""
    return replace(step, rms_after=fit.rms, held_out_after=held_out, fit=fit)


def without(steps: Sequence[Step], spare: Step) -> list[Step]:
    """The ladder without one step: the next begins where that one began."""
    place = steps.index(spare)
    after = [
        replace(
            following,
            rms_before=spare.rms_before,
            held_out_before=spare.held_out_before,
            delta_bic=following.delta_bic + spare.delta_bic,
        )
        for following in steps[place + 1 : place + 2]
    ]
    return [*steps[:place], *after, *steps[place + 2 :]]


def renamed(steps: Sequence[Step], step: Step, name: str, fit: Fit) -> list[Step]:
    """What was taken for a step's shape does alone what both did: the step bears its name."""
    group = (name, *(other for other in step.group if other != name))
    other = replace(step, name=name, effect=fit.model[name], group=group)
    return [other if one is step else one for one in steps]
