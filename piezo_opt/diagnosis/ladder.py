"""The ladder: add the likeliest effect, refit, let BIC and held-out data decide, repeat, prune."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.held_out import HeldOut, agrees, error_on, rms
from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.scores import Suspect, Unscored, by_name, effective_samples, score
from piezo_opt.diagnosis.structure import structure
from piezo_opt.effects.base import Effect
from piezo_opt.identification import (
    Ending,
    Fit,
    Identification,
    LevenbergMarquardt,
    SingleShooting,
    solve,
)

FloatArray = NDArray[np.float64]

SIGNIFICANT = 1e-3
"""Corrected p-value below which a suspect is worth a refit."""
SHORT = 0.05
"""The same where nothing is held out: long-run variances of a few dozen samples say little, and
strong evidence after the refit asks for more than this by itself."""
STRONG = 10.0
"""Difference of BIC that counts as very strong evidence (Kass & Raftery 1995)."""
_WORTH = 0.02
"""Share by which the error must fall for an effect to be worth a name."""
_TELLING = 0.02
"""Score worth a refit when structure is left and no score is significant."""
_ALIKE = 0.9
"""Cosine at the foot from which two effects are the same physics in two shapes."""
_KIN = 0.6
"""Cosine from which a suspect is refitted because it looks like a likely one."""
_SHORTLIST = 6
_FIRST, _LATER = 10, 30
"""Iterations of a refit before and after it is decided which are worth following."""
_RACE = 1.5
"""Error over the best rival's beyond which a refit is out of the race."""
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
        refined: parameters that had to be freed in the base model (an exponent), no new effect.
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


