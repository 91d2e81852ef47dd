"""The book of a search: every candidate set with the best fit that was found of it.

It holds the only pool of threads. Rivals are fitted in rounds: five iterations each, then the
quarter of which a full Gauss-Newton step promises most goes on for twice as many, until all that
are left have converged (successive halving; Jamieson & Talwalkar 2016, AISTATS 51, 240-248). Who
does not promise to come near the best one is left where he is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from threading import Lock
from typing import final

import numpy as np

from piezo_opt.diagnosis.colour import Colour
from piezo_opt.diagnosis.evidence import RESOLUTION, WORTH, charge, criterion, numbers
from piezo_opt.diagnosis.members import Hypothesis, Members
from piezo_opt.diagnosis.noise import is_noise
from piezo_opt.diagnosis.refit import FIRST, ROUNDS, SETTLED, Halted, refit
from piezo_opt.diagnosis.richer import freed
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit, Identification, is_lag
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import ENOUGH_A_SAMPLE, FINEST, OF_WHAT_IS_LEFT
from piezo_opt.identification.starting import starting_values
from piezo_opt.stopping import Pool
from piezo_opt.values import Values

_KEPT = 4
"""Of so many rivals one goes on after a round."""
_DEAREST = 8
"""Sub-steps of a set over those of the foot beyond which it is not fitted, where they are more than
is enough to compare models: it would take longer than all the others together."""
_LEAST = 2
"""Rivals that are followed to the end at least."""
_DOUBT = 2.0
"""Error that a full step promises over that of the best one, beyond which a rival is left: four
times the squares. A linear model that is off by more than a factor of four is no guide in the usual
test of a step either (More 1978, Lecture Notes in Mathematics 630: a ratio below a quarter)."""
_FALLING = 0.95
"""Error over that before as many iterations again, above which a fit hardly falls any more: the
twentieth part of its error is what it would have to lose in each of them."""


@final
@dataclass(frozen=True)
class Start:
    """A set, and where a fit of it begins.

    Attributes:
        members: the set.
        values: where it begins; None for a fresh start, as if nothing had been fitted before.
    """

    members: Members
    values: Mapping[str, float] | None


@final
class Book:
    """Candidate sets and their fits.

    Args:
        foot: the fit at the foot.
        choices: candidates to choose from, for the price of having chosen.
        threads: refits that run at a time.
        better: called with the best fit, where it is another one than before.
        least: the least that an effect must explain; a fit that leaves less than that beside noise
            tells the noise's colour.
        check: called at each iteration of a fit; interrupts it where the time is over.
    """

    def __init__(
        self,
        foot: Fit,
        choices: int,
        threads: int,
        better: Callable[[Fit], None] = lambda _: None,
        least: float = WORTH,
        check: Callable[[], None] | None = None,
    ) -> None:
        self._least = least
        self.foot = foot
        self.question: Identification = foot.question
        self.base = Members.of(foot.question, foot.question)
        self.colour = Colour.white([int(r.counted.sum()) for r in foot.records])
        self.left = self.colour
        """Of what the closest fit leaves, noise or not."""
        taken = max(accuracy.per_sample for accuracy in foot.accuracy)
        self._most = max(_DEAREST * taken, ENOUGH_A_SAMPLE)
        self._concluding = False
        self.refits = 0
        self.brief = False
        """Whether no fit goes on after its first iterations."""
        self._check = check
        self._closest = self._told = foot
        self._better = better
        self._choices = choices
        self._threads = threads
        self._fits: dict[Members, Fit] = {self.base: foot}
        self._ended: dict[Members, Fit] = {}
        self._begun: set[tuple[Members, tuple[tuple[str, float], ...] | None]] = set()
        self._bases: dict[tuple[str, ...], Values | None] = {}
        self._keeping = Lock()
        self._prices: dict[Members, tuple[Fit, Colour, float]] = {}

    def hurry(self) -> None:
        """After an interrupt: what the answer still needs is fitted in its first iterations, which
        no limit ends."""
        self.brief = True
        self._check = None

    def __contains__(self, members: Members) -> bool:
        return members in self._fits

    def __getitem__(self, members: Members) -> Fit:
        return self._fits[members]

    @property
    def sets(self) -> tuple[Members, ...]:
        """All sets that were fitted, the best one first."""
        return tuple(sorted(self._fits, key=self.price))

    @property
    def leading(self) -> tuple[Members, ...]:
        """The best set of each hypothesis, the best one first."""
        best: dict[Hypothesis, Members] = {}
        for members in self.sets:
            best.setdefault(members.hypothesis, members)
        return tuple(best.values())

    @property
    def best(self) -> Members:
        """The set of the least criterion."""
        return min(tuple(self._fits), key=self.price)

    def best_with(self, names: Sequence[str]) -> Members:
        """The best set with just these effects, whatever its base."""
        return next(members for members in self.sets if members.names == tuple(names))

    @property
    def level(self) -> tuple[Members, ...]:
        """The best sets, as far as the criterion can resolve them."""
        least = self.price(self.best)
        return tuple(m for m in self.leading if self.price(m) - least < RESOLUTION)

    def price(self, members: Members) -> float:
        """The criterion of a set that was fitted."""
        fit = self._fits[members]
        known = self._prices.get(members)
        if known is None or known[0] is not fit or known[1] is not self.colour:
            known = (fit, self.colour, self._criterion(members, fit))
            self._prices[members] = known
        return known[2]

    def fall(self, less: Members, more: Members) -> float:
        """By how much the criterion falls from one set to another, whatever their mechanics do."""
        before, after = (
            criterion(self._fits[m], self.colour, len(m.effects), self._choices)
            for m in (less, more)
        )
        return before - after

    def bound(self, members: Members, more: int = 0) -> float:
        """The least criterion that a set can have, if it leaves no less than the best set does.

        Args:
            members: the set; of one that was not fitted, what it asks for at least is counted,
                without the details, which may not pay for themselves.
            more: effects beside it, of one number each at least.
        """
        best, samples = self.best, sum(self.colour.lengths)
        if members in self:
            least = numbers(self[members])
        else:
            parameters = members.model.parameters
            kept = (k for k, p in parameters.items() if p.fixed or k in self.question.fixed)
            redundant = sum(effect.redundant for _, effect in members.model)
            least = len(parameters) - sum(1 for _ in kept) - redundant
        effects = len(members.effects) + more
        asked = charge(numbers(self[best]), samples, len(best.effects), self._choices)
        least_asked = charge(least + more, samples, effects, self._choices)
        return self.price(best) - asked + least_asked

    def settled(self, members: Members) -> Fit:
        """The fit of a set, gone on with until it has converged, as far as it can be simulated."""
        fit = self._fits[members]
        ended = fit.outcome.success or self._ended.get(members) is fit
        if not (ended or self.brief or members == self.base):
            with suppress(*NO_FIT):
                self._went_on(members, fit, SETTLED)
            self._ended[members] = self._fits[members]
        return self._fits[members]

    def standing(self, members: Members, beside: Fit) -> Fit | None:
        """A set at the values of another fit; None where it cannot be simulated there."""
        question = members.question(self.question)
        with suppress(*NO_FIT):
            return refit(
                question, _own(beside.values, question), 0, mend=False, tolerance=self._tolerance
            )
        return None

    def keep(self, members: Members, fit: Fit) -> None:
        """Write a fit down, where it is the best of its set."""
        rms = fit.rms
        with self._keeping:  # two starts of one set may end in the same moment
            before = self._fits.get(members)
            if rms == rms and (before is None or rms < before.rms):
                self._fits[members] = fit

    def race(
        self,
        starts: Sequence[Start],
        *,
        everyone: bool = False,
        late: bool = False,
        beyond: float = math.inf,
    ) -> None:
        """Fit sets from their starts in rounds; who is behind is left where he is.

        A fresh start does not race against the others of its own set: these are near to where the
        last fit ended from the first round on, and may be stuck there.

        Args:
            starts: sets and where they begin.
            everyone: whether all sets may go on after a round, and not only the best quarter.
            late: whether they come to their own later than their steps promise.
            beyond: error [m] that decides: a fit that is above it and hardly falls is given up.
        """
        fresh = [start for start in starts if self._new(start)]
        with Pool(max_workers=self._threads) as pool:
            running: list[tuple[Start, Fit]] = []
            for start, fit in pool.map(self._first, fresh):
                if fit is not None:
                    running.append((start, fit))
                    self._tell()
            iterations = FIRST
            for _ in range(0 if self.brief else ROUNDS):
                ahead: dict[Members, dict[bool, tuple[Start, Fit]]] = {}
                for start, fit in running:
                    own = ahead.setdefault(start.members, {})
                    is_fresh = start.values is None
                    if is_fresh not in own or _promise(fit) < _promise(own[is_fresh][1]):
                        own[is_fresh] = start, fit
                sets = sorted(
                    ahead,
                    key=lambda m: min(self._promised(m, fit) for _, fit in ahead[m].values()),
                )
                sets = sets if everyone else sets[: max(_LEAST, -(-len(sets) // _KEPT))]
                ranked = [pair for members in sets for pair in ahead[members].values()]
                ahead_of_all = min((fit.rms for _, fit in ranked), default=math.inf)
                worst = math.inf if late else _DOUBT * min(ahead_of_all, beyond)
                open_ = [
                    (start, fit) for start, fit in ranked
                    if not fit.outcome.success and _promise(fit) <= worst
                ]  # fmt: skip
                if not open_:
                    break
                iterations *= 2
                more = list(pool.map(partial(self._further, iterations=iterations), open_))
                self._tell()
                done = [pair for pair in ranked if pair[1].outcome.success]
                running = [*done]
                for (start, before), (_, fit) in zip(open_, more, strict=True):
                    if fit is not None and fit.rms < max(beyond, _FALLING * before.rms):
                        running.append((start, fit))
        self._recolour()

    def tidy(self, starts: Sequence[Start], *, beyond: float = math.inf) -> None:
        """Fit what may say the same with less; nothing where the time is over."""
        if not self.brief:
            self.race(starts, beyond=beyond)

    def _recolour(self) -> None:
        """Take the noise's colour from the closest fit, by the criterion of white noise.

        What a set lacks is no noise: while the closest one lacks something, its colour would hide
        that, and the way is found by errors as they are.
        """
        white = Colour.white(self.colour.lengths)
        closest = min(self._fits.values(), key=lambda fit: criterion(fit, white, 0, 1))
        if closest is not self._closest:
            self._closest = closest
            self.left = Colour.of(closest.residuals, self.colour.lengths)
            noise = self._concluding or is_noise(closest, self._least)
            self.colour = self.left if noise else white
        self._tell()

    def conclude(self) -> None:
        """From now on judge by the colour of what is left, whatever it is: errors that are
        correlated do not count one a sample, and names are not given for them."""
        self._concluding = True
        self.colour = self.left

    def _tell(self) -> None:
        """Say which fit is the best one, where it is another one than before."""
        best = self._fits[self.best]
        if best is not self._told:
            self._told = best
            self._better(best)

    def fresh(self, members: Members) -> Values | None:
        """Where a first fit of a set would begin; None where nothing there can be simulated."""
        question = members.question(self.question)
        key = members.base.names
        try:
            if key not in self._bases:
                below = Members(members.base).question(self.question)
                self._bases[key] = starting_values(below, Monitor(()))
            base = self._bases[key]
            if base is None:
                return None
            record = question.campaign.records[0]
            details = {
                key: start for name, effect in members.model
                for key, start in freed(name, effect, record).items() if key in members.free
            }  # fmt: skip
            return Values({**starting_values(question, Monitor(()), base), **details})
        except NO_FIT:
            self._bases.setdefault(key, None)
            return None

    def _new(self, start: Start) -> bool:
        values = start.values
        key = (start.members, None if values is None else tuple(sorted(values.items())))
        if key in self._begun:
            return False
        self._begun.add(key)
        return True

    @property
    def _tolerance(self) -> float:
        """Error of the scheme as a share of the reading's range: a tenth of what the closest fit
        leaves."""
        span = max(float(np.ptp(record.position)) for record in self.foot.records)
        return max(FINEST, OF_WHAT_IS_LEFT * self._closest.rms / (span or 1.0))

    def _first(self, start: Start) -> tuple[Start, Fit | None]:
        values = self.fresh(start.members) if start.values is None else start.values
        if values is None:
            return start, None
        fit = None
        with suppress(*NO_FIT):
            question = start.members.question(self.question)
            fit = self._refitted(start.members, question, _own(values, question), FIRST, mend=False)
        return start, fit

    def _further(self, running: tuple[Start, Fit], iterations: int) -> tuple[Start, Fit | None]:
        start, fit = running
        with suppress(*NO_FIT):
            return start, self._went_on(start.members, fit, iterations)
        return start, None

    def _went_on(self, members: Members, fit: Fit, iterations: int) -> Fit:
        return self._refitted(members, fit.question, fit.values, iterations)

    def _refitted(
        self, members: Members, question: Identification, start: Mapping[str, float],
        iterations: int, *, mend: bool = True,
    ) -> Fit:  # fmt: skip
        """A refit of a set, written down, also where it was interrupted on its way."""
        self.refits += 1
        try:
            fit = refit(
                question, start, iterations, mend=mend, most=self._most,
                tolerance=self._tolerance, check=self._check,
            )  # fmt: skip
        except Halted as halted:
            self.keep(members, halted.fit)
            raise
        self.keep(members, fit)
        return fit

    def _promised(self, members: Members, fit: Fit) -> float:
        """The criterion of a fit after one full step."""
        now, promised = self._criterion(members, fit), _promise(fit)
        if now == math.inf or promised == fit.rms:
            return now
        return now + 2.0 * sum(self.colour.lengths) * math.log(promised / fit.rms)

    def _criterion(self, members: Members, fit: Fit) -> float:
        """The criterion of a fit; infinite where mechanics that joined do not ring: as well as
        they do, an effect does by its own name."""
        if is_lag(fit, self.question.model):
            return math.inf
        return criterion(fit, self.colour, len(members.effects), self._choices)


def _promise(fit: Fit) -> float:
    """Error [m] after one full step: what a fit that was stopped is on its way to."""
    promised = fit.outcome.promised
    return fit.rms if promised is None else promised


def _own(values: Mapping[str, float], question: Identification) -> Mapping[str, float]:
    """Values without those of details that are not free: a set that lacks one has its nominal."""
    held = {
        name for name, parameter in question.model.parameters.items()
        if parameter.fixed and name not in question.free
    }  # fmt: skip
    return {name: value for name, value in values.items() if name not in held}
