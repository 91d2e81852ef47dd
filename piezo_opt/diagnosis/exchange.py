"""Earlier steps against their rivals, once the later ones are there.

What is found first is found while everything else is still missing, and the record may not tell it
from others then. Beside the later steps it may: each earlier step is taken out, and whoever would
take its place now is fitted there.

Source: exchange steps in subset selection, Miller (2002), Subset Selection in Regression, 2nd ed.,
ch. 3.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeAlias, final

from piezo_opt.diagnosis.detail import in_detail
from piezo_opt.diagnosis.grouping import group_of
from piezo_opt.diagnosis.held_out import HeldOut, elsewhere, rms
from piezo_opt.diagnosis.refinements import explained, plausible, shape_refinements
from piezo_opt.diagnosis.rung import (
    STRONG,
    Rung,
    Trial,
    adding,
    bic_gain,
    judged,
    numbers,
    race,
    solved,
)
from piezo_opt.diagnosis.scores import Suspect
from piezo_opt.diagnosis.shortlist import scored, shortlist
from piezo_opt.diagnosis.steps import Step, freedom
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.effects.base import Effect
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit

LIKELY = 1e-3
"""Corrected p-value below which a rival is fitted."""
_NEAR = 1.5
"""Error over the best rival's up to which another one is tried in more detail."""
_MOST = 3
"""Rivals that are tried so."""
_HARDLY = 0.95
"""Error of a rival over that of a step as it stands from which the one hardly does better."""
_AHEAD = 0.8
"""Error of a later step alone over that of the first one alone up to which it comes first."""


Exchange: TypeAlias = tuple[Fit, list[Step], list[tuple[str, str]]]
"""The fit, the steps, and pairs of names: what gave way to what. Twice the same name is the same
effect in another form."""


@final
@dataclass(frozen=True, eq=False)
class _Seen:
    """A fit without one of its steps, the scores there, and the refits with whoever may enter.

    ``shaped`` says whether the closest of them were fitted in more detail of their own.
    """

    poorer: Fit
    suspects: tuple[Suspect, ...]
    ranked: list[Rung]
    shaped: bool = False


def exchange(
    foot: Fit,
    fit: Fit,
    steps: Sequence[Step],
    held: HeldOut,
    candidates: Sequence[Effect],
    threads: int,
    *,
    last: bool = False,
    anew: bool = False,
    beyond: int = 0,
    also: Collection[str] = (),
) -> Exchange:
    """The ladder with each earlier step in the form of the rival that does better in its place.

    Args:
        foot: the fit at the foot of the ladder.
        fit: the fit with all the steps.
        steps: accepted effects.
        held: what decides beside BIC: the error on the held-out record must not rise.
        candidates: effects that may be added.
        threads: refits that run at a time.
        last: whether the last step was judged beside another step or another base model than
            there are now; else it stays, unless one of the others gives way to another effect.
        anew: whether no step was judged before; all are told and grouped here.
        beyond: parameters of an effect of its own, beyond which its step is asked for.
        also: names that are fitted in each place, whatever their scores there.

    Returns:
        the fit, the steps, and what gave way to what (see :data:`Exchange`).
    """
    now = list(steps)
    gone: list[tuple[str, str]] = []
    for place, step in enumerate(steps):
        others = any(old != new for old, new in gone)
        judged_last = place == len(steps) - 1 and not (last or anew or others)
        if judged_last or freedom(fit, step.name) <= beyond:
            continue
        seen = _seen(foot, fit, step, candidates, threads, also)
        if seen is None:
            continue
        rival = _rival(fit, step, seen, held, threads)
        if rival is None and not (seen.shaped or explained(fit)):
            # Who leaves but noise here was refused by the other record: a detail may be missing.
            seen = _in_shape(seen, threads)
            rival = _rival(fit, step, seen, held, threads)
        if rival is not None and rival.suspect is not None:
            rival = _against_details(fit, step, seen, rival, held, threads)
        if rival is not None and rival.suspect is not None:
            gone.append((step.name, rival.suspect.name))
            fit = rival.fit
        taken = rival if rival is not None or not anew else _standing(fit, step, seen)
        if taken is not None and taken.suspect is not None:
            now[place] = replace(
                step, name=taken.suspect.name, effect=taken.suspect.effect,
                group=group_of(seen.poorer, taken, seen.ranked, seen.suspects),
                p_value=taken.suspect.p_value,
            )  # fmt: skip
        if rival is not None:
            now = _retold(foot, fit, now, place, held)
    if any(old != new for old, new in gone):
        now = _in_order(foot, fit, now, held, threads)
    return fit, _retold(foot, fit, now, 0, held) if anew else now, gone


