"""What a later step made unnecessary, dropped from the ladder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

from piezo_opt.diagnosis.contest import forgetful
from piezo_opt.diagnosis.held_out import HeldOut, elsewhere, rms
from piezo_opt.diagnosis.refinements import plausible, shape_refinements, with_base_details
from piezo_opt.diagnosis.rung import STRONG, WORTH, Trial, bic_gain, numbers, race, solved
from piezo_opt.diagnosis.steps import Step, renamed, topped, without
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit, Identification
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.starting import joint_start, starting_values
from piezo_opt.values import Values

_NEARLY = 4.0
"""Error without an effect over that with it up to which a longer search, or more detail, may make
up for it: a lag of two poles for a delay, where one of a single pole leaves 3.6 times as much."""


def prune(
    fit: Fit, steps: Sequence[Step], held: HeldOut, threads: int, *, last: bool = False
) -> tuple[Fit, list[Step], list[str]]:
    """Drop what a later step, a detail, or mechanics that joined, made unnecessary.

    A first step may have taken the place of the loop while the loop stood in for what was found
    later; so each is tried without also from fresh starts, those included in which the loop and
    a later step are searched together, and with the later steps in more detail.

    Args:
        fit: the fit with all the steps.
        steps: accepted effects.
        held: what decides beside BIC.
        threads: refits that run at a time.
        last: whether the model has changed since the last step was judged; else it stays, unless
            mechanics joined or another step goes.

    Returns:
        the fit, the steps that are left, and the names of those that are not.
    """
    kept = list(steps)
    dropped: list[str] = []
    joined = any(e.structural and n not in held.question.model for n, e in fit.model)
    names = [step.name for step in steps]
    while kept:
        judged = not (_shapes(kept[-1], kept, fit) or joined or last or dropped)
        asked = [n for n in names if n in fit.model and not (judged and n == kept[-1].name)]
        with Pool(max_workers=threads) as pool:
            tried = list(pool.map(partial(_without, fit, held, threads), asked))
        spare = {
            name: least for name, least in zip(asked, tried, strict=True)
            if least is not None and _spare(least, fit, held)
        }  # fmt: skip
        if not spare:
            break
        # Of two that can do without each other, whoever explains less goes.
        name = min(spare, key=lambda n: bic_gain(spare[n], fit))
        # By name: a step that follows a dropped one is another object with what that one had won.
        step = next(one for one in kept if one.name == name)
        shapes, fit = _shapes(step, kept, fit), spare[name]
        left = renamed(kept, step, shapes[0], fit) if shapes else without(kept, step)
        dropped.append(name)
        there = rms(elsewhere(fit, held))
        kept = [*left[:-1], *(topped(top, fit, there) for top in left[-1:])]
        # Who could not be done without beside the dropped one cannot be without it.
        names = [one.name for one in kept if one.name in spare or one is kept[-1]]
    return fit, kept, dropped


def _shapes(step: Step, steps: Sequence[Step], fit: Fit) -> list[str]:
    """Effects of a step's group that the fit has as shapes of that step."""
    named = {other.name for other in steps}
    return [n for n in step.group[1:] if n in fit.model and n not in named]


def _without(fit: Fit, held: HeldOut, threads: int, name: str) -> Fit | None:
    """The best that the model can do without one effect; None where it can do nothing."""
    model = fit.model.without(name)
    fresh = forgetful(fit, held.question).with_model(model)
    later = [n for n, effect in model if not effect.structural]
    trials = [Trial(fit.question.with_model(model), fit.values)]

    def begun(begin: Callable[[Identification, Monitor], Values]) -> Trial | None:
        with suppress(*NO_FIT):
            return Trial(fresh, begin(fresh, Monitor(())))
        return None

    with Pool(max_workers=threads) as pool:
        begins = (starting_values, *(_jointly(n) for n in later))
        trials += [trial for trial in pool.map(begun, begins) if trial is not None]
    freed = set(fit.question.free) - set(held.question.free)
    if any(fit.model[k.split(".")[0]].structural for k in freed):
        # What the fit has been given, the fits without a name have as well.
        trials = [trials[0], *(with_base_details(trial) for trial in trials[1:])]
    near = _NEARLY * fit.rms
    poorer = [rung.fit for rung in race(fit, trials, threads, hope=near)]
    if not poorer:
        return None
    least = min(poorer, key=_rms)
    if near < least.rms:
        return least
    least = _to_its_end(least)
    # Detail that costs more than the name it replaces imitates it (the start of a long chain of
    # creep elements is any smooth curve).
    finer = [r.fit for r in race(least, shape_refinements(least), threads) if plausible(r)]
    dear = numbers(fit)
    return max(
        [least, *(f for f in finer if numbers(f) <= dear)], key=lambda one: bic_gain(least, one)
    )


def _to_its_end(fit: Fit) -> Fit:
    """A fit that was still on its way, where it ends: a valley may take long to walk."""
    if fit.outcome.success:
        return fit
    try:
        return solved(fit.question, fit.values)
    except NO_FIT:
        return fit


def _spare(poorer: Fit, fit: Fit, held: HeldOut) -> bool:
    """Whether a fit does without an effect what is worth having: BIC, and the worth of a name."""
    if bic_gain(poorer, fit) < 0.5 * STRONG:
        return True
    if (1.0 - WORTH) * poorer.rms > fit.rms:
        return False
    before, after = rms(elsewhere(poorer, held)), rms(elsewhere(fit, held))
    return before is None or after is None or after > (1.0 - WORTH) * before


def _rms(fit: Fit) -> float:
    return fit.rms


def _jointly(name: str) -> Callable[[Identification, Monitor], Values]:
    """Starting values in which the loop and one effect are searched together."""
    return lambda question, _: joint_start(question, name)
