"""Two effects at once, where one after the other ends in what nothing explains.

Two effects together may explain what neither of them does alone: beside a base model that lacks
the second, the first looks like something else, and what is found then stands in the way of both.
So candidates are fitted two at a time, each beside a base model that has not been bent to do
without them: of every two of the likeliest those that the sensitivities of both, each fitted alone,
explain best together. A pair is believed only if it leaves nothing but noise, on both records,
where one step after the other left far more.

Source: Miller (2002), Subset Selection in Regression, 2nd ed., ch. 3 (two variables that predict
together and neither alone; searches over pairs beside sequential ones).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import BasePoint, base_point
from piezo_opt.diagnosis.choice import nothing_to_win
from piezo_opt.diagnosis.detail import in_detail
from piezo_opt.diagnosis.exchange import exchange
from piezo_opt.diagnosis.held_out import FOREIGN, HeldOut, elsewhere, rms
from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.refinements import (
    EXPLAINED,
    lean,
    plausible,
    with_base_details,
)
from piezo_opt.diagnosis.rung import STRONG, Rung, Trial, bic_gain, judged, race
from piezo_opt.diagnosis.steps import Step
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.diagnosis.structure import structure
from piezo_opt.effects.base import Effect, Place
from piezo_opt.effects.model import Model
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.effects.motion.spring import Spring
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit, Identification
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.starting import starting_values

FloatArray = NDArray[np.float64]

_MOST = 14
"""Candidates that are paired."""
_SAME = 0.98
"""Cosine between what two candidates change alone, from which one of them is paired for both."""
_FITTED = 24
"""Pairs that are fitted. To first order what explains all was among the best fifteen of 90."""
_FOLLOWED = 12
"""Pairs that are fitted to their end: where nothing explains a record most are equally poor."""
_FINISHED = 3
"""Pairs that are brought to their best."""
_SLOW = 1.5
"""Error over the floor up to which what shows no structure may be slow noise."""
_TENTH = 0.1
"""Held-out error over that of the ladder's end up to which a pair reaches beyond its record."""


@final
@dataclass(frozen=True, eq=False)
class _Alone:
    """A candidate alone beside the base model at the foot.

    Attributes:
        effect: the candidate.
        ground: the mechanics that joined for its sake, None where it needs none.
        trial: its question and its start.
        fit: its fit.
    """

    effect: Effect
    ground: Effect | None
    trial: Trial
    fit: Fit


