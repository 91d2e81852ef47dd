"""The ladder: add the likeliest effect, refit, let BIC and held-out data decide, repeat, prune."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.contest import contest, forgetful, settled
from piezo_opt.diagnosis.held_out import HeldOut, agrees, error_on, rms
from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.refinements import lean, plausible, refinements, with_base_details
from piezo_opt.diagnosis.rung import STRONG, Rung, Trial, adding, bic_gain, race
from piezo_opt.diagnosis.scores import Suspect, Unscored, by_name
from piezo_opt.diagnosis.shortlist import entrants, further, scored, shortlist
from piezo_opt.diagnosis.structure import structure
from piezo_opt.effects.base import Effect
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit, Identification
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.starting import joint_start, starting_values
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

SIGNIFICANT = 1e-3
"""Corrected p-value below which a suspect is worth a refit."""
SHORT = 0.05
"""The same where nothing is held out: long-run variances of a few dozen samples say little, and
strong evidence after the refit asks for more than this by itself."""
_WORTH = 0.06
"""Share by which the error must fall for an effect to be worth a name: less than a third of what
is left is not."""
_DETAIL = 0.02
"""The same for more detail of what the model has."""
_ABOVE = 1.3
"""Residual over the floor at the highest frequencies from which it may be no noise."""
_FORM = 2.0
"""Misfit beyond the noise over the best effect's own up to which a rival may be meant."""
_ALIKE_RMS = 1.2
"""The same for the whole error: slow noise makes the misfit look larger than it is."""
_EXACT = 0.08
"""Misfit over the noise (squares) up to which a form counts as exact."""
_ALIKE = 0.9
"""Cosine at the foot from which two effects are the same physics in two shapes."""
_IN_SIGHT = 2.0
"""Error over the best rung's beyond which a rung is not asked for its held-out error."""
_ENOUGH = 1.03
"""Error over the best rung's up to which no other effect is asked for."""
_LOST = 2.0
"""Error of the closest refit over the floor beyond which every effect is tried afresh."""
_MOST_ROUNDS = 7


