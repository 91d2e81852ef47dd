"""Before an effect is named: every contender gets its best chance.

A fit that lacks an effect is bent by it: its loop has another roundness, its mechanics seem
overdamped. From there the fit with the right effect may end in a minimum of its own, and a wrong
effect in a better one. Where the best refit leaves more than noise, the contenders are therefore
fitted again from a fresh start, with the mechanics where those were left out, and in the details
of their shapes, and only then compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.refinements import (
    base_refinements,
    explained,
    forms,
    massless,
    mechanics_trial,
    other_forms,
    plausible,
    shape_refinements,
    with_base_details,
)
from piezo_opt.diagnosis.rung import Rung, Trial, bic_gain, judged, numbers, solved
from piezo_opt.diagnosis.scores import Suspect
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.diagnosis.structure import structure
from piezo_opt.effects.base import Place
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit, Identification
from piezo_opt.identification.shapes import own
from piezo_opt.identification.starting import joint_starts

_NEAR = 1.6
"""Error over the best contender's up to which another one is still in the contest."""
_UNEQUIPPED = 2.5
"""The same of who stands without the mechanics that the best has: they may be what it lacks."""
_LEVEL = 1.1
"""The same where the best leaves but noise."""
_CLOSE = 1.25
"""The same where the best leaves no structure."""
_SECOND = 1.25
"""The same of who has a second start, and other forms."""
_FAR = 1.5
"""Error over the floor beyond which it takes more than a look to call it slow noise."""
_WORTH = 1.5
"""Error of a fresh start over the other's beyond which it is not followed."""
_OUTSIDE = 2.0
"""Error over a contender's best yet beyond which another form that has slowed down is given up."""
_HELPS = 0.97
"""Error over that of the fit below from which a contender beside other effects is one."""
_BEHIND = 1.01
"""Error over another one's from which a contender may have ended short of what it can do."""
_MOST = 4
_ITERATIONS = 30


def contest(
    fit: Fit,
    rungs: Sequence[Rung],
    given: Identification,
    threads: int = 2,
    *,
    afresh: bool = False,
) -> list[Rung]:
    """Rungs with the contenders' best fits, judged and sorted.

    Args:
        fit: the fit below.
        rungs: its refits.
        given: the question at the foot of the ladder.
        threads: contenders that are fitted at a time.
        afresh: whether they get a fresh start also where the best leaves but noise.
    """
    first = judged(fit, rungs)
    named = _best_of_each(rungs)
    if not named:
        return first
    best = named[0].fit
    closest = min(rungs, key=lambda r: r.fit.rms).fit

    def begun_there(pair: tuple[Rung, Rung]) -> Rung | None:
        return _after(fit, *pair, threads)

    def at_its_best(rung: Rung) -> Rung:
        return _shaped(fit, _founded(fit, rung, threads), threads)

    if _explained(closest) and not afresh:
        # A law with more freedom gets there first; in its details another one may be exact.
        level = [r for r in named if r.fit.rms < _LEVEL * best.rms][:_MOST]
        # Forces bring mechanics with them; whoever stands without has the same right to them.
        still = [r for r in named if massless(r.fit) and r.fit.rms < _UNEQUIPPED * best.rms]
        equipped = [] if closest.model.quasi_static else still[:_MOST]
        alone = len(level) < 2 and not equipped
        with Pool(max_workers=threads) as pool:
            asked = [] if alone else [*level, *(r for r in equipped if r not in level)]
            detailed = list(pool.map(at_its_best, asked))
            # Whoever has fewer parameters may do exactly what a law with more freedom has found.
            after = [(r, o) for o in detailed or level for r in named if _simpler(r, o)]
            caught = [r for r in pool.map(begun_there, after) if r]
            if alone and any(r.fit.rms < _LEVEL * best.rms for r in caught):
                # Whoever has been caught up with in detail is compared in its own.
                detailed += pool.map(at_its_best, level)
            detailed += caught
        return judged(fit, [*rungs, *detailed]) if detailed else first
    near = _CLOSE if settled(best) else _NEAR
    contenders = [r for r in named if r.fit.rms < near * best.rms][:_MOST]
    if any(not effect.structural for _, effect in fit.model):
        # Beside what was found the base model is bent less: who helps at all shows it at once.
        contenders = [r for r in contenders if r.fit.rms < _HELPS * fit.rms]
    with Pool(max_workers=threads) as pool:
        chances = list(pool.map(lambda r: _chance(fit, r, given, threads), contenders))
        least = min((chance.rung.fit for chance in chances), key=lambda f: f.rms, default=best)
        # Where one of them leaves but noise nobody is helped by more than his forms any more, and
        # only who is level with it.
        over = _explained(least)
        reach = _LEVEL * least.rms if over else np.inf

        def further(pair: tuple[Rung, _Chance]) -> Rung:
            begun, chance = pair
            near = begun.fit.rms < _SECOND * best.rms and chance.rung.fit.rms <= reach
            return _further(fit, chance, threads, over=over) if near else chance.rung

        fitted = list(pool.map(further, zip(contenders, chances, strict=True)))
        # Whoever can do exactly what another one does begins there as well, however far behind.
        behind = [r for r in named if r not in contenders]
        pairs = [(r, o) for r in [*fitted, *behind] for o in fitted if o.fit.rms < r.fit.rms]
        for (_, other), led in zip(pairs, pool.map(begun_there, pairs), strict=True):
            # Who does no better than whom it imitates has its place where but noise is left, for
            # fewer parameters decide there.
            if led is not None and (led.fit.rms < other.fit.rms or explained(led.fit)):
                fitted.append(led)
    return judged(fit, [*rungs, *fitted])


