"""Scores of all absent effects at a fit, on whatever ground they need."""

from __future__ import annotations

from collections.abc import Sequence

from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.colour import Colour
from piezo_opt.diagnosis.richer import on_mechanics, on_spring
from piezo_opt.diagnosis.scores import Suspect, Unscored, score
from piezo_opt.effects.base import Effect, Place
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit


def scored(
    fit: Fit, candidates: Sequence[Effect], threads: int, colour: Colour
) -> tuple[tuple[Suspect, ...], tuple[Unscored, ...]]:
    """Scores of all absent candidates.

    At a quasi-static fit forces are scored on a spring without mass, and what else needs motion
    with the mechanics that the fit may have left out.
    """
    absent = [e for e in candidates if e.name not in fit.model]
    stiff = moving = None
    if fit.model.quasi_static:
        stiff = on_spring(fit)
        if any("motion" in e.requires and e.place is not Place.MOTION for e in absent):
            moving = on_mechanics(fit)
    grounds = [None if ground is None else _point(ground, colour) for ground in (stiff, moving)]
    return score(BasePoint(fit, colour=colour), absent, threads, *grounds)


def _point(fit: Fit, colour: Colour) -> BasePoint | None:
    """The point of a fit; None where it cannot be simulated again, at the edge of stability."""
    try:
        point = BasePoint(fit, colour=colour)
        return point if point.substeps else None
    except NO_FIT:
        return None


def at_foot(
    fit: Fit, candidates: Sequence[Effect], threads: int
) -> tuple[tuple[Suspect, ...], tuple[Unscored, ...]]:
    """Scores at a fit alone, with its noise taken as white."""
    left = [e for e in candidates if e.name not in fit.model]
    return score(BasePoint(fit), left, threads)
