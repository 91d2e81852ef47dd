"""Who is refitted: suspects by their scores at a fit, and all beside a base that is not bent."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from piezo_opt.diagnosis.base_point import BasePoint, base_point
from piezo_opt.diagnosis.contest import beside
from piezo_opt.diagnosis.refinements import moved, stiffened, with_base_details
from piezo_opt.diagnosis.rung import Rung, Trial
from piezo_opt.diagnosis.scores import Suspect, Unscored, score
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.effects.base import Effect, Place
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit, Identification
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.starting import joint_start, starting_values
from piezo_opt.values import Values

_TELLING = 0.02
"""Score worth a refit where a suspect need not be significant."""
_UNSURE = 4
"""Suspects that are refitted beside the significant ones."""
_KIN = 0.6
"""Cosine from which a suspect is refitted because it looks like a likely one."""
_SHORTLIST = 6


def scored(
    fit: Fit, candidates: Sequence[Effect], threads: int
) -> tuple[tuple[Suspect, ...], tuple[Unscored, ...]]:
    """Scores of all absent candidates.

    At a quasi-static fit forces are scored on a spring without mass, and what else needs motion
    with the mechanics that the fit may have left out.
    """
    absent = [e for e in candidates if e.name not in fit.model]
    stiff = moving = None
    if fit.model.quasi_static:
        stiff = stiffened(fit)
        if any("motion" in e.requires and e.place is not Place.MOTION for e in absent):
            moving = moved(fit)
    grounds = [None if ground is None else base_point(ground) for ground in (stiff, moving)]
    return score(BasePoint(fit), absent, threads, *grounds)


def shortlist(likely: Sequence[Suspect], everybody: Sequence[Suspect]) -> list[Suspect]:
    """The best few, each by what it would explain, and their look-alikes.

    A derivative at the null is a poor picture of a pure lag; whoever looks like a likely suspect
    is refitted too.
    """
    top = likely[0].score
    names = [*dict.fromkeys(s.name for s in likely if s.score > 0.1 * top)][:_SHORTLIST]
    short = [s for s in likely if s.score > 0.1 * top and s.name in names]
    for suspect in everybody:
        if len({s.name for s in short}) >= _SHORTLIST + 2:
            break
        listed = suspect.wrong_side or any(s.name == suspect.name for s in short)
        alike = any(abs(float(suspect.direction @ s.direction)) > _KIN for s in short[:3])
        if alike and not listed:
            short.append(suspect)
    return short


def further(suspects: Sequence[Suspect], short: Sequence[Suspect]) -> list[Suspect]:
    """The likeliest few that are not on the list yet."""
    listed = {s.name for s in short}
    left = {s.name: s for s in reversed(suspects) if s.name not in listed}
    likeliest = sorted(left.values(), key=lambda s: -s.score)
    return [s for s in likeliest if s.score > _TELLING][:_UNSURE]


def entrants(
    fit: Fit,
    given: Identification,
    suspects: Sequence[Suspect],
    threads: int,
    known: Sequence[Rung] = (),
) -> tuple[list[Trial], list[Rung]]:
    """Every suspect beside a base model that has not been bent to do without it.

    A fit that lacks an effect may have run far away to imitate it (a loop so wide that it drifts):
    scored from there the effect looks like nothing, and refitted from there it stays so. Here each
    begins where a first fit would, at its own one-step size.

    Args:
        fit: the fit below.
        given: the question at the foot of the ladder.
        suspects: who may enter; each form of an effect is one.
        threads: searches for a start that run at a time.
        known: refits of entrants of before, of which none is begun twice.

    Returns:
        who begins, and who has begun before.
    """
    before = {rung.fit.model: rung for rung in known}
    entering = [beside(fit, given, suspect)[0] for suspect in suspects]
    begun = [
        replace(rung, trial=replace(trial, start=rung.trial.start)) for trial in entering
        if (rung := before.get(trial.question.model)) is not None
    ]  # fmt: skip
    trials = [trial for trial in entering if trial.question.model not in before]
    # What they stand beside is the same, but for mechanics that some of them need.
    bases: dict[tuple[str, ...], Values | None] = {}
    for trial in trials:
        model = trial.question.model
        below = model.without(model.names[-1])
        if below.names not in bases:
            bases[below.names] = _begun(trial.question.with_model(below), None)

    def placed(trial: Trial) -> Trial | None:
        base = bases[trial.question.model.names[:-1]]
        start = None if base is None else _begun(trial.question, base)
        return None if start is None else replace(trial, start=start)

    with Pool(max_workers=threads) as pool:
        return [trial for trial in pool.map(placed, trials) if trial is not None], begun


def jointly(
    fit: Fit, given: Identification, suspects: Sequence[Suspect], threads: int
) -> list[Trial]:
    """Every suspect from where its shapes and the width of the loop have been searched together.

    With all details free: an effect that is strong and of another shape than the usual one may
    have no place near what it is without them. The search takes some six times as long as the
    start of an entrant.

    Args:
        fit: the fit below.
        given: the question at the foot of the ladder.
        suspects: who may enter; each form of an effect is one.
        threads: searches for a start that run at a time.
    """

    def placed(suspect: Suspect) -> Trial | None:
        trial = beside(fit, given, suspect)[0]
        name = trial.question.model.names[-1]
        with suppress(*NO_FIT):
            best = joint_start(trial.question, name)
            return with_base_details(replace(trial, start=best), name)
        return None

    with Pool(max_workers=threads) as pool:
        return [trial for trial in pool.map(placed, suspects) if trial is not None]


def _begun(question: Identification, base: Values | None) -> Values | None:
    """Where a first fit would begin; None where nothing there can be simulated."""
    try:
        return starting_values(question, Monitor(()), base)
    except NO_FIT:
        return None