def settled(fit: Fit) -> bool:
    """Whether a fit leaves but noise, or what may be noise that is somewhat slow."""
    floor = noise_floor(fit)
    if fit.model.quasi_static or fit.rms > _FAR * floor.rms:
        return False
    return _explained(fit) or not structure(fit, floor).left


def _explained(fit: Fit) -> bool:
    """Whether a fit leaves but noise, and leaves out no mechanics that a contender may need."""
    return explained(fit) and not fit.model.quasi_static


def _best_of_each(rungs: Sequence[Rung]) -> list[Rung]:
    best: dict[str, Rung] = {}
    for rung in sorted(rungs, key=lambda r: r.fit.rms):
        if rung.suspect is not None:
            best.setdefault(rung.suspect.name, rung)
    return list(best.values())


def _simpler(rung: Rung, other: Rung) -> bool:
    """Whether a rung is behind another one whose law has no fewer numbers."""
    behind = rung.fit.rms > _BEHIND * other.fit.rms
    return behind and numbers(rung.fit) <= numbers(other.fit)


@final
@dataclass(frozen=True, eq=False)
class _Chance:
    """What a contender has been brought to, and the second starts that are left to try.

    Attributes:
        rung: its best fit yet, in what details of its own it pays for.
        suspect: the contender.
        second: second starts.
    """

    rung: Rung
    suspect: Suspect
    second: Sequence[Trial]


def _chance(fit: Fit, rung: Rung, given: Identification, threads: int) -> _Chance:
    """The best that a contender can be brought to from where it is and from a fresh start."""
    suspect = rung.suspect
    assert suspect is not None
    with Pool(max_workers=threads) as pool:
        founded = pool.submit(_founded, fit, rung, threads)
        first, second = _fresh(fit, suspect, given, threads)
        fresh = list(pool.map(lambda trial: _fitted(fit, trial, suspect), first))
        best = founded.result()
    for other in fresh:
        if other is not None and other.fit.rms < _WORTH * best.fit.rms:
            other = _founded(fit, other, threads)
            if bic_gain(best.fit, other.fit) > 0:
                best = other
    return _Chance(_detailed(fit, best, suspect, threads), suspect, second)


def _further(fit: Fit, chance: _Chance, threads: int, *, over: bool) -> Rung:
    """A contender in its other forms, too, and from a second start unless that is over."""
    best, suspect = _formed(fit, chance.rung, chance.suspect, threads), chance.suspect
    if over or explained(best.fit):
        return best
    # Behind where the base model stood without its details; beside them it may be ahead.
    begun = [with_base_details(trial) for trial in chance.second]
    ahead = _best(fit, best, begun, suspect, threads)
    return best if ahead is best else _shaped(fit, ahead, threads)


def _founded(fit: Fit, best: Rung, threads: int) -> Rung:
    """A contender with the base model in the detail that it then pays for."""
    assert best.suspect is not None
    return _best(fit, best, base_refinements(best.fit), best.suspect, threads)


def _after(fit: Fit, rung: Rung, other: Rung, threads: int) -> Rung | None:
    """A contender that begins at what another one does, where it can; None where it cannot."""
    assert rung.suspect is not None
    assert other.suspect is not None
    theirs, name = other.suspect.name, rung.suspect.name
    does = own(other.fit.values, theirs)
    # Not every form can, and the one that is ahead may be another one.
    able = ((e, e.like(theirs, does)) for e in (rung.suspect.effect, *forms(rung.suspect.effect)))
    effect, imitated = next(((e, v) for e, v in able if v is not None), (None, None))
    if effect is None or imitated is None:
        return None
    model = other.fit.model.replaced(theirs, effect)
    question = other.fit.question.with_model(model)
    begun = {f"{name}.{k}": v for k, v in imitated.items()}
    known = (*question.free, *question.fixed)
    details = tuple(k for k in begun if model.parameters[k].detail and k not in known)
    # A detail that the imitation moves is free as if it had been asked for, and need not be moved.
    usual = {**begun, **{k: model.parameters[k].nominal for k in details}}
    trials = [Trial(question, {**other.fit.values, **usual}, rung.suspect)]
    if details:
        finer = replace(question, free=(*question.free, *details))
        trials.append(Trial(finer, {**other.fit.values, **begun}, rung.suspect, refines=details))
    best = _best(fit, rung, trials, rung.suspect, threads)
    return None if best is rung else _shaped(fit, best, threads)


