"""Which sets are expanded next: the best one, and those of the fewest effects, in turn.

The best one leads to where many effects are one after the other, the fewest to the law beside which
one effect is enough. Once the best leaves only noise, it is expanded, and after it only what might
say the same with less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from enum import Enum
from typing import final

from piezo_opt.diagnosis.book import Book
from piezo_opt.diagnosis.evidence import RESOLUTION, numbers, worth
from piezo_opt.diagnosis.members import Hypothesis, Members
from piezo_opt.diagnosis.moves import less
from piezo_opt.effects.base import Effect
from piezo_opt.identification import Fit


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
class Frontier:
    """The sets of a book that were expanded, and the next ones.

    Args:
        book: the sets.
        effort: what a search may spend.
        least: the least that an effect must explain (see
            :func:`~piezo_opt.diagnosis.evidence.worth`).
    """

    def __init__(self, book: Book, effort: Effort, least: float) -> None:
        self.expanded: dict[Hypothesis, Fit] = {}
        """Where each was then."""
        self._book = book
        self._effort = effort
        self._least = least
        self._spare: set[Hypothesis] = set()
        self._turns = 0

    @property
    def answer(self) -> Members:
        """The best set, without effects that are not missed."""
        return self._lightest(self._book.best)

    def next(self, *, quiet: bool) -> list[Members]:
        """The sets that are expanded together next; none where nothing is left to be.

        Args:
            quiet: whether the answer so far leaves only noise.
        """
        while len(self.expanded) < self._effort.expansions:
            row = self._in_turn(quiet)
            if not row:
                return []
            lightest = dict.fromkeys(self._lightest(at) for at in row)
            if new := [at for at in lightest if self._ahead(at)]:
                return new
        return []

    def _in_turn(self, quiet: bool) -> list[Members]:
        book, beam = self._book, self._effort.beam
        promising = [
            m for m in book.leading
            if m.hypothesis not in self._spare and _pays(book, m)
            and (quiet or len(m.effects) < max(beam, 2))
        ]  # fmt: skip
        if quiet:
            answer = self.answer
            over = any(m.hypothesis in self.expanded and not self._ahead(m) for m in book.level)
            best = [answer] if self._ahead(answer) and not over else []
            promising = plainer(book, promising, answer)
        else:
            best = [m for m in promising[:beam] if self._ahead(m)][:1]
        new = fewest(promising, beam, self.expanded, lambda m: numbers(book[m]))
        new = [m for m in new if self._ahead(m)]
        self._turns += 1
        return best or new if quiet or self._turns % 2 else new or best

    def _ahead(self, members: Members) -> bool:
        """Whether a set was not expanded, or has left behind where it was."""
        then = self.expanded.get(members.hypothesis)
        return then is None or worth(then, self._book[members], self._book.colour) >= self._least

    def _lightest(self, at: Members) -> Members:
        """A set without the effects that are not missed, the weakest one less each time; with the
        law beside which the others say most."""
        book = self._book
        while True:
            fit = book.settled(at)
            fewer = [start for _, start in less(at, fit)]
            book.race(fewer, beyond=math.hypot(1.0, self._least) * fit.rms)
            able = [
                start.members for start in fewer
                if start.members in book
                and worth(book[start.members], fit, book.colour) < self._least
            ]  # fmt: skip
            if not able:
                return at
            self._spare.add(at.hypothesis)
            at = book.best_with(min(able, key=book.price).names)


def fewest(
    promising: Sequence[Members], beam: int, expanded: Collection[Hypothesis],
    asks: Callable[[Members], int],
) -> list[Members]:  # fmt: skip
    """The best sets that were not expanded, of as few effects as any of the best of their number.

    Of sets that differ only in their mechanics, the best: else one law would fill the row. Without
    effects all laws, but those of more than twice the numbers of the plainest one later: they bend
    to whatever is missing, and cost most.

    Args:
        promising: sets, best first.
        beam: how many of those with effects.
        expanded: what was.
        asks: for how many numbers a set asks.
    """
    rows: dict[int, dict[tuple[Effect | None, tuple[str, ...]], list[Members]]] = {}
    for members in promising:
        row = rows.setdefault(len(members.effects), {})
        _, law, names = members.hypothesis
        row.setdefault((law, names), []).append(members)
    for depth, row in sorted(rows.items()):
        best = [*row.values()][: beam if depth else None]
        new = [alike[0] for alike in best if not any(m.hypothesis in expanded for m in alike)]
        if new and depth == 0:
            least = min(map(asks, new))
            return [members for members in new if asks(members) <= 2 * least]
        if new:
            return new
    return []


def plainer(book: Book, promising: Sequence[Members], answer: Members) -> list[Members]:
    """Sets with another law than an answer's that do not say more with one effect more, and might
    be better: a law of many numbers imitates what another does with few, and effects beside one law
    what another law does by itself. Not where one effect beside the base model's own law leaves
    nothing to be better in, which is as plain as can be."""
    if len(answer.effects) < 2 and answer.law == book.base.law and answer in book.level:
        return []
    return [
        m for m in promising
        if len(m.effects) < len(answer.effects) and m.law != answer.law
        and book.bound(m, 1) < book.price(answer) - RESOLUTION
    ]  # fmt: skip


def _pays(book: Book, members: Members) -> bool:
    """Whether the criterion is for each effect of a set, where the set without it was fitted."""
    fewer = (members.without(name) for name in members.names)
    return all(book.price(members) < book.price(less) for less in fewer if less in book)
