"""What a later step made unnecessary, dropped from the ladder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from piezo_opt.diagnosis.contest import forgetful
from piezo_opt.diagnosis.held_out import HeldOut, error_on, rms
from piezo_opt.diagnosis.rung import STRONG, Trial, bic_gain, race
from piezo_opt.diagnosis.steps import Step, renamed, without
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit, Identification
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.starting import joint_start, starting_values
from piezo_opt.values import Values


def prune(
    fit: Fit, steps: Sequence[Step], held: HeldOut, threads: int
) -> tuple[Fit, list[Step], list[str]]:
    """Drop what a later step, or mechanics that joined, made unnecessary: BIC does not rise.

    A first step may have taken the place of the loop while the loop stood in for what was found
    later; so each is tried without also from fresh starts, those included in which the loop and
    a later step are searched together.
    """
    kept, dropped = list(steps), []
    joined = any(e.structural and n not in held.question.model for n, e in fit.model)
    for name in [step.name for step in steps]:
        # By name: a step that follows a dropped one is another object with what that one had won.
        step = next(one for one in kept if one.name == name)
        named = {other.name for other in kept}
        shapes = [n for n in step.group[1:] if n in fit.model and n not in named]
        last = step is kept[-1] and not shapes and not joined
        if name not in fit.model or last:
            continue  # the last one was judged with all the others present
        model = fit.model.without(name)
        fresh = forgetful(fit, held.question).with_model(model)
        later = [n for n, effect in model if not effect.structural]
        trials = [Trial(fit.question.with_model(model), fit.values)]
        for begin in (starting_values, *(_jointly(n) for n in later)):
            with suppress(PiezoOptError, ArithmeticError, ValueError):
                trials.append(Trial(fresh, begin(fresh, Monitor(()))))
        poorer = [rung.fit for rung in race(fit, trials, threads)]
        if not poorer:
            continue
        least = min(poorer, key=lambda f: f.rms)
        if bic_gain(least, fit) < 0.5 * STRONG:
            fit = least
            left = renamed(kept, step, shapes[0], fit) if shapes else without(kept, step)
            dropped.append(name)
            kept = [*left[:-1], *(_topped(top, fit, held) for top in left[-1:])]
    return fit, kept, dropped


def _topped(step: Step, fit: Fit, held: HeldOut) -> Step:
    """The last step, which ends at this fit."""
    held_out = rms(error_on(fit, held.record))
    return replace(step, rms_after=fit.rms, held_out_after=held_out, fit=fit)


def _jointly(name: str) -> Callable[[Identification, Monitor], Values]:
    """Starting values in which the loop and one effect are searched together."""
    return lambda question, _: joint_start(question, name)