def _shaped(fit: Fit, best: Rung, threads: int) -> Rung:
    """A contender in more detail of its own, as far as that pays, and in other forms."""
    assert best.suspect is not None
    detailed = _detailed(fit, best, best.suspect, threads)
    return _formed(fit, detailed, best.suspect, threads)


def _detailed(fit: Fit, best: Rung, suspect: Suspect, threads: int) -> Rung:
    """A contender in more detail of its own, as far as that pays."""
    details = [
        trial for trial in shape_refinements(best.fit)
        if all(name.startswith(f"{suspect.name}.") for name in trial.refines)
    ]  # fmt: skip
    # Begun at what they are to improve: whoever has lost that and hardly falls will not.
    detailed = _best(fit, best, details, suspect, threads, _SECOND * best.fit.rms)
    return _moving(fit, best, detailed, suspect, threads)


def _formed(fit: Fit, best: Rung, suspect: Suspect, threads: int) -> Rung:
    """A contender in its other forms, unless it leaves but noise as it is."""
    if explained(best.fit):
        return best
    # A form that is exact in its details and the base model's may be behind without them.
    others = [with_base_details(t, suspect.name) for t in other_forms(best.fit, suspect.name)]
    formed = _best(fit, best, others, suspect, threads, _OUTSIDE * best.fit.rms)
    return _moving(fit, best, formed, suspect, threads)


def _moving(fit: Fit, before: Rung, best: Rung, suspect: Suspect, threads: int) -> Rung:
    """A contender in another shape with the mechanics that its shape of before may have hidden."""
    mechanics = None if best is before else mechanics_trial(best.fit)
    return best if mechanics is None else _best(fit, best, [mechanics], suspect, threads)


def _best(
    fit: Fit,
    best: Rung,
    trials: Sequence[Trial],
    suspect: Suspect,
    threads: int,
    beyond: float = float("inf"),
) -> Rung:
    """A contender as what it is tried as, where that is worth what it costs."""
    with Pool(max_workers=threads) as pool:
        tried = list(pool.map(lambda trial: _fitted(fit, trial, suspect, beyond), trials))
    for other in tried:
        if other is not None and bic_gain(best.fit, other.fit) > 0:
            best = other
    return best


def _fitted(fit: Fit, trial: Trial, suspect: Suspect, beyond: float = float("inf")) -> Rung | None:
    """A trial and its fit; None where it has none, or an implausible one."""
    try:
        richer = solved(trial.question, trial.start, _ITERATIONS, beyond)
    except NO_FIT:
        return None
    rung = Rung(replace(trial, suspect=suspect), richer, bic_gain(fit, richer))
    # What holds a simpler effect is ahead of that one wherever something else is missing, too.
    form = dict(richer.model).get(suspect.name)
    ahead = form is not None and form.holds_another and not explained(richer)
    return rung if plausible(rung) and not ahead else None


def _fresh(
    fit: Fit, suspect: Suspect, given: Identification, threads: int
) -> tuple[list[Trial], list[Trial]]:
    """The contender beside a base model that has forgotten what it was bent to without it.

    Best starts and second ones.
    """
    best, second = [], []
    for trial in beside(fit, given, suspect):
        with suppress(*NO_FIT):
            starts = joint_starts(trial.question, trial.question.model.names[-1], threads)
            best.append(replace(trial, start=starts[0]))
            second += [replace(trial, start=start) for start in starts[1:]]
    return best, second


def beside(fit: Fit, given: Identification, suspect: Suspect) -> list[Trial]:
    """The question at the foot with what was added since, and a suspect; nothing is known yet.

    A force needs mechanics, and so does what the motion drives. Where the fit has none they join
    it; or a force acts on a spring without mass, on which it was scored.
    """
    question = forgetful(fit, given)
    if not (fit.model.quasi_static and "motion" in suspect.effect.requires):
        return [Trial(question.with_model(question.model + suspect.effect), {}, suspect)]
    moving = question.with_model(question.model + SecondOrder())
    joined = (moving.model.names[-1],)
    founded = Trial(moving.with_model(moving.model + suspect.effect), {}, suspect, joined)
    if suspect.effect.place is not Place.MOTION:
        return [founded]
    stiff = suspect.base.question
    unseen = replace(question.with_model(stiff.model), fixed=stiff.fixed)
    return [founded, Trial(unseen.with_model(unseen.model + suspect.effect), {}, suspect)]


def forgetful(fit: Fit, given: Identification) -> Identification:
    """The question of a fit as asked at first: only the effects that were added keep their values.

    Args:
        fit: the fit.
        given: the question at the foot of the ladder.
    """
    added = {name for name, effect in fit.model if not effect.structural}
    values = {k: v for k, v in fit.values.items() if k.split(".")[0] in added}
    freed = tuple(k for k in fit.question.free if k.split(".")[0] in added)
    return replace(
        fit.question, free=(*given.free, *(k for k in freed if k not in given.free)),
        values={**given.given(), **values},
    )  # fmt: skip