def pair(
    foot: Fit,
    end: Fit,
    held: HeldOut,
    candidates: Sequence[Effect],
    threads: int,
    *,
    known: Sequence[Rung] = (),
) -> tuple[Fit, list[Step]] | None:
    """Two effects that leave nothing but noise where a ladder left more; None where none do.

    Args:
        foot: the fit at the foot of the ladder.
        end: the fit at its end.
        held: what decides beside BIC.
        candidates: effects that may be added; each form of one is one.
        threads: refits that run at a time.
        known: refits of one effect alone from a fresh start, of which none is made twice.

    Returns:
        the fit with both, and the two steps, the one that does more alone first.
    """
    likely = _likely(foot, _alone(foot, held.question, candidates, known, threads))
    asked = _promising(held.question, likely, threads)
    rungs = [r for r in race(end, asked, threads, most=_FOLLOWED) if plausible(r)]
    closest = sorted(rungs, key=_rms)[:_FINISHED]
    finished = [_finished(foot, end, rung, threads) for rung in closest[:1]]
    if finished and not nothing_to_win(finished[0].fit):
        with Pool(max_workers=threads) as pool:
            finished += pool.map(lambda r: _finished(foot, end, r, threads), closest[1:])
    # One of so many was looked for.
    price = STRONG + 2.0 * float(np.log(max(1, len(likely) * (len(likely) - 1) // 2)))
    believed = [
        rung for rung in judged(end, finished)
        if rung.delta_bic > price and _believed(rung.fit, end, held)
    ]  # fmt: skip
    if not believed:
        return None
    best = believed[0].fit
    names = list(dict.fromkeys(a.effect.name for a in likely if a.effect.name in best.model))
    steps = [_step(foot, best, name) for name in names]
    fit, steps, _ = exchange(foot, best, steps, held, candidates, threads, anew=True)
    return fit, steps


def _alone(
    foot: Fit,
    question: Identification,
    candidates: Iterable[Effect],
    known: Sequence[Rung],
    threads: int,
) -> list[_Alone]:
    """Each candidate fitted alone from a fresh start, with mechanics where it needs some."""
    channels = tuple(question.campaign.records[0].channels)
    fitted = {rung.fit.model: rung for rung in known}
    asked = {
        _on(question.model, ground) + effect: (effect, ground)
        for effect in candidates for ground in _grounds(question.model, effect, channels)
    }  # fmt: skip

    def begun(model: Model) -> Trial | None:
        joined = question.with_model(model)
        with suppress(*NO_FIT):
            return Trial(joined, starting_values(joined, Monitor(())))
        return None

    with Pool(max_workers=threads) as pool:
        new = pool.map(begun, [model for model in asked if model not in fitted])
        trials = [trial for trial in new if trial is not None]
    rungs = race(
        foot, trials, threads, most=len(asked), podium=_MOST,
        begun=[fitted[model] for model in asked if model in fitted],
    )  # fmt: skip
    return [_Alone(*asked[rung.fit.model], rung.trial, rung.fit) for rung in rungs]


def _grounds(model: Model, effect: Effect, channels: tuple[str, ...]) -> list[Effect | None]:
    """Mechanics on which a candidate can act: those of the model, or what may join it."""
    if model.refusal(effect, channels) is None:
        return [None]
    if not model.quasi_static:  # it lacks something else, a loop say, which no mechanics bring
        return []
    joining: list[Effect] = [SecondOrder()]
    if effect.place is Place.MOTION:
        joining.append(Spring())
    return [g for g in joining if (model + g).refusal(effect, channels) is None]


def _on(model: Model, ground: Effect | None) -> Model:
    return model if ground is None else model + ground


def _likely(foot: Fit, alone: Sequence[_Alone]) -> list[_Alone]:
    """The candidates that do most alone, one of those that do the same."""
    taken: list[_Alone] = []
    changes: list[FloatArray] = []
    for one in sorted(alone, key=lambda a: a.fit.rms):
        change = foot.residuals - one.fit.residuals
        unit = change / (float(np.linalg.norm(change)) or 1.0)
        if len(taken) < _MOST and all(abs(float(unit @ other)) < _SAME for other in changes):
            taken.append(one)
            changes.append(unit)
    return taken


def _promising(question: Identification, likely: Sequence[_Alone], threads: int) -> list[Trial]:
    """The pairs that explain most to first order, at the fit of the one or of the other alone."""

    def left(trial: tuple[Trial, BasePoint, BasePoint]) -> float:
        _, first, second = trial
        return min(first.left_beside(second), second.left_beside(first))

    points = [(one, point) for one in likely if (point := base_point(one.fit)) is not None]
    asked = [
        (trial, first, second)
        for (a, first), (b, second) in combinations(points, 2)
        if (trial := _both(question, a, b)) is not None
    ]
    with Pool(max_workers=threads) as pool:
        errors = list(pool.map(left, asked))
    return [asked[k][0] for k in np.argsort(errors, kind="stable")[:_FITTED]]


def _both(question: Identification, a: _Alone, b: _Alone) -> Trial | None:
    """Two candidates beside one base model; None for one candidate twice, or on two mechanics."""
    grounds = {type(one.ground): one.ground for one in (a, b) if one.ground is not None}
    if a.effect.name == b.effect.name or len(grounds) > 1:
        return None
    ground = next(iter(grounds.values()), None)
    joined = _on(question.model, ground)
    first, second = (a, b) if a.ground is not None else (b, a)
    start = {**second.trial.start, **first.trial.start}
    refines = joined.names[len(question.model.names) :]
    trial = Trial(question.with_model(joined + a.effect + b.effect), start)
    # What was freed in vain is fixed again, and says nothing against the pair.
    return replace(with_base_details(trial), refines=refines)


def _finished(foot: Fit, end: Fit, rung: Rung, threads: int) -> Rung:
    """A pair in the detail that it pays for."""
    best = in_detail(lean(foot, rung, threads).fit, threads)
    return replace(rung, fit=best, delta_bic=bic_gain(end, best))


def _believed(fit: Fit, end: Fit, held: HeldOut) -> bool:
    """Whether a pair leaves but noise, and carries over to the other record."""
    floor = noise_floor(fit)
    noise = fit.rms <= EXPLAINED * floor.rms or (
        fit.rms <= _SLOW * floor.rms and not structure(fit, floor).left
    )
    if not noise:
        return False
    before, after = rms(elsewhere(end, held)), rms(elsewhere(fit, held))
    if before is None or after is None:
        return True
    # Beyond what the fitted record shows, exact values may still miss; wrong ones miss as before.
    return after < before and after < max(FOREIGN * fit.rms, _TENTH * before)


def _step(foot: Fit, fit: Fit, name: str) -> Step:
    """A step whose errors are still to be told."""
    return Step(name, fit.model[name], (name,), foot.rms, fit.rms, None, None, 0.0, 1.0, fit)


def _rms(rung: Rung) -> float:
    return rung.fit.rms