@final
@dataclass(frozen=True, eq=False)
class Step:
    """One accepted effect.

    Attributes:
        name: the effect.
        effect: the object that was added.
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


@final
@dataclass(frozen=True, eq=False)
class Ladder:
    """All rungs.

    Attributes:
        baseline: the fit at the foot, on the fitted part of the records.
        final: the fit at the top.
        steps: accepted effects in order.
        suspects: scores of all candidates at the foot.
        unscored: candidates that could not be scored, and why.
        last_suspects: scores at the top.
        refined: what was needed in more detail and is no new effect: parameters that were freed
            (an exponent, a second pole), mechanics that joined, effects in another form.
        dropped: effects that a later step made unnecessary.
    """

    baseline: Fit
    final: Fit
    steps: tuple[Step, ...]
    suspects: tuple[Suspect, ...]
    unscored: tuple[Unscored, ...]
    last_suspects: tuple[Suspect, ...]
    refined: tuple[str, ...]
    dropped: tuple[str, ...]


def climb(
    baseline: Fit,
    held: HeldOut,
    candidates: Sequence[Effect],
    tell: Callable[[str], None] = lambda _: None,
    threads: int = 2,
) -> Ladder:
    """Climb from a baseline fit (of ``held.question``).

    Args:
        baseline: the fit at the foot.
        held: what decides beside BIC.
        candidates: effects that may be added.
        tell: called with a sentence about what is going on.
        threads: refits that run at a time.
    """
    fit = baseline
    tell("scoring every absent effect")
    suspects, unscored = scored(fit, candidates, threads)
    first, now = suspects, suspects
    steps: list[Step] = []
    refined: list[str] = []
    dropped: list[str] = []
    error = error_on(fit, held.record)
    bar = SIGNIFICANT if held.record is not None else SHORT
    for _ in range(_MOST_ROUNDS):
        likely = [s for s in now if s.p_value < bar]
        short = shortlist(likely, now) if likely else []
        trials = refinements(fit, held.question)
        rungs: list[Rung] = []
        if short or trials:
            tell(_refitting(short))
            rungs = race(fit, [*trials, *(with_base_details(adding(s)) for s in short)], threads)
        closest = min((r.fit for r in rungs), key=lambda f: f.rms, default=fit)
        if not settled(closest) and _unsettled(fit, first=not steps):
            # Scores are taken at a fit that has been bent, and slow residuals leave none of them
            # significant: let refits tell.
            more = further(now, short)
            lost = closest.rms > _LOST * noise_floor(closest).rms
            tell(f"{_refitting(more)}{', and all from a fresh start' if lost else ''}")
            bent = [with_base_details(adding(s)) for s in more]
            fresh = entrants(fit, held.question, now) if lost else []
            rungs += race(fit, [*bent, *fresh], threads)
        rungs = [r for r in rungs if plausible(r)]
        rungs = contest(fit, rungs, held.question, threads)
        taken: Rung | None = None
        # Beside what was found already another name must prove itself where it is judged.
        lenient = fit.rms if not steps else np.inf
        for rung, after in _order(rungs, held, threads):
            worth = _DETAIL if rung.suspect is None else _WORTH
            if rung.fit.rms < (1.0 - worth) * fit.rms and agrees(error, after, lenient):
                taken = rung
                break
        if taken is None:
            break
        if taken.suspect is not None:
            # Rivals pay for the base model's details, so the taken one is compared with them too.
            group = _group(taken, rungs, now)
            taken = lean(fit, taken)
            after = error_on(taken.fit, held.record)
            refined += [k for k in taken.trial.refines if _of_base(taken.fit, k)]
        if taken.suspect is None:
            refined += taken.trial.refines
            tell(f"refined {', '.join(taken.trial.refines)}")
        elif (same := _sibling(taken.suspect, steps, suspects)) is not None:
            # The same physics in a shape that one member alone does not have.
            steps[same] = replace(
                steps[same],
                group=tuple(dict.fromkeys((*steps[same].group, taken.suspect.name))),
                delta_bic=steps[same].delta_bic + taken.delta_bic,
            )
            # What that wins is won at the top of the ladder, whichever step it shapes.
            steps[-1] = replace(
                steps[-1], rms_after=taken.fit.rms, held_out_after=rms(after), fit=taken.fit
            )
            tell(f"{steps[same].name} shaped further by {taken.suspect.name}")
        else:
            steps.append(
                Step(
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
            )
            tell(f"accepted {taken.suspect.name}")
        fit, error = taken.fit, after
        if sum(not effect.structural for _, effect in fit.model) > 1:
            fit, steps, spare = _prune(fit, steps, held, threads)
            if spare:
                tell(f"dropped {', '.join(spare)}")
                dropped += spare
                error = error_on(fit, held.record)
        now, _ = scored(fit, candidates, threads)
        if (1.0 - _DETAIL) * fit.rms < noise_floor(fit).rms:
            break  # not even a detail could win what it is worth
    return Ladder(
        baseline,
        fit,
        tuple(steps),
        by_name(first),
        unscored,
        by_name(now),
        tuple(refined),
        tuple(dropped),
    )


def _of_base(fit: Fit, name: str) -> bool:
    """Whether a refinement is of the base model (an exponent, the mechanics)."""
    return fit.model[name.split(".")[0]].structural


def _refitting(suspects: Sequence[Suspect]) -> str:
    names = dict.fromkeys(s.name for s in suspects)
    return f"refitting with {', '.join(names) or 'more detail'}"


def _unsettled(fit: Fit, *, first: bool) -> bool:
    """Whether a residual may yet be no noise: it shows structure, or (at first) it is slow."""
    floor = noise_floor(fit)
    return (first and fit.rms > _ABOVE * floor.rms) or structure(fit, floor).left


def _order(
    rungs: Sequence[Rung], held: HeldOut, threads: int
) -> list[tuple[Rung, FloatArray | None]]:
    """Rungs and their held-out errors: best first by both records, fitted and held out.

    A rung that bends the base model fits well and predicts badly; neither error alone decides.
    What the model has already comes before any effect that does hardly better.
    """
    if not rungs:
        return []
    if held.record is None:
        # Nothing else decides: the information criterion, which pays for every parameter.
        enough = _ENOUGH * min(r.fit.rms for r in rungs)
        first = sorted(rungs, key=lambda r: r.suspect is not None or r.fit.rms > enough)
        return [(rung, None) for rung in first]
    near = _IN_SIGHT * min(r.fit.rms for r in rungs)
    close = [r for r in rungs if r.fit.rms <= near]
    with ThreadPoolExecutor(max_workers=threads) as pool:
        errors = list(pool.map(lambda r: _elsewhere(r.fit, held), close))

    def both(pair: tuple[Rung, FloatArray | None]) -> float:
        return pair[0].fit.rms * (rms(pair[1]) or 0.0)

    pairs = sorted(zip(close, errors, strict=True), key=both)
    enough = _ENOUGH**2 * both(pairs[0])
    return sorted(pairs, key=lambda pair: pair[0].suspect is not None or both(pair) > enough)


def _elsewhere(fit: Fit, held: HeldOut) -> FloatArray | None:
    """Held-out errors; without end where the record cannot be simulated with this fit."""
    try:
        error = error_on(fit, held.record)
    except (PiezoOptError, ArithmeticError):
        return np.array([np.inf])
    return error if error is None or np.isfinite(error).all() else np.array([np.inf])


def _sibling(suspect: Suspect, steps: Sequence[Step], foot: Sequence[Suspect]) -> int | None:
    """Index of an accepted step that this suspect was mistaken for at the foot."""
    own = [s for s in foot if s.name == suspect.name]
    for index, step in enumerate(steps):
        accepted = [s for s in foot if s.name == step.name]
        for a in own:
            for b in accepted:
                if abs(float(a.direction @ b.direction)) > _ALIKE:
                    return index
    return None


def _group(taken: Rung, rungs: Sequence[Rung], suspects: Sequence[Suspect]) -> tuple[str, ...]:
    """Effects that the record cannot tell from the taken one, itself first.

    Refitted rivals within strong evidence of the best, and directions nearly parallel to it. Where
    the best itself leaves more than noise, its form is not the true one, and a rival that misses by
    less than twice as much may be meant as well.
    """
    assert taken.suspect is not None
    names = [taken.suspect.name]
    noise = noise_floor(taken.fit).rms ** 2
    missed = max(0.0, taken.fit.rms**2 - noise)
    meant = min(noise + _FORM**2 * missed, (_ALIKE_RMS * taken.fit.rms) ** 2)
    for rung in rungs:
        if rung.suspect is None:
            continue
        even = taken.delta_bic - rung.delta_bic < STRONG
        if even or (missed > _EXACT * noise and rung.fit.rms**2 < meant):
            names.append(rung.suspect.name)
    refitted = {r.suspect.name for r in rungs if r.suspect is not None}
    for suspect in suspects:
        if suspect.name not in refitted and not suspect.wrong_side:
            cosine = abs(float(suspect.direction @ taken.suspect.direction))
            if cosine > 0.995:
                names.append(suspect.name)
    return tuple(dict.fromkeys(names))


def _prune(
    fit: Fit, steps: Sequence[Step], held: HeldOut, threads: int
) -> tuple[Fit, list[Step], list[str]]:
    """Drop what a later step made unnecessary: BIC does not rise without it.

    A first step may have taken the place of the loop while the loop stood in for what was found
    later; so each is tried without also from fresh starts, those included in which the loop and
    a later step are searched together.
    """
    kept, dropped = list(steps), []
    for step in steps:
        named = {other.name for other in kept}
        shapes = [n for n in step.group[1:] if n in fit.model and n not in named]
        if step.name not in fit.model or (step is steps[-1] and not shapes):
            continue  # the last one was judged with all the others present
        model = fit.model.without(step.name)
        fresh = forgetful(fit, held.question).with_model(model)
        later = [name for name, effect in model if not effect.structural]
        trials = [Trial(fit.question.with_model(model), fit.values)]
        for begin in (starting_values, *(_jointly(name) for name in later)):
            with suppress(PiezoOptError, ArithmeticError, ValueError):
                trials.append(Trial(fresh, begin(fresh, Monitor(()))))
        poorer = [rung.fit for rung in race(fit, trials, threads)]
        if not poorer:
            continue
        least = min(poorer, key=lambda f: f.rms)
        if bic_gain(least, fit) < 0.5 * STRONG:
            fit = least
            left = _renamed(kept, step, shapes[0], fit) if shapes else _without(kept, step)
            held_out = rms(error_on(fit, held.record))
            top = replace(left[-1], rms_after=fit.rms, held_out_after=held_out, fit=fit)
            kept = [*left[:-1], top]
            dropped.append(step.name)
    return fit, kept, dropped


def _jointly(name: str) -> Callable[[Identification, Monitor], Values]:
    """Starting values in which the loop and one effect are searched together."""
    return lambda question, _: joint_start(question, name)


def _without(steps: Sequence[Step], spare: Step) -> list[Step]:
    """The ladder without one step: the next begins where that one began."""
    place = steps.index(spare)
    after = replace(
        steps[place + 1],
        rms_before=spare.rms_before,
        held_out_before=spare.held_out_before,
        delta_bic=steps[place + 1].delta_bic + spare.delta_bic,
    )
    return [*steps[:place], after, *steps[place + 2 :]]


def _renamed(steps: Sequence[Step], step: Step, name: str, fit: Fit) -> list[Step]:
    """What was taken for a step's shape does alone what both did: the step bears its name."""
    group = (name, *(other for other in step.group if other != name))
    other = replace(step, name=name, effect=fit.model[name], group=group)
    return [other if one is step else one for one in steps]
