"""The ladder: add the likeliest effect, refit, let BIC and held-out data decide, repeat, prune."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.contest import contest, settled
from piezo_opt.diagnosis.exchange import exchange
from piezo_opt.diagnosis.grouping import group_of
from piezo_opt.diagnosis.held_out import FOREIGN, HeldOut, agrees, elsewhere, error_on, rms
from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.pairs import pair
from piezo_opt.diagnosis.prune import prune
from piezo_opt.diagnosis.refinements import lean, plausible, refinements, with_base_details
from piezo_opt.diagnosis.rung import STRONG, WORTH, Rung, adding, bic_gain, race, solved
from piezo_opt.diagnosis.scores import Suspect, Unscored, by_name
from piezo_opt.diagnosis.shortlist import entrants, further, scored, shortlist
from piezo_opt.diagnosis.steps import Step, shaped_further, step_to, topped
from piezo_opt.diagnosis.structure import structure
from piezo_opt.effects.base import Effect
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit, with_statistics

FloatArray = NDArray[np.float64]

SIGNIFICANT = 1e-3
"""Corrected p-value below which a suspect is worth a refit."""
SHORT = 0.05
"""The same where nothing is held out: long-run variances of a few dozen samples say little, and
strong evidence after the refit asks for more than this by itself."""
_DETAIL = 0.02
"""Share by which the error must fall for more detail of what the model has."""
_TOLERATED = 1.1
"""Held-out error over that before up to which a detail is taken."""
_ABOVE = 1.3
"""Residual over the floor at the highest frequencies from which it may be no noise."""
_ALIKE = 0.9
"""Cosine at the foot from which two effects are the same physics in two shapes."""
_SHAPING = 0.5
"""Error over that before below which a look-alike has done more than shape what was found."""
_IN_SIGHT = 2.0
"""Error over the best rung's beyond which a rung is not asked for its held-out error."""
_ENOUGH = 1.03
"""Error over the best rung's up to which no other effect is asked for."""
_AS_WELL = 1.01
"""Held-out error over the best rung's up to which another one predicts as well."""
_LOST = 2.0
"""Error of the closest refit over the floor beyond which every effect is tried afresh."""
_DOUBTFUL, _NOISY = 1.3, 1.1
"""Held-out error of the closest refit over its own beyond which the same is done, where that one
leaves no more than so many times the floor; where it leaves what may be slow noise, that of another
record (``FOREIGN``)."""
_MOST_ROUNDS = 7


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
        refined: what was needed in more detail and is no new effect: parameters that were freed
            (an exponent, a second pole), mechanics that joined, effects in another form.
        dropped: effects that a later step made unnecessary.
    """

    baseline: Fit
    final: Fit
    steps: tuple[Step, ...]
    suspects: tuple[Suspect, ...]
    unscored: tuple[Unscored, ...]
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
    now = suspects
    steps: list[Step] = []
    refined: list[str] = []
    dropped: list[str] = []
    touched = unconfirmed = False
    foot = error = error_on(fit, held.record)
    nameless = fit, refined
    bar = SIGNIFICANT if held.record is not None else SHORT
    ended = paired = False
    for _ in range(_MOST_ROUNDS):
        if not paired and (ended or len(steps) > 1) and _astray(fit, held):
            paired = True
            tell("fitting every two effects together")
            both = pair(baseline, fit, held, candidates, threads)
            if both is not None:
                fit, taken_together = both
                names = [step.name for step in taken_together]
                tell(f"accepted {' and '.join(names)} together")
                dropped += [step.name for step in steps if step.name not in names]
                steps, ended, unconfirmed = taken_together, False, False
                refined += _freed(baseline, fit)
                error = elsewhere(fit, held)
                now, _ = scored(fit, candidates, threads)
        if ended:
            break
        rungs = _refits(fit, held, now, first=not steps, bar=bar, tell=tell, threads=threads)
        chosen = _chosen(fit, error, _order(rungs, held, threads), first=not steps)
        if chosen is None:
            ended = True
            continue
        taken, after = chosen
        suspect = taken.suspect
        if suspect is not None and not steps:
            unconfirmed = not agrees(error, after, fit.rms)
            nameless = fit, list(refined)
        touched = suspect is None
        if suspect is None:
            refined += taken.trial.refines
            tell(f"refined {', '.join(taken.trial.refines)}")
        else:
            # Rivals pay for the base model's details, so the taken one is compared with them too.
            group = group_of(taken, rungs, now)
            taken = lean(fit, taken)
            alone = _unaided(taken) if steps else None
            if alone is not None:
                tell(f"refitted from where {suspect.name} had led")
                refined += _freed(fit, alone)
                fit, error = alone, elsewhere(alone, held)
                steps[-1] = topped(steps[-1], fit, rms(error))
                touched = True
                now, _ = scored(fit, candidates, threads)
                continue
            after = elsewhere(taken.fit, held)
            refined += _of_base(fit, taken.fit)
            halved = taken.fit.rms < _SHAPING * fit.rms
            same = None if halved else _sibling(suspect, steps, suspects)
            if same is None:
                steps.append(step_to(fit, error, taken, after, group))
                tell(f"accepted {suspect.name}")
            else:
                tell(f"{steps[same].name} shaped further by {suspect.name}")
                steps = shaped_further(steps, same, taken, after)
        joined = any(e.structural and n not in fit.model for n, e in taken.fit.model)
        fit, error = taken.fit, after
        spare: list[str] = []
        if steps and suspect is not None:
            fit, steps, spare = prune(fit, steps, held, threads)
            if spare:
                tell(f"dropped {', '.join(spare)}")
                dropped += spare
                error = elsewhere(fit, held)
        if _nothing_to_win(fit):
            break
        last = bool(spare) or joined
        fit, steps, gone = exchange(baseline, fit, steps, held, candidates, threads, last=last)
        if gone:
            touched = touched or any(old != new for old, new in gone)
            tell(f"exchanged {', '.join(f'{old} for {new}' for old, new in gone)}")
            refined += [old for old, new in gone if old == new]
            error = elsewhere(fit, held)
            if _nothing_to_win(fit):
                break
        now, _ = scored(fit, candidates, threads)
    if steps and touched:
        fit, steps, spare = prune(fit, steps, held, threads, last=True)
        dropped += spare
    if steps and unconfirmed and not agrees(foot, elsewhere(fit, held)):
        # Not even with all that came after it does the other record want it.
        tell(f"refused {', '.join(step.name for step in steps)}")
        (fit, refined), steps, dropped = nameless, [], []
    return Ladder(
        baseline,
        fit,
        tuple(replace(step, fit=with_statistics(step.fit)) for step in steps),
        by_name(suspects),
        tuple(u for u in unscored if u.name not in fit.model),
        tuple(name for name in refined if name.split(".")[0] in fit.model),
        tuple(dropped),
    )


def _nothing_to_win(fit: Fit) -> bool:
    """Whether not even a detail could win what it is worth."""
    return (1.0 - _DETAIL) * fit.rms < noise_floor(fit).rms


def _refits(
    fit: Fit,
    held: HeldOut,
    suspects: Sequence[Suspect],
    *,
    first: bool,
    bar: float,
    tell: Callable[[str], None],
    threads: int,
) -> list[Rung]:
    """Refits with what a fit may be missing, each brought as far as it can be, best BIC first.

    Args:
        fit: the fit.
        held: whose question is that at the foot of the ladder.
        suspects: scores of all absent effects at the fit.
        first: whether nothing has been found yet.
        bar: p-value below which a suspect is worth a refit.
        tell: called with a sentence about what is going on.
        threads: refits that run at a time.
    """
    likely = [s for s in suspects if s.p_value < bar]
    short = shortlist(likely, suspects) if likely else []
    trials = refinements(fit)
    rungs: list[Rung] = []
    if short or trials:
        tell(_refitting(short))
        rungs = race(fit, [*trials, *(with_base_details(adding(s)) for s in short)], threads)
    closest = min((r.fit for r in rungs), key=lambda f: f.rms, default=fit)
    floor = noise_floor(closest).rms
    calm = settled(closest)
    doubtful = closest is not fit and (
        (closest.rms < _NOISY * floor and _mispredicts(closest, held, _DOUBTFUL))
        or (calm and _mispredicts(closest, held, FOREIGN))
    )
    if doubtful or (not calm and _unsettled(fit, first=first)):
        # Scores are taken at a fit that has been bent, and slow residuals leave none of them
        # significant: let refits tell.
        more = further(suspects, short)
        lost = doubtful or closest.rms > _LOST * floor
        tell(f"{_refitting(more)}{', and all from a fresh start' if lost else ''}")
        bent = [with_base_details(adding(s)) for s in more]
        fresh = entrants(fit, held.question, suspects) if lost else []
        if not first:
            fresh = [with_base_details(trial) for trial in fresh]
        rungs += race(fit, [*bent, *fresh], threads)
    return contest(fit, [r for r in rungs if plausible(r)], held.question, threads)


def _chosen(
    fit: Fit,
    error: FloatArray | None,
    ordered: Sequence[tuple[Rung, FloatArray | None]],
    *,
    first: bool,
) -> tuple[Rung, FloatArray | None] | None:
    """The first rung that is worth its name and that the held-out data do not contradict.

    A detail names nothing, and what it wins on the fitted record it may lose a little of where a
    record of another kind is judged on: without it an effect would be named for its sake. What is
    found first may leave a record of another kind as it was, if that shows far more than what is
    then left, until the end of the ladder; beside what was found already another name must prove
    itself where it is judged.
    """
    for rung, after in ordered:
        halved = rung.fit.rms < _SHAPING * fit.rms
        lenient = (rung.fit.rms if halved else fit.rms) if first else np.inf
        detail = rung.suspect is None
        worth = _DETAIL if detail else WORTH
        level = detail and (rms(after) or 0.0) <= _TOLERATED * (rms(error) or np.inf)
        if rung.fit.rms < (1.0 - worth) * fit.rms and (level or agrees(error, after, lenient)):
            return rung, after
    return None


def _unaided(rung: Rung) -> Fit | None:
    """The fit without a rung's effect that does as well from where the effect had led; else None.

    A search that is stuck is led out by any effect; what it finds then needs none.
    """
    assert rung.suspect is not None
    question = rung.fit.question.with_model(rung.fit.model.without(rung.suspect.name))
    try:
        alone = solved(question, rung.fit.values)
    except (PiezoOptError, ArithmeticError, ValueError):
        return None
    return alone if bic_gain(alone, rung.fit) < STRONG else None


def _freed(before: Fit, after: Fit) -> list[str]:
    """What was refined on the way from one fit to another: mechanics that joined, details freed."""
    joined = [n for n, e in after.model if e.structural and n not in before.model]
    return [*joined, *(k for k in after.question.free if k not in before.question.free)]


def _of_base(before: Fit, after: Fit) -> list[str]:
    """What was refined of the base model alone."""
    return [k for k in _freed(before, after) if after.model[k.split(".")[0]].structural]


def _refitting(suspects: Sequence[Suspect]) -> str:
    names = dict.fromkeys(s.name for s in suspects)
    return f"refitting with {', '.join(names) or 'more detail'}"


def _unsettled(fit: Fit, *, first: bool) -> bool:
    """Whether a residual may yet be no noise: it shows structure, or (at first) it is slow."""
    floor = noise_floor(fit)
    return fit.rms > (_ABOVE if first else _LOST) * floor.rms or structure(fit, floor).left


def _mispredicts(fit: Fit, held: HeldOut, times: float) -> bool:
    """Whether a fit explains one record and not the other: it may be bent to do so."""
    there = rms(elsewhere(fit, held))
    return there is not None and there > times * fit.rms


def _astray(fit: Fit, held: HeldOut) -> bool:
    """Whether a fit leaves far more than noise, or somewhat more and misses the other record."""
    over = fit.rms / noise_floor(fit).rms
    return over > _LOST or (over > _NOISY and _mispredicts(fit, held, FOREIGN))


def _order(
    rungs: Sequence[Rung], held: HeldOut, threads: int
) -> list[tuple[Rung, FloatArray | None]]:
    """Rungs and their held-out errors: best first by both records, fitted and held out.

    A rung that bends the base model fits well and predicts badly; neither error alone decides.
    What the model has already comes before effects that do hardly better on both, or on the
    fitted one without strong evidence: a detail that is right may reach beyond a record of
    another kind no better than one that is wrong.
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
        errors = list(pool.map(lambda r: elsewhere(r.fit, held), close))

    # A record that nobody comes near shows above all something else: it decides nothing yet.
    reached = [(rms(e) or 0.0) / r.fit.rms for r, e in zip(close, errors, strict=True)]
    foreign = min(reached) > FOREIGN

    def both(pair: tuple[Rung, FloatArray | None]) -> float:
        return pair[0].fit.rms * (1.0 if foreign else rms(pair[1]) or 0.0)

    pairs = sorted(zip(close, errors, strict=True), key=both)
    enough = (_ENOUGH if foreign else _ENOUGH**2) * both(pairs[0])
    strongest = max((r.delta_bic for r in close if r.suspect is not None), default=-np.inf)

    # Of those that predict as well the one that pays for fewer parameters.
    as_well = _AS_WELL * (rms(pairs[0][1]) or 0.0)
    level = [r for r, e in pairs if (rms(e) or 0.0) <= as_well and both((r, e)) <= enough]
    lean = max((r for r in level if r.suspect is not None), key=_gain, default=None)

    def later(pair: tuple[Rung, FloatArray | None]) -> tuple[bool, bool]:
        rung, _ = pair
        beaten = both(pair) > enough and rung.delta_bic + STRONG < strongest
        return rung.suspect is not None or beaten, rung is not lean

    return sorted(pairs, key=later)


def _gain(rung: Rung) -> float:
    return rung.delta_bic


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
