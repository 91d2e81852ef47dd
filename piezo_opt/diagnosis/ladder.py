"""The ladder: add the likeliest effect, refit, let BIC and held-out data decide, repeat, prune."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.choice import (
    SHORT,
    SIGNIFICANT,
    astray,
    chosen,
    misjudged,
    nothing_to_win,
    ordered,
    refits,
    refits_afresh,
    short_of_noise,
    shows_more,
)
from piezo_opt.diagnosis.confirm import confirmed
from piezo_opt.diagnosis.detail import in_detail
from piezo_opt.diagnosis.exchange import LIKELY, Exchange, exchange, regrouped
from piezo_opt.diagnosis.grouping import group_of
from piezo_opt.diagnosis.held_out import HeldOut, agrees, elsewhere, rms
from piezo_opt.diagnosis.pairs import pair
from piezo_opt.diagnosis.prune import prune
from piezo_opt.diagnosis.refinements import lean
from piezo_opt.diagnosis.rung import STRONG, Rung, bic_gain, solved
from piezo_opt.diagnosis.scores import Suspect, Unscored, by_name
from piezo_opt.diagnosis.shortlist import scored
from piezo_opt.diagnosis.steps import Step, freedom, shaped_further, step_to, topped
from piezo_opt.diagnosis.stopping import Pool
from piezo_opt.effects.base import Effect
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit, with_statistics

FloatArray = NDArray[np.float64]

_ALIKE = 0.9
"""Cosine at the foot from which two effects are the same physics in two shapes."""
_SHAPING = 0.6
"""Error over that before below which a look-alike has done more than shape what was found."""
_PART = 0.008
"""Share of what is left that an absent effect must explain for a step to be asked for its place
once more. Of some 120 ladders none changed for less than 0.01."""
_MOST_ROUNDS = 7
_FREEDOM = 3
"""Parameters of an effect beyond which it may do what a simpler one does."""


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
        dropped: effects that a later step made unnecessary, or one that does better than all; and
            mechanics that only imitated what was missing.
        interrupted: whether it was stopped on the way: the best so far.
    """

    baseline: Fit
    final: Fit
    steps: tuple[Step, ...]
    suspects: tuple[Suspect, ...]
    unscored: tuple[Unscored, ...]
    refined: tuple[str, ...]
    dropped: tuple[str, ...]
    interrupted: bool = False


@final
@dataclass(frozen=True, eq=False)
class _Stand:
    """How far a ladder has been climbed.

    Attributes:
        fit: the fit there.
        error: its held-out errors [m].
        now: scores of what is absent there.
        steps: accepted effects.
        refined: what was needed in more detail.
        dropped: what became unnecessary (see :class:`Ladder`).
        touched: whether the model has changed since its last step was judged.
        alone: every effect by itself beside a base that is not bent, where that was asked.
        scored_at: the fit that ``now`` was taken at, where it was.
        unconfirmed: where it stood before a first step that the other record does not want.
    """

    fit: Fit
    error: FloatArray | None
    now: tuple[Suspect, ...]
    steps: tuple[Step, ...] = ()
    refined: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()
    touched: bool = False
    alone: tuple[Rung, ...] = ()
    scored_at: Fit | None = None
    unconfirmed: _Stand | None = None