def _in_order(
    foot: Fit, fit: Fit, steps: Sequence[Step], held: HeldOut, threads: int
) -> list[Step]:
    """Steps with the one first that explains far more alone than the one which is first does.

    Who took another one's place may explain less than what that one had been found before.
    """

    def alone(step: Step) -> float:
        model = fit.model
        for other in steps:
            model = model if other is step else model.without(other.name)
        with suppress(*NO_FIT):
            return solved(fit.question.with_model(model), fit.values).rms
        return float("inf")

    with Pool(max_workers=threads) as pool:
        left = list(pool.map(alone, steps[1:]))
    if not left or min(left) > _AHEAD * steps[0].rms_after:
        return list(steps)
    ahead = 1 + left.index(min(left))
    turned = [steps[ahead], *steps[:ahead], *steps[ahead + 1 :]]
    return _retold(foot, fit, turned, 0, held)


def regrouped(
    foot: Fit, fit: Fit, steps: Sequence[Step], candidates: Sequence[Effect], threads: int
) -> list[Step]:
    """Steps with the groups of the earlier ones as the record tells them beside the later ones.

    Before the later ones were there every effect missed by much, and many by as much. The members
    are fitted once more in the step's place; whoever has found a place of its own is none.

    Args:
        foot: the fit at the foot of the ladder.
        fit: the fit with all the steps, which leaves nothing to be won.
        steps: accepted effects.
        candidates: effects that may be added.
        threads: refits that run at a time.
    """
    told = list(steps)
    for place, step in enumerate(steps[:-1]):
        if len(step.group) == 1:
            continue
        rivals = [e for e in candidates if e.name in step.group and e.name != step.name]
        seen = _seen(foot, fit, step, [step.effect, *rivals], threads)
        standing = seen and _standing(fit, step, seen)
        if seen and standing:
            group = group_of(seen.poorer, standing, seen.ranked, seen.suspects)
            told[place] = replace(step, group=group)
    return told


def _seen(
    foot: Fit,
    fit: Fit,
    step: Step,
    candidates: Sequence[Effect],
    threads: int,
    also: Collection[str] = (),
) -> _Seen | None:
    """A fit without one of its steps, and who would take its place; None where nobody would."""
    poorer = _without(foot, fit, step, threads)
    if poorer is None:
        return None
    suspects, _ = scored(poorer, candidates, threads)
    likely = [s for s in suspects if s.p_value < LIKELY]
    if not likely:
        return None
    short = shortlist(likely, suspects)
    asked = {step.name, *also}
    more = [s for s in suspects if s.name in asked and s not in short]
    # Without the step the others have moved to make up for it: a rival begins beside them as they
    # were. Begun beside them as they are, the best of twenty exchanges was never better.
    standing = {k: v for k, v in fit.values.items() if k in poorer.values}
    begun = [adding(poorer, s) for s in (*short, *more)]
    trials = [replace(trial, start={**trial.start, **standing}) for trial in begun]
    rungs = race(poorer, trials, threads, standing=fit)
    ranked = judged(poorer, [r for r in rungs if plausible(r)])
    seen = _Seen(poorer, suspects, ranked)
    # Where one of them leaves but noise there is nothing to be won by details, unless the step
    # that stands has some itself.
    detailed = any(k.startswith(f"{step.name}.") for k in fit.question.free)
    if not ranked or (explained(ranked[0].fit) and not detailed):
        return seen
    return _in_shape(seen, threads)


def _without(foot: Fit, fit: Fit, step: Step, threads: int) -> Fit | None:
    """The fit without a step, from where that has led and from before it; None for neither."""
    if step.name not in fit.model:
        return None
    question = fit.question.with_model(fit.model.without(step.name))

    def begun(start: Mapping[str, float]) -> Fit | None:
        with suppress(*NO_FIT):
            return solved(question, start)
        return None

    starts = (fit.values, {**fit.values, **foot.values})
    with Pool(max_workers=threads) as pool:
        found = [one for one in pool.map(begun, starts) if one is not None]
    return min(found, key=lambda f: f.rms, default=None)


