"""One search over sets of effects: expand the best one and the best of the fewest effects in turn.

    of the sets that were not expanded yet, in turn the best one of all, and together the best of
    those with the fewest effects: all hysteresis laws first
        take each effect out: where one is not missed, the set without it is expanded in its place
        score every absent effect by one Gauss-Newton step on all data
        fit the neighbours: the likeliest more, one less, one in the place of another; beside each
        law what helps beside the others
        where none of them is better, score and fit pairs of effects
    until no neighbour betters the best sets; or the best one leaves only noise and was expanded,
    and no other law might say the same with less

Every sample is scored, fitted and judged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

from piezo_opt.diagnosis.book import Book, Start
from piezo_opt.diagnosis.colour import Colour
from piezo_opt.diagnosis.evidence import RESOLUTION, worth
from piezo_opt.diagnosis.frontier import Effort, Frontier
from piezo_opt.diagnosis.members import Hypothesis, Members
from piezo_opt.diagnosis.moves import adds, crossed, details, imitations, laws, pairs, still
from piezo_opt.diagnosis.noise import is_noise
from piezo_opt.diagnosis.scores import Suspect, Unscored, scored
from piezo_opt.effects.base import Effect
from piezo_opt.identification import Fit
from piezo_opt.stopping import TimeLimit
from piezo_opt.units import show

_BY_CHANCE = 0.05
"""Corrected p-value above which a score is no reason for a fit where a fit leaves noise: the usual
level. A score is of one step: what a refit would gain beside it may be far more."""


@final
@dataclass(frozen=True, eq=False)
class Searched:
    """What a search has found.

    Attributes:
        book: all sets that were fitted.
        suspects: scores of all candidates at the foot.
        unscored: candidates that could not be scored, and why.
        interrupted: whether it was stopped on the way.
    """

    book: Book
    suspects: tuple[Suspect, ...]
    unscored: tuple[Unscored, ...]
    interrupted: bool


def search(
    foot: Fit,
    offered: Sequence[Effect],
    withheld: Sequence[str],
    effort: Effort,
    least: float,
    threads: int,
    tell: Callable[[str], None],
    limit: TimeLimit,
    begun: Callable[[], Sequence[Start]] = tuple,
    better: Callable[[Fit], None] = lambda _: None,
) -> Searched:
    """Search the sets around a fit.

    Args:
        foot: the fit at the foot.
        offered: forms of effects that may join.
        withheld: catalogue names that shall not be considered.
        effort: what it may spend.
        least: the least that an effect must explain (see
            :func:`~piezo_opt.diagnosis.evidence.worth`).
        threads: refits that run at a time.
        tell: called with sentences about what is going on.
        limit: of wall time.
        begun: gives sets, and where they begin, that are fitted before any is expanded. Their
            neighbours were asked elsewhere: of one that leaves only noise, only details are.
        better: called with the best fit so far, where it is another one than before.
    """
    book = Book(foot, len(offered), threads, better, least, limit.check)
    run = _Run(book, Frontier(book, effort, least), offered, withheld, effort, least, threads)
    try:
        with limit:
            known = begun()
            book.race(known)
            run.asked = frozenset(start.members.hypothesis for start in known)
            before, vain = foot, 0
            while vain < 2 * effort.beam and (row := run.frontier.next(quiet=run.quiet)):
                tell(_beginning(book, row))
                run.expand(row)
                best = book[book.best]
                vain = 0 if worth(before, best, book.left) >= least else vain + 1
                before = before if vain else best
            if run.seen_in is not book.colour:
                run.look(book.base)
    except KeyboardInterrupt:
        book.hurry()
        return Searched(book, run.suspects, run.unscored, True)
    return Searched(book, run.suspects, run.unscored, False)


@final
@dataclass
class _Run:
    """One search on its way.

    Attributes:
        book, frontier: what was fitted, and what is next.
        offered, withheld, effort, least, threads: as of a search.
        asked: sets whose neighbours were asked elsewhere.
        suspects, unscored, seen_in: scores at the foot, and the colour in which they were.
    """

    book: Book
    frontier: Frontier
    offered: Sequence[Effect]
    withheld: Sequence[str]
    effort: Effort
    least: float
    threads: int
    asked: frozenset[Hypothesis] = frozenset()
    suspects: tuple[Suspect, ...] = ()
    unscored: tuple[Unscored, ...] = ()
    seen_in: Colour | None = None

    @property
    def quiet(self) -> bool:
        """Whether the best set leaves only noise, without the effects that are not missed too."""
        settled, answer = self.book.settled, self.frontier.answer
        return is_noise(settled(self.book.best), self.least) and is_noise(
            settled(answer), self.least
        )

    def look(self, at: Members) -> tuple[Suspect, ...]:
        """Scores of all absent effects at a set."""
        book = self.book
        near, lacking = scored(book.settled(at), self.offered, self.threads, book.colour)
        if at == book.base:
            self.suspects, self.unscored, self.seen_in = near, lacking, book.colour
        return near

    def expand(self, row: Sequence[Members]) -> None:
        """Fit the neighbours of some sets together."""
        book, starts = self.book, list[Start]()
        near: dict[Members, tuple[Suspect, ...]] = {}
        for at in row:
            done = is_noise(book.settled(at), self.least)
            if done:
                # What its own details leave undone would be scored as something absent.
                book.race(details(book[at], book, quiet=True), beyond=book[at].rms)
                at = next(m for m in book.leading if m.hypothesis == at.hypothesis)
            self.frontier.expanded[at.hypothesis] = book.settled(at)
            near[at] = ()
            if not (done and at.hypothesis in self.asked):
                near[at] = self.look(at)
                likeliest = self.effort.near if len(row) == 1 else self.effort.beam
                starts += _grown(book, at, near[at], likeliest, done=done)
                exchanged = _exchanged(book, at, self.offered, self.effort, self.threads)
                if done:
                    # Rivals of an answer race apart: beside sets that hold it they all look bad.
                    book.race(exchanged, late=True, beyond=book[book.best].rms)
                else:
                    starts += exchanged
        book.race(starts)
        others = [at for at in near if not at.effects and at.law != book.base.law]
        book.race(crossed(others, self.effort.beam, book))
        _in_depth(book, self.least)
        for at in near:
            self._exchange_law(at)
        # Two at a time only where none alone is better than what is there already.
        best = next((at for at in near if at.hypothesis == book.best.hypothesis), None)
        if best is not None and not self.quiet:
            book.race(pairs(best, near[best], self.effort.near, book))

    def _exchange_law(self, at: Members) -> None:
        """Fit a set of the base model's own law with others, where it is not enough.

        Laws have more numbers than an effect and come to their own later: at the foot all go on,
        unless an effect has been enough.
        """
        book, quiet = self.book, self.quiet
        then = self.frontier.expanded[at.hypothesis]
        done = is_noise(then, self.least)
        if at.law == book.base.law and (len(at.names) > 1 or not done):
            book.race(
                _lawful(at, then, self.withheld, book, done=done, quiet=quiet),
                everyone=not (quiet or at.effects),
                late=True,
                beyond=book[book.best].rms if quiet else float("inf"),
            )


def _in_depth(book: Book, least: float) -> None:
    """The best set in as much detail as it pays for, mechanics among it: a limit behind a resonance
    has neither right alone."""
    while True:
        fit = book.settled(book.best)
        quiet = is_noise(fit, least)
        book.race(details(fit, book, quiet=quiet), beyond=fit.rms if quiet else float("inf"))
        if worth(fit, book[book.best], book.colour) < least:
            return


def _grown(
    book: Book, at: Members, near: Sequence[Suspect], likeliest: int, *, done: bool
) -> list[Start]:
    """One member more.

    At the foot each is asked, because that fit is bent most by what is missing. Where only noise is
    left, those whose score noise alone would hardly give (see ``_BY_CHANCE``).
    """
    if done:
        near = [suspect for suspect in near if suspect.p_value < _BY_CHANCE]
    everybody = at == book.base and not done
    most = len({s.name for s in near}) if everybody else likeliest
    starts = [*adds(at, near, most, book), *details(book[at], book, quiet=done)]
    if done:
        return starts
    return [*starts, *still(at, book[at], book.question)]


def _exchanged(
    book: Book, at: Members, offered: Sequence[Effect], effort: Effort, threads: int
) -> list[Start]:
    """One member in the place of another, or the same one elsewhere in its shapes.

    Who is asked for the place is scored where the rest of the set stands beside the member: there
    the rest is not bent by its absence.
    """
    starts = imitations(at, book[at], offered, book)
    for name in at.names:
        rest = at.without(name)
        beside = book.standing(rest, book[at])
        if beside is not None:
            others, _ = scored(beside, offered, threads, book.colour)
            starts += adds(rest, others, effort.near, book, fresh=False)
        if rest in book:
            starts += details(book[rest], book)
    return starts


def _lawful(
    at: Members, fit: Fit, withheld: Sequence[str], book: Book, *, done: bool, quiet: bool
) -> list[Start]:
    """Another law in the place of the base model's own, and in that of it and one of two effects:
    what an effect does beside one law, another may do by itself.

    Without effects, with the details and mechanics that the own law asked for: a law is judged by
    what is left of the loop, and not by what a resonance leaves. Where only noise is left already,
    no law that asks for too many numbers to be as good.
    """
    if not at.effects:
        own = (m for m in book.leading if not m.effects and m.law == at.law)
        at = next(own, at)
        fit = book.settled(at)
    places = [] if done else [at]
    if len(at.names) > 1:
        places += [at.without(name) for name in at.names]
    starts = [start for place in places for start in laws(place, fit, withheld, book)]
    worst = book.price(book.best) + RESOLUTION
    return [s for s in starts if book.bound(s.members) < worst] if quiet else starts


def _beginning(book: Book, row: Sequence[Members]) -> str:
    """What is done next, in words."""
    at, others = row[0], len(row) - 1
    named = f"with {', '.join(at.names)}, it" if at.effects else "the base model"
    more = f" and those of {others} more" if others else ""
    return f"{named} leaves {show(book[at].rms, 'm')}; fitting its neighbours{more}"
