"""One search over sets of effects: expand the best one and the best of the fewest effects in turn.

    of the sets that were not expanded yet, in turn the best one of all, and the best of those with
    as few effects as any of the best few of their number:
        take each effect out: where one is not missed, the set without it is expanded in its place
        score every absent effect by one Gauss-Newton step on all data
        fit the neighbours: the likeliest more, one less, one in the place of another
        where one more is not enough, score and fit pairs of them
    until no neighbour betters the best sets, or the best one leaves only noise and was expanded, or
    one that the criterion cannot tell from it

The best one leads to where many effects are one after the other, the fewest to the law beside which
one effect is enough.

Every sample is scored, fitted and judged.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import final

from piezo_opt.diagnosis.book import Book, Start
from piezo_opt.diagnosis.colour import Colour
from piezo_opt.diagnosis.evidence import worth
from piezo_opt.diagnosis.members import Hypothesis, Members
from piezo_opt.diagnosis.moves import adds, details, imitations, laws, less, pairs, still
from piezo_opt.diagnosis.noise import is_noise
from piezo_opt.diagnosis.scores import Suspect, Unscored, scored
from piezo_opt.effects.base import Effect
from piezo_opt.identification import Fit
from piezo_opt.stopping import TimeLimit
from piezo_opt.units import show

_BY_CHANCE = 0.05
"""Corrected p-value above which a score is no reason for a fit where a fit leaves noise: the usual
level. An effect that is worth a name explains a ninth of what is left, and of some thousand samples
even a hundredth has p-values far below it."""


class Effort(Enum):
    """What a search may spend: budgets, not judgements.

    Of each: the best sets among which the next one is sought (beam); the effects and pairs of
    effects that are fitted beside a set that is expanded (near); and the sets that are expanded at
    most. A search ends after twice a beam in vain, and while more than noise is left it expands no
    set of as many effects as its beam (two at least): so many would be an imitation.
    """

    QUICK = (1, 4, 4)
    NORMAL = (3, 6, 16)
    THOROUGH = (5, 12, 48)

    @property
    def beam(self) -> int:
        """Best sets among which the next one is sought."""
        return self.value[0]

    @property
    def near(self) -> int:
        """Effects, and pairs of them, that are fitted beside a set."""
        return self.value[1]

    @property
    def expansions(self) -> int:
        """Sets that are expanded at most."""
        return self.value[2]


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
    book = Book(foot, len(offered), threads, better, least)
    suspects: tuple[Suspect, ...] = ()
    unscored: tuple[Unscored, ...] = ()
    seen_in: Colour | None = None
    expanded: dict[Hypothesis, Fit] = {}
    spare: set[Hypothesis] = set()

    def ahead(members: Members) -> bool:
        """Whether a set was not expanded, or has left behind where it was."""
        then = expanded.get(members.hypothesis)
        return then is None or worth(then, book[members], book.colour) >= least

    try:
        with limit:
            known = begun()
            book.race(known)
            asked = {start.members.hypothesis for start in known}
            quiet, tried, before = is_noise(book.settled(book.best), least), 0, foot
            while len(expanded) < effort.expansions and tried < 2 * effort.beam:
                promising = [
                    m for m in book.leading
                    if m.hypothesis not in spare and _pays(book, m)
                    and (quiet or len(m.effects) < max(effort.beam, 2))
                ]  # fmt: skip
                ways = [promising[: effort.beam]]
                if not quiet:
                    fewest = _fewest(promising, effort.beam, expanded)
                    ways.insert(len(expanded) % 2, fewest)
                at = next((m for row in ways for m in row if ahead(m)), None)
                if at is None:
                    break
                while (lighter := _lightened(book, at, least)) is not None:
                    spare.add(at.hypothesis)
                    at = lighter
                if not ahead(at):
                    if is_noise(book.settled(at), least):
                        break
                    continue
                fit = book.settled(at)
                done = is_noise(fit, least)
                tell(f"{_named(at)} leaves {show(fit.rms, 'm')}; fitting its neighbours")
                if done:
                    # What its own details leave undone would be scored as something absent.
                    book.race(details(fit, book))
                    at = next(m for m in book.leading if m.hypothesis == at.hypothesis)
                    fit = book.settled(at)
                expanded[at.hypothesis] = fit
                near: Sequence[Suspect] = ()
                starts: list[Start] = []
                if not (done and at.hypothesis in asked):
                    near, lacking = scored(fit, offered, threads, book.colour)
                    if at == book.base:
                        suspects, unscored, seen_in = near, lacking, book.colour
                    starts = _grown(book, at, near, effort, done=done)
                    starts += _exchanged(book, at, offered, effort, threads)
                book.race(starts)
                _in_depth(book, least)
                quiet = is_noise(book.settled(book.best), least)
                if at.law == book.base.law and (len(at.names) > 1 or not done):
                    # Laws have more numbers than an effect and come to their own later: at the foot
                    # all go on, unless an effect has been enough.
                    book.race(
                        _lawful(at, fit, withheld, book, done=done),
                        everyone=not (quiet or at.effects),
                        beyond=book[book.best].rms if quiet else float("inf"),
                    )
                    quiet = is_noise(book.settled(book.best), least)
                if quiet and any(m.hypothesis in expanded and not ahead(m) for m in book.level):
                    break
                # Two at a time only where one is not enough: they would crowd out single effects.
                if not (done or quiet):
                    book.race(pairs(at, near, effort.near, book))
                    quiet = is_noise(book.settled(book.best), least)
                best = book[book.best]
                tried = 0 if worth(before, best, book.left) >= least else tried + 1
                before = best if tried == 0 else before
            if seen_in is not book.colour:
                suspects, unscored = scored(foot, offered, threads, book.colour)
    except KeyboardInterrupt:
        book.brief = True
        return Searched(book, suspects, unscored, True)
    return Searched(book, suspects, unscored, False)


def _fewest(
    promising: Sequence[Members], beam: int, expanded: Collection[Hypothesis]
) -> list[Members]:
    """The best sets that were not expanded, of as few effects as any of the best of their number.

    Of sets that differ only in their mechanics, the best: else one law would fill the row.
    """
    rows: dict[int, dict[tuple[str | None, tuple[str, ...]], list[Members]]] = {}
    for members in promising:
        row = rows.setdefault(len(members.effects), {})
        row.setdefault((members.law, members.names), []).append(members)
    for _, row in sorted(rows.items()):
        best = [*row.values()][:beam]
        new = [alike[0] for alike in best if not any(m.hypothesis in expanded for m in alike)]
        if new:
            return new
    return []


def _pays(book: Book, members: Members) -> bool:
    """Whether the criterion is for each effect of a set, where the set without it was fitted."""
    fewer = (members.without(name) for name in members.names)
    return all(book.price(members) < book.price(less) for less in fewer if less in book)


def _in_depth(book: Book, least: float) -> None:
    """The best set in as much detail as it pays for, mechanics among it: a limit behind a resonance
    has neither right alone."""
    while True:
        fit = book.settled(book.best)
        book.race(details(fit, book))
        if worth(fit, book[book.best], book.colour) < least:
            return


def _lightened(book: Book, at: Members, least: float) -> Members | None:
    """The best set of one effect less where the one that goes is not missed, else None."""
    fit = book.settled(at)
    fewer = [start for _, start in less(at, fit)]
    book.race(fewer)
    able = [
        start.members for start in fewer
        if start.members in book and worth(book[start.members], fit, book.colour) < least
    ]  # fmt: skip
    return min(able, key=book.price, default=None)


def _grown(
    book: Book, at: Members, near: Sequence[Suspect], effort: Effort, *, done: bool
) -> list[Start]:
    """One member more.

    At the foot each is asked, because that fit is bent most by what is missing. Where only noise is
    left, those whose score noise alone would hardly give (see ``_BY_CHANCE``).
    """
    if done:
        near = [suspect for suspect in near if suspect.p_value < _BY_CHANCE]
    everybody = at == book.base and not done
    most = len({s.name for s in near}) if everybody else effort.near
    starts = [*adds(at, near, most, book), *details(book[at], book)]
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
    starts = imitations(at, book[at], offered)
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
    at: Members, fit: Fit, withheld: Sequence[str], book: Book, *, done: bool
) -> list[Start]:
    """Another law in the place of the base model's own, and in that of it and one of two effects:
    what an effect does beside one law, another may do by itself.

    Without effects, with the details and mechanics that the own law asked for: a law is judged by
    what is left of the loop, and not by what a resonance leaves.
    """
    if not at.effects:
        own = (m for m in book.leading if not m.effects and m.law == at.law)
        at = next(own, at)
        fit = book.settled(at)
    places = [] if done else [at]
    if len(at.names) > 1:
        places += [at.without(name) for name in at.names]
    return [start for place in places for start in laws(place, fit, withheld, book)]


def _named(at: Members) -> str:
    return "the base model" if not at.effects else "with " + ", ".join(at.names) + ", it"