def _in_shape(seen: _Seen, threads: int) -> _Seen:
    """The same with the closest rivals in more detail of their own, too."""
    names: dict[str, Rung] = {}
    for rung in seen.ranked:
        if rung.suspect is not None and rung.fit.rms < _NEAR * seen.ranked[0].fit.rms:
            names.setdefault(rung.suspect.name, rung)

    def shaped(name: str) -> list[Rung]:
        rung = names[name]
        own = [
            replace(trial, suspect=rung.suspect) for trial in shape_refinements(rung.fit)
            if all(k.split(".")[0] == name for k in trial.refines)
        ]  # fmt: skip
        return race(seen.poorer, own, threads)

    with Pool(max_workers=threads) as pool:
        found = [rung for rungs in pool.map(shaped, list(names)[:_MOST]) for rung in rungs]
    more = [rung for rung in found if plausible(rung)]
    return replace(seen, ranked=judged(seen.poorer, [*seen.ranked, *more]), shaped=True)


def _rival(fit: Fit, step: Step, seen: _Seen, held: HeldOut, threads: int) -> Rung | None:
    """Who does better than a step where it stands.

    The step itself may do better from there, in a form that it did not have; it has precedence
    over names that are not strongly better.
    """
    even = [r for r in seen.ranked if seen.ranked[0].delta_bic - r.delta_bic < STRONG]
    if not even:
        return None
    best = next((r for r in even if r.suspect and r.suspect.name == step.name), even[0])
    if bic_gain(fit, best.fit) < STRONG:
        return None
    if _reaches(best.fit, fit, held):
        return best
    # What the others still lack in detail may show on the other record alone.
    finer = in_detail(best.fit, threads)
    if finer is best.fit or not _reaches(finer, fit, held):
        return None
    return replace(best, fit=finer, delta_bic=bic_gain(seen.poorer, finer))


def _against_details(
    fit: Fit, step: Step, seen: _Seen, rival: Rung, held: HeldOut, threads: int
) -> Rung:
    """A rival; the step in detail of its own where that is strongly better than who hardly was.

    With more parameters a law does what another one does in its details.
    """
    hardly = rival.fit.rms > _HARDLY * fit.rms and numbers(rival.fit) > numbers(fit)
    own = _standing(fit, step, seen)
    if own is None or not hardly or (rival.suspect and rival.suspect.name == step.name):
        return rival
    finer = in_detail(fit, threads)
    if bic_gain(rival.fit, finer) < STRONG or not _reaches(finer, fit, held):
        return rival
    return replace(own, fit=finer, delta_bic=bic_gain(seen.poorer, finer))


def _reaches(after: Fit, before: Fit, held: HeldOut) -> bool:
    """Whether a fit does no worse than another one on the other record."""
    there, here = rms(elsewhere(after, held)), rms(elsewhere(before, held))
    return there is None or here is None or there <= here


def _standing(fit: Fit, step: Step, seen: _Seen) -> Rung | None:
    """A step as it stands, as a rung above the fit without it; None where it cannot be scored."""
    own = next((s for s in seen.suspects if s.name == step.name), None)
    if own is None:
        return None
    trial = Trial(fit.question, fit.values, replace(own, effect=step.effect))
    return Rung(trial, fit, bic_gain(seen.poorer, fit))


def _retold(foot: Fit, fit: Fit, steps: Sequence[Step], place: int, held: HeldOut) -> list[Step]:
    """The ladder's errors anew from the step that changed to the top, which ends at this fit."""
    told = list(steps)
    before = told[place - 1].fit if place else foot
    for at in range(place, len(told)):
        now = fit
        if at < len(told) - 1:
            model = fit.model
            for later in told[at + 1 :]:
                model = model.without(later.name) if later.name in model else model
            with suppress(*NO_FIT):
                now = solved(fit.question.with_model(model), fit.values)
        told[at] = replace(
            told[at],
            fit=now,
            rms_before=before.rms,
            rms_after=now.rms,
            held_out_before=rms(elsewhere(before, held)),
            held_out_after=rms(elsewhere(now, held)),
            delta_bic=bic_gain(before, now),
        )
        before = now
    return told