@final
@dataclass(frozen=True, eq=False)
class _Rung:
    suspect: Suspect | None
    fit: Fit
    delta_bic: float


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
    suspects, unscored = score(BasePoint(fit), _left(candidates, fit), threads)
    first, now = suspects, suspects
    steps: list[Step] = []
    refined: list[str] = []
    error = error_on(fit, held.record)
    bar = SIGNIFICANT if held.record is not None else SHORT
    for _ in range(_MOST_ROUNDS):
        likely = [s for s in now if s.p_value < bar]
        if not likely and structure(fit, noise_floor(fit)).left:
            # A residual that comes in a few bursts leaves no score significant: let refits tell.
            likely = [s for s in now if s.score > _TELLING][:3]
        # An exponent may be wrong where no absent effect looks likely.
        rungs = [r for r in _refinements(fit) if r.delta_bic > STRONG]
        if not likely and not rungs:
            break
        short = _shortlist(likely, now) if likely else []
        if short and not any(r.fit.rms <= 1.01 * short[0].predicted_rms for r in rungs):
            # No exponent of the base model alone does as well as the likeliest effect would.
            tell(f"refitting with {', '.join(s.name for s in short)}")
            rungs += _refits(fit, short, threads)
        rungs = _judged(fit, rungs)
        taken: _Rung | None = None
        for rung in rungs:
            after = error_on(rung.fit, held.record)
            if rung.fit.rms < (1.0 - _WORTH) * fit.rms and agrees(error, after):
                taken = rung
                break
        if taken is None:
            break
        if taken.suspect is None:
            freed = [n for n in taken.fit.question.free if n not in fit.question.free]
            refined += freed
            tell(f"freed {', '.join(freed)}")
        elif (same := _sibling(taken.suspect, steps, suspects)) is not None:
            # The same physics in a shape that one member alone does not have.
            steps[same] = replace(
                steps[same],
                group=tuple(dict.fromkeys((*steps[same].group, taken.suspect.name))),
                rms_after=taken.fit.rms,
                held_out_after=rms(after),
                delta_bic=steps[same].delta_bic + taken.delta_bic,
                fit=taken.fit,
            )
            tell(f"{steps[same].name} shaped further by {taken.suspect.name}")
        else:
            steps.append(
                Step(
                    name=taken.suspect.name,
                    effect=taken.suspect.effect,
                    group=_group(taken, rungs, now),
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
        now, _ = score(BasePoint(fit), _left(candidates, fit), threads)
    fit, kept, dropped = _prune(fit, steps)
    return Ladder(
        baseline,
        fit,
        tuple(kept),
        by_name(first),
        unscored,
        by_name(now),
        tuple(refined),
        tuple(dropped),
    )


def bic_gain(before: Fit, after: Fit, samples: float | None = None) -> float:
    """By how much BIC falls from one fit to a richer one, on as many samples as carry news.

        N_e ln(SSR_0 / SSR_1) - (k_1 - k_0) ln N_e

    with N_e the effective number of samples, from the richer fit's residuals unless given.
    Rivals are compared with the same N_e.

    Source: Schwarz (1978), Annals of Statistics 6(2), 461-464.
    """
    n = effective_samples(after.residuals) if samples is None else samples
    ssr0 = float(before.residuals @ before.residuals)
    ssr1 = float(after.residuals @ after.residuals)
    if not np.isfinite(ssr1) or ssr1 <= 0:
        return -np.inf
    more = len(after.names) - len(before.names)
    return n * float(np.log(ssr0 / ssr1)) - more * float(np.log(max(n, 2.0)))


def _judged(before: Fit, rungs: Sequence[_Rung]) -> list[_Rung]:
    """Rungs with strong evidence, best first, on the samples that the closest fit leaves free."""
    if not rungs:
        return []
    closest = min(rungs, key=lambda r: r.fit.rms)
    n = effective_samples(closest.fit.residuals)
    judged = [replace(r, delta_bic=bic_gain(before, r.fit, n)) for r in rungs]
    return sorted((r for r in judged if r.delta_bic > STRONG), key=lambda r: -r.delta_bic)


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


def _left(candidates: Sequence[Effect], fit: Fit) -> list[Effect]:
    return [e for e in candidates if e.name not in fit.model]


def _shortlist(likely: Sequence[Suspect], everybody: Sequence[Suspect]) -> list[Suspect]:
    """The best few, each by what it would explain, and their look-alikes.

    A derivative at the null is a poor picture of a pure lag; whoever looks like a likely suspect
    is refitted too.
    """
    top = likely[0].score
    short = [s for s in likely if s.score > 0.1 * top][:_SHORTLIST]
    for suspect in everybody:
        if len(short) >= _SHORTLIST + 2:
            break
        listed = suspect.wrong_side or any(s.name == suspect.name for s in short)
        alike = any(abs(float(suspect.direction @ s.direction)) > _KIN for s in short[:3])
        if alike and not listed:
            short.append(suspect)
    return short


def refit(fit: Fit, suspect: Suspect, iterations: int = 40) -> Fit:
    """The model with a suspect, started at its one-step size, shapes free."""
    model = fit.model + suspect.effect
    name = model.names[-1]
    gate = suspect.effect.parameters[suspect.effect.gate or ""]
    size = float(np.clip(suspect.size, *gate.bounds))
    start = {
        **fit.values,
        **{f"{name}.{k}": v for k, v in suspect.shapes.items()},
        f"{name}.{suspect.effect.gate}": size,
    }
    return _solved(fit.question.with_model(model), start, iterations)


def _solved(question: Identification, start: Mapping[str, float], iterations: int) -> Fit:
    """A fit good enough to compare models by; an interrupt ends the ladder, not only this fit."""
    fit = solve(
        question,
        start=start,
        solver=LevenbergMarquardt(iterations=iterations, tolerance=1e-6),
        transcription=SingleShooting(refine=False),
    )
    if fit.outcome.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    return fit


def _refits(fit: Fit, short: Sequence[Suspect], threads: int) -> list[_Rung]:
    def one(suspect: Suspect) -> _Rung | None:
        try:
            richer = refit(fit, suspect, _FIRST)
        except (ArithmeticError, ValueError):
            return None
        return _Rung(suspect, richer, bic_gain(fit, richer))

    def further(rung: _Rung) -> _Rung:
        richer = _solved(rung.fit.question, rung.fit.values, _LATER)
        return replace(rung, fit=richer, delta_bic=bic_gain(fit, richer))

    with ThreadPoolExecutor(max_workers=threads) as pool:
        rungs = [rung for rung in pool.map(one, short) if rung is not None]
        if not rungs:
            return []
        # Only those that are still in the race are followed to their end.
        near = _RACE * min(r.fit.rms for r in rungs)
        ended = [r for r in rungs if r.fit.rms > near or r.fit.outcome.success]
        running = [r for r in rungs if r.fit.rms <= near and not r.fit.outcome.success]
        return [*ended, *pool.map(further, running)]


def _refinements(fit: Fit) -> list[_Rung]:
    """The base model's own exponents freed: a loop of another roundness is no missing effect."""
    rungs = []
    for name, effect in fit.model:
        for own, parameter in effect.parameters.items():
            full = f"{name}.{own}"
            exponent = parameter.fixed and parameter.unit == "1" and effect.structural
            if exponent and full not in fit.question.free and full not in fit.question.fixed:
                question = replace(fit.question, free=(*fit.question.free, full))
                start = {**fit.values, full: parameter.nominal + 0.05}
                richer = _solved(question, start, _FIRST + _LATER)
                rungs.append(_Rung(None, richer, bic_gain(fit, richer)))
    return rungs


def _group(taken: _Rung, rungs: Sequence[_Rung], suspects: Sequence[Suspect]) -> tuple[str, ...]:
    """Refitted rivals within strong evidence of the best, and directions nearly parallel to it."""
    assert taken.suspect is not None
    names = [taken.suspect.name]
    for rung in rungs:
        if rung.suspect is not None and taken.delta_bic - rung.delta_bic < STRONG:
            names.append(rung.suspect.name)
    refitted = {r.suspect.name for r in rungs if r.suspect is not None}
    for suspect in suspects:
        if suspect.name not in refitted and not suspect.wrong_side:
            cosine = abs(float(suspect.direction @ taken.suspect.direction))
            if cosine > 0.995:
                names.append(suspect.name)
    return tuple(dict.fromkeys(names))


def _prune(fit: Fit, steps: list[Step]) -> tuple[Fit, list[Step], list[str]]:
    """Drop what a later step made unnecessary: BIC does not rise without it."""
    kept, dropped = list(steps), []
    for step in steps[:-1]:
        name = next((n for n, e in fit.model if e is step.effect or n == step.name), None)
        if name is None:
            continue
        poorer = _solved(fit.question.with_model(fit.model.without(name)), fit.values, _LATER)
        if bic_gain(poorer, fit) < 0.5 * STRONG:
            fit = poorer
            kept.remove(step)
            dropped.append(step.name)
    return fit, kept, dropped