@final
@dataclass(frozen=True, eq=False)
class _Climb:
    """A ladder's foot, and what decides on the way up.

    Attributes:
        foot: the fit at the foot.
        suspects: scores of all candidates there.
        held: what decides beside BIC.
        candidates: effects that may be added.
        tell: called with a sentence about what is going on.
        threads: refits that run at a time.
    """

    foot: Fit
    suspects: tuple[Suspect, ...]
    held: HeldOut
    candidates: Sequence[Effect]
    tell: Callable[[str], None]
    threads: int

    def scored(self, at: _Stand) -> _Stand:
        """With the scores of what is absent there."""
        if at.scored_at is at.fit:
            return at
        now, _ = scored(at.fit, self.candidates, self.threads)
        return replace(at, now=now, scored_at=at.fit)

    def onto(self, at: _Stand, fit: Fit) -> _Stand:
        """With another fit, and its held-out errors."""
        return replace(at, fit=fit, error=elsewhere(fit, self.held))

    def choice(
        self, at: _Stand
    ) -> tuple[_Stand, tuple[Rung, FloatArray | None, tuple[str, ...]] | None]:
        """What is taken next, its held-out errors, and the group of an effect; None for nothing.

        Beside it the stand, which knows what was found out on the way.
        """
        first = not at.steps
        bar = SIGNIFICANT if self.held.record is not None else SHORT
        rungs, afresh = refits(
            at.fit, self.held, at.now, first=first, bar=bar, tell=self.tell, threads=self.threads,
            known=at.alone,
        )  # fmt: skip
        at = replace(at, alone=tuple(afresh)) if first and afresh else at
        ranked = ordered(rungs, self.held, self.threads)
        taken = chosen(at.fit, at.error, ranked, self.held, first=first)
        if taken is None:
            return at, None
        rung, after = taken
        group = () if rung.suspect is None else group_of(at.fit, rung, rungs, at.now)
        return at, (rung, after, group)

    def afresh(self, at: _Stand) -> _Stand | None:
        """One effect from a fresh start that does better than all steps; None where none does.

        What is refitted from where the foot had been bent to, and who is near the best of those,
        decides which effects are brought to their best. Where that has ended short of the noise,
        the right one may have been left behind.
        """
        bottom = _Stand(
            self.foot, elsewhere(self.foot, self.held), self.suspects, alone=at.alone,
            scored_at=self.foot,
        )  # fmt: skip
        rungs = refits_afresh(
            self.foot, self.held, self.suspects, self.tell, self.threads, known=at.alone
        )
        better = [r for r in rungs if r.suspect is not None and bic_gain(at.fit, r.fit) > STRONG]
        ranked = ordered(better, self.held, self.threads)
        taken = chosen(self.foot, bottom.error, ranked, self.held, first=True)
        if taken is None:
            return None
        rung, after = taken
        ahead, here = rms(after), rms(at.error)
        if ahead is not None and here is not None and ahead > here:
            return None
        assert rung.suspect is not None
        group = group_of(self.foot, rung, rungs, self.suspects)
        gone = tuple(step.name for step in at.steps if step.name != rung.suspect.name)
        stand = self.revised(bottom, self.named(bottom, rung, after, group))
        return replace(stand, dropped=(*at.dropped, *gone, *stand.dropped))

    def detailed(self, at: _Stand) -> _Stand:
        """With all the detail that it pays for, where that reaches the other record no worse."""
        finer = in_detail(at.fit, self.threads)
        error = elsewhere(finer, self.held)
        if finer is at.fit or not (at.error is None or agrees(at.error, error, np.inf)):
            return at
        freed = _freed(at.fit, finer)
        self.tell(f"refined {', '.join(freed)}")
        top = [topped(step, finer, rms(error)) for step in at.steps[-1:]]
        stand = replace(
            at, fit=finer, error=error, refined=(*at.refined, *freed), touched=True,
            steps=(*at.steps[:-1], *top),
        )  # fmt: skip
        return self.scored(stand)

    def together(self, at: _Stand) -> _Stand | None:
        """Two effects at once in the place of all steps; None where no two do."""
        self.tell("fitting two effects at a time")
        both = pair(self.foot, at.fit, self.held, self.candidates, self.threads, known=at.alone)
        if both is None:
            return None
        fit, steps = both
        names = [step.name for step in steps]
        self.tell(f"accepted {' and '.join(names)} together")
        gone = tuple(step.name for step in at.steps if step.name not in names)
        stand = replace(
            at, steps=tuple(steps), refined=(*at.refined, *_freed(self.foot, fit)),
            dropped=(*at.dropped, *gone), unconfirmed=None, touched=True,
        )  # fmt: skip
        return self.scored(self.onto(stand, fit))

    def refined(self, at: _Stand, rung: Rung, after: FloatArray | None) -> _Stand:
        """With what the model has already in more detail."""
        self.tell(f"refined {', '.join(rung.trial.refines)}")
        more = (*at.refined, *rung.trial.refines)
        return replace(at, fit=rung.fit, error=after, refined=more, touched=True)

    def led(self, at: _Stand, alone: Fit, suspect: Suspect) -> _Stand:
        """With a fit that is better without another name."""
        self.tell(f"refitted from where {suspect.name} had led")
        stand = self.onto(at, alone)
        *below, top = stand.steps
        steps = (*below, topped(top, alone, rms(stand.error)))
        more = (*at.refined, *_freed(at.fit, alone))
        return replace(stand, steps=steps, refined=more, touched=True)

    def named(
        self, at: _Stand, rung: Rung, after: FloatArray | None, group: tuple[str, ...]
    ) -> _Stand:
        """With another effect: a step of its own, or the shape of one that there is."""
        suspect = rung.suspect
        assert suspect is not None
        first = None if at.steps or agrees(at.error, after, at.fit.rms) else at
        stood = (name for name, _ in self.foot.model if name in at.fit.model)
        spare = tuple(name for name in stood if name not in rung.fit.model)
        if spare:
            self.tell(f"dropped {', '.join(spare)}")
        # Rivals pay for the base model's details, so the taken one was compared with them too.
        rung = lean(at.fit, rung, self.threads)
        with Pool(max_workers=1) as pool:
            ahead = pool.submit(elsewhere, rung.fit, self.held)
            alone = _unaided(rung) if at.steps else None
            error = ahead.result()
        if alone is not None:
            return self.led(at, alone, suspect)
        halved = rung.fit.rms < _SHAPING * at.fit.rms
        same = None if halved else _sibling(suspect, at.steps, self.suspects)
        if same is None:
            steps = [*at.steps, step_to(at.fit, at.error, rung, error, group)]
            self.tell(f"accepted {suspect.name}")
        else:
            steps = shaped_further(at.steps, same, rung, error)
            self.tell(f"{at.steps[same].name} shaped further by {suspect.name}")
        return replace(
            at, fit=rung.fit, error=error, steps=tuple(steps), dropped=(*at.dropped, *spare),
            refined=(*at.refined, *_of_base(at.fit, rung.fit)), touched=False,
            unconfirmed=at.unconfirmed if at.steps else first,
        )  # fmt: skip

    def revised(self, before: _Stand, at: _Stand) -> _Stand:
        """Without what became unnecessary, and with each earlier step asked for its place."""
        joined = any(e.structural and n not in before.fit.model for n, e in at.fit.model)
        if not at.steps or at.steps == before.steps:
            return self.placed(at, self.asked(at, last=joined))
        with Pool(max_workers=2) as pool:
            # Mostly nothing became unnecessary: what comes after is asked before that is known.
            places = pool.submit(self.asked, at, last=joined)
            scores = pool.submit(self.scored, at)
            fewer = self.pruned(at)
            answer, at = places.result(), scores.result()
        if len(fewer.dropped) > len(at.dropped):
            return self.placed(fewer, self.asked(fewer, last=True))
        return self.placed(at, answer)

    def asked(self, at: _Stand, *, last: bool) -> Exchange:
        """Whoever does better in the place of each step.

        Where nothing is left to be won, only a law that could imitate a simpler one is asked.
        """
        settled = nothing_to_win(at.fit)
        return exchange(
            self.foot, at.fit, at.steps, self.held, self.candidates, self.threads,
            last=last and not settled, beyond=_FREEDOM if settled else 0,
        )  # fmt: skip

    def pruned(self, at: _Stand, *, last: bool = False) -> _Stand:
        """Without the steps that it can do without."""
        fit, steps, spare = prune(at.fit, at.steps, self.held, self.threads, last=last)
        if not spare:
            return replace(at, fit=fit, steps=tuple(steps))
        self.tell(f"dropped {', '.join(spare)}")
        stand = replace(at, steps=tuple(steps), dropped=(*at.dropped, *spare))
        return self.onto(stand, fit)

    def placed(self, at: _Stand, answer: Exchange) -> _Stand:
        """With each step in the form of whoever does better in its place."""
        fit, steps, gone = answer
        if not gone:
            return replace(at, fit=fit, steps=tuple(steps))
        self.tell(f"exchanged {', '.join(f'{old} for {new}' for old, new in gone)}")
        stand = replace(
            at, steps=tuple(steps), refined=(*at.refined, *(o for o, n in gone if o == n)),
            touched=at.touched or any(old != new for old, new in gone),
        )  # fmt: skip
        return self.onto(stand, fit)

    def lost(self, at: _Stand, *, ended: bool = False) -> bool:
        """Whether several effects, or where it ended as many as there are, are not the answer."""
        several = len(at.steps) > 1
        return (ended or several) and astray(at.fit, self.held, several=several)

    def reconsidered(self, at: _Stand) -> _Stand:
        """With each step asked for its place, where what is left is not noise to all.

        An effect that still explains a significant part, too small for a name, may be what a step
        stands for, also where it explained nothing before. A lone step that brought mechanics was
        compared with effects that had none. And of several that miss the other record the last one
        may have been taken before its rivals were brought as far; where they miss it by less, those
        that the record did not tell from a step before the others were there are asked.
        """
        joined = any(e.structural and n not in self.foot.model for n, e in at.fit.model)
        fresh = self.scored(at)
        likely = {s.name for s in fresh.now if s.p_value < LIKELY and s.score > _PART}
        lost = self.lost(at)
        if len(at.steps) > 1 and misjudged(at.fit, self.held):
            likely |= {name for step in at.steps for name in step.group if name != step.name}
        if not likely and not lost:
            return fresh
        answer = exchange(
            self.foot, fresh.fit, fresh.steps, self.held, self.candidates, self.threads,
            last=joined or len(at.steps) == 1 or lost, also=likely,
        )  # fmt: skip
        return self.placed(fresh, answer)

    def grouped(self, at: _Stand) -> _Stand:
        """With the groups of the earlier steps as the record tells them beside the later ones."""
        return replace(
            at, steps=tuple(regrouped(self.foot, at.fit, at.steps, self.candidates, self.threads))
        )


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

    Returns:
        the ladder; after an interrupt as far as it had been climbed.
    """
    tell("scoring every absent effect")
    suspects, unscored = scored(baseline, candidates, threads)
    way = _Climb(baseline, suspects, held, candidates, tell, threads)
    at = _Stand(baseline, elsewhere(baseline, held), suspects, scored_at=baseline)
    reached = [at]
    interrupted = False
    try:
        at = _to_the_top(way, at, reached)
    except KeyboardInterrupt:
        at, interrupted = reached[-1], True
    return Ladder(
        baseline,
        at.fit,
        tuple(_as_it_ended(step, at.fit) for step in at.steps),
        by_name(suspects),
        tuple(u for u in unscored if u.name not in at.fit.model),
        tuple(name for name in at.refined if name.split(".")[0] in at.fit.model),
        at.dropped,
        interrupted,
    )


def _to_the_top(way: _Climb, at: _Stand, reached: list[_Stand]) -> _Stand:
    """The stand where nothing more is to be won; ``reached`` gets every one on the way."""
    baseline, held, tell = way.foot, way.held, way.tell
    bottom = at.error
    ended = paired = renewed = False
    settled: _Stand | None = None
    for _ in range(_MOST_ROUNDS):
        reached.append(at)
        lost = not paired and way.lost(at, ended=ended)
        if lost and not ended:
            at = way.detailed(at)
            lost = way.lost(at)
        if lost and len(at.steps) > 1:
            # One of them may stand for another effect, which is asked in far less time than pairs.
            settled = way.reconsidered(at)
            at = way.scored(settled)
            lost = way.lost(at)
        if lost and not (at.steps or renewed):
            # Where nothing was found one effect from a fresh start is asked in far less time, too.
            renewed = True
            again = way.afresh(at)
            if again is not None:
                at, ended = again, nothing_to_win(again.fit)
                continue
        if lost:
            paired = True
            # A pair is believed for what it explains here, whatever it does for the other record.
            both = way.together(at) if shows_more(at.fit) else None
            at, ended = (at, ended) if both is None else (both, False)
        if ended:
            lone = len(at.steps) == 1
            short = (lone and _liberal(at)) or short_of_noise(at.fit, held, lone=lone)
            again = way.afresh(at) if short and not renewed else None
            if again is None:
                break
            renewed = True
            at, ended = again, nothing_to_win(again.fit)
            continue
        at, taken = way.choice(at)
        if taken is None:
            ended = True
            continue
        rung, after, group = taken
        if rung.suspect is None:
            richer = way.refined(at, rung, after)
        else:
            richer = way.named(at, rung, after, group)
        reached.append(richer)
        at = way.revised(at, richer)
        ended = nothing_to_win(at.fit)
        if ended and _muted(at.fit):
            # What repeats with the position looks like noise, its harmonics above all.
            at = way.detailed(at)
            ended = nothing_to_win(at.fit)
        if not ended:
            at = way.scored(at)
    reached.append(at)
    if at.steps and (settled is None or settled.fit is not at.fit):
        at = way.reconsidered(at)
    if at.steps and at.touched:
        at = way.pruned(at, last=True)
    if (
        at.steps
        and at.unconfirmed
        and not (agrees(bottom, elsewhere(at.fit, held)) or confirmed(baseline, at.fit, held))
    ):
        # Not even with all that came after it does the other record want it.
        tell(f"refused {', '.join(step.name for step in at.steps)}")
        at = at.unconfirmed
    if nothing_to_win(at.fit):
        at = way.grouped(at)
    return at


def _liberal(at: _Stand) -> bool:
    """Whether the first name has more parameters than it takes to do what a simpler one does."""
    return freedom(at.fit, at.steps[0].name) > _FREEDOM


def _unaided(rung: Rung) -> Fit | None:
    """The fit without a rung's effect that does as well from where the effect had led; else None.

    A search that is stuck is led out by any effect; what it finds then needs none.
    """
    assert rung.suspect is not None
    question = rung.fit.question.with_model(rung.fit.model.without(rung.suspect.name))
    try:
        alone = solved(question, rung.fit.values)
    except NO_FIT:
        return None
    return alone if bic_gain(alone, rung.fit) < STRONG else None


def _muted(fit: Fit) -> bool:
    """Whether an effect that repeats with the position is without its harmonics."""
    for name, effect in fit.model:
        own = effect.parameters
        harmonics = [f"{name}.{k}" for k, p in own.items() if p.detail and not p.repeats]
        if any(p.repeats for p in own.values()) and not {*harmonics} <= {*fit.question.free}:
            return True
    return False


def _freed(before: Fit, after: Fit) -> list[str]:
    """What was refined on the way from one fit to another: mechanics that joined, details freed."""
    joined = [n for n, e in after.model if e.structural and n not in before.model]
    return [*joined, *(k for k in after.question.free if k not in before.question.free)]


def _as_it_ended(step: Step, top: Fit) -> Step:
    """A step with its effect in the form that the ladder ended with, and its statistics."""
    effect = dict(top.model).get(step.name, step.effect)
    return replace(step, effect=effect, fit=with_statistics(step.fit))


def _of_base(before: Fit, after: Fit) -> list[str]:
    """What was refined of the base model alone."""
    return [k for k in _freed(before, after) if after.model[k.split(".")[0]].structural]


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
