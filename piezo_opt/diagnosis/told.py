"""The answer, read off the book: names, groups, ladder, and what became of the base model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

from piezo_opt.diagnosis.book import Book, Start
from piezo_opt.diagnosis.evidence import RESOLUTION, remaining, worth
from piezo_opt.diagnosis.judge import Judge
from piezo_opt.diagnosis.members import Members
from piezo_opt.diagnosis.moves import at_home, still
from piezo_opt.diagnosis.refit import CLOSE
from piezo_opt.diagnosis.scores import Suspect
from piezo_opt.effects.base import Effect
from piezo_opt.identification import Fit, with_statistics
from piezo_opt.units import show


@final
@dataclass(frozen=True, eq=False)
class Step:
    """One effect of the answer.

    Attributes:
        name: the effect.
        effect: the object that was added.
        alternatives: fits with each effect that this record cannot tell it from in its place, its
            own fit first.
        rms_before, rms_after: error on the fitted records [m].
        held_out_before, held_out_after: error on what is held out [m].
        delta_bic: by how much the criterion fell.
        p_value: of its score at the foot, corrected for the search.
        fit: the fit with it.
    """

    name: str
    effect: Effect
    alternatives: Mapping[str, Fit]
    rms_before: float
    rms_after: float
    held_out_before: float | None
    held_out_after: float | None
    delta_bic: float
    p_value: float
    fit: Fit

    @property
    def told(self) -> str:
        """Its name, with the form that was added where it has several: dead_zone (backlash)."""
        form = [k.replace("_", " ") for k, value in vars(self.effect).items() if value is True]
        return f"{self.name} ({', '.join(form)})" if form else self.name

    @property
    def group(self) -> tuple[str, ...]:
        """Names that this record cannot tell it from, itself first."""
        return tuple(self.alternatives)


@final
@dataclass(frozen=True)
class Rival:
    """A hysteresis law in the place of the base model's own.

    Attributes:
        name: the law.
        rms: error of its best set [m].
        held_out: error on what is held out [m].
        delta_bic: by how much the criterion falls (negative: the model's own law is better).
        better: whether that is strong evidence for it.
        without: effects of the answer that it does without.
    """

    name: str
    rms: float
    held_out: float | None
    delta_bic: float
    better: bool
    without: tuple[str, ...] = ()

    @property
    def less(self) -> str:
        """What it does without, in words that follow a sentence; none where that is nothing."""
        return f", without {' and '.join(self.without)}" if self.without else ""

    def __str__(self) -> str:
        against = "fits better than" if self.better else "is no better than"
        return f"{self.name} {against} the model's own law{self.less} (rms {show(self.rms, 'm')})."


def in_words(compared: Sequence[Rival]) -> tuple[str, ...]:
    """Each law that is better, else that none is; nothing where none was tried."""
    better = tuple(str(r) for r in compared if r.better)
    if better or len(compared) < 2:
        return better or tuple(map(str, compared))
    *some, last = (r.name for r in compared)
    return (f"None of {', '.join(some)} and {last} fits better than the model's own law.",)


@final
@dataclass(frozen=True, eq=False)
class Told:
    """What a user reads.

    Attributes:
        members: the best set, without members that are not worth a name.
        final: its fit.
        steps: its effects, each in the order of what it explains.
        refined: details that are free, mechanics that joined, another law.
        rivals: the best that was found with each other hysteresis law, best first.
        slight: effects of the best set that explain too little to bear a name, and how much.
    """

    members: Members
    final: Fit
    steps: tuple[Step, ...]
    refined: tuple[str, ...]
    rivals: tuple[Rival, ...]
    slight: tuple[tuple[str, float], ...]


def told(book: Book, suspects: Sequence[Suspect], least: float, judge: Judge) -> Told:
    """The best set of a book, as a ladder.

    Args:
        book: the sets that were fitted.
        suspects: scores at the foot.
        least: the least a member must explain, when it is dropped, to bear a name (see
            :func:`~piezo_opt.diagnosis.evidence.worth`).
        judge: where fits are judged.
    """
    book.conclude()
    _lean_rivals(book)
    worthy, slight = _worthy(book, book.best, least)
    seen = {worthy}
    while (rather := _rather(book, worthy, least, judge)) is not None and rather not in seen:
        seen.add(rather)
        worthy, slight = _worthy(book, rather, least)
    best = _at_home(book, _likeliest(book, worthy, suspects))
    slight = tuple(one for one in slight if one[0] not in best.names)
    steps = _steps(book, best, suspects, least, judge)
    return Told(
        best, book.settled(best), steps, _refined(book, best), _rivals(book, best, judge), slight
    )


def _lean_rivals(book: Book) -> None:
    """Each rival of the best set without details too: one that was fitted with more of them than
    pay for themselves looks dearer than it is."""
    for members in book.leading:
        bare = replace(members, free=())
        worst = _even(book, members, bare)
        if bare not in book and book.price(members) - _saved(book, members, bare) < (
            book.price(book.best) + RESOLUTION
        ):
            book.tidy([Start(bare, dict(book[members].values))], beyond=worst)


def _saved(book: Book, more: Members, less: Members) -> float:
    """What the criterion asks for the details of a set that another one lacks."""
    return (len(more.free) - len(less.free)) * math.log(sum(book.colour.lengths))


def _even(book: Book, more: Members, less: Members) -> float:
    """Error [m] of the set with less beyond which its details are missed: N ln(e'e) rises by more
    than they ask for."""
    lost = _saved(book, more, less) / sum(book.colour.lengths)
    return book[more].rms * math.exp(0.5 * lost)


def _at_home(book: Book, best: Members) -> Members:
    """A set with the base model's own law, where the criterion cannot tell it from that.

    Beside what the set found beside another law the own one may never have been fitted.
    """
    book.tidy(at_home(best, book.settled(best), book))
    even = (
        m for m in book.leading
        if (m.names, m.law) == (best.names, book.base.law)
        and book.price(m) - book.price(best) < RESOLUTION
    )  # fmt: skip
    return next(even, best)


def _rather(book: Book, best: Members, least: float, judge: Judge) -> Members | None:
    """The plainest set that is told rather than the best one.

    One that names fewer effects, where the criterion cannot tell it from that: a name too many
    costs more than a law of another kind. Or one that names no more, leaves no more that would be
    worth a name, and predicts the record that is held out better by as much.
    """
    as_little = math.sqrt(1.0 + least**2)
    error = math.inf if judge.record is None else judge.error(book[best])

    def even(members: Members) -> bool:
        plainer = len(members.effects) < len(best.effects)
        return plainer and book.price(members) - book.price(best) < RESOLUTION

    def foretells(members: Members) -> bool:
        if judge.record is None or book[members].rms > as_little * book[best].rms:
            return False
        return as_little * judge.error(book[members]) < error

    rather = (
        m for m in book.leading
        if m != best and len(m.effects) <= len(best.effects) and (even(m) or foretells(m))
    )  # fmt: skip
    return min(rather, key=lambda m: (len(m.effects), book.price(m)), default=None)


def _worthy(
    book: Book, best: Members, least: float
) -> tuple[Members, tuple[tuple[str, float], ...]]:
    """The set without effects, and then details, that explain too little, the weakest first.

    Beside it the effects that were left out although the criterion is for them.
    """
    slight: list[tuple[str, float]] = []
    while True:
        best = _at_home(book, best)
        fit = book.settled(best)
        asked = [(_explains(book, less, fit), less) for less in _fewer(book, best)]
        weakest = min(asked, key=lambda pair: pair[0], default=None)
        if weakest is not None and weakest[0] < least:
            explains, less = weakest
            if book.price(less) - book.price(best) > RESOLUTION:
                (name,) = {*best.names} - {*less.names}
                slight.append((name, explains))
            best = book.best_with(less.names)
            continue
        lean = _lean(book, best)
        if lean == best:
            return best, tuple(slight)
        best = lean


def _likeliest(book: Book, best: Members, suspects: Sequence[Suspect]) -> Members:
    """Of sets that differ in one effect and that the criterion cannot tell apart, the likeliest.

    Least likely is one with an effect that imitates another, likeliest the one whose effect scored
    highest at the foot, before any refit.
    """
    at_foot = {s.name: s.score for s in reversed(suspects) if not s.wrong_side}
    even = [m for m in book.leading if book.price(m) - book.price(best) < RESOLUTION]

    def ahead(members: Members) -> tuple[int, float]:
        bent = sum(_imitates(book[members], name) for name in members.names)
        return -bent, sum(at_foot.get(n, 0.0) for n in members.names)

    alike = [
        m for m in even
        if len(m.names) == len(best.names) and len({*m.names} - {*best.names}) <= 1
    ]  # fmt: skip
    return max([best, *alike], key=ahead)


def _imitates(fit: Fit, name: str) -> bool:
    """Whether an effect would have to be beyond what it can be: a shape of it ended at a bound. All
    of a signal may well pass it, so its gate may."""
    gate = f"{name}.{fit.model[name].gate}"
    return any(k.startswith(f"{name}.") and k != gate for k in fit.at_bound)


def _fewer(book: Book, best: Members) -> list[Members]:
    """For each effect the best set without it: the others may do its part in more detail."""
    found = []
    for name in best.names:
        less = best.without(name)
        book.race([Start(less, dict(book[best].values)), Start(less, None)])
        alike = (less.base.names, less.names)
        rest = (m for m in book.leading if (m.base.names, m.names) == alike)
        found.append(next(rest, less))
    return found


def _lean(book: Book, best: Members) -> Members:
    """The set without the details that do not pay for themselves, or mechanics that do nothing."""
    fewer = [tuple(k for k in best.free if k != name) for name in best.free]
    for free in ((), *fewer) if fewer else ():
        less = replace(best, free=free)
        # Also one that was fitted: from elsewhere it may have got stuck.
        book.tidy([Start(less, dict(book[best].values))], beyond=_even(book, best, less))
        if less in book and book.price(less) < book.price(best):
            return less
    for start in still(best, book[best], book.question)[:1]:
        book.tidy([start], beyond=book[best].rms * (1.0 + CLOSE))
        less = start.members
        if less in book and book.price(less) < book.price(best):
            return less
    return best


def _explains(book: Book, less: Members, fit: Fit) -> float:
    return worth(book.settled(less), fit, book.colour) if less in book else float("inf")


def _steps(
    book: Book, best: Members, suspects: Sequence[Suspect], least: float, judge: Judge
) -> tuple[Step, ...]:
    """The effects of a set, each next one the one that explains most of what was left."""
    below = best
    for name in best.names:
        below = below.without(name)
    if below not in book:
        book.race([Start(below, dict(book.foot.values)), Start(below, None)])
    found: list[Step] = []
    while below in book and len(found) < len(best.effects):
        lacking = [e for e in best.effects if e.name not in below.names]
        details = {
            e.name: tuple(k for k in best.free if k.split(".")[0] == e.name) for e in lacking
        }
        nexts = []
        for effect in lacking:
            more = below.with_(effect)
            more = Members(
                more.base, more.effects, tuple(sorted({*more.free, *details[effect.name]}))
            )
            if more not in book:
                book.race([Start(more, dict(book[best].values)), Start(more, None)])
            if more in book:
                nexts.append((book.price(more), effect, more))
        if not nexts:
            break
        _, effect, more = min(nexts, key=lambda one: one[0])
        before, after = book.settled(below), book.settled(more)
        p_value = min((s.p_value for s in suspects if s.name == effect.name), default=1.0)
        found.append(
            Step(
                name=effect.name, effect=effect,
                alternatives=_alternatives(book, best, effect.name, least),
                rms_before=before.rms, rms_after=after.rms, held_out_before=judge.error(before),
                held_out_after=judge.error(after), delta_bic=book.fall(below, more),
                p_value=p_value, fit=with_statistics(after),
            )
        )  # fmt: skip
        below = more
    return tuple(found)


def _alternatives(book: Book, best: Members, name: str, least: float) -> dict[str, Fit]:
    """Fits with an effect and with those in whose place it is not resolved, its own first.

    Not resolved is an exchange that costs less than the criterion can resolve, or one that leaves
    more by less than is worth a name, of what is left and of what the effect explains. What only
    imitates the effect is no exchange.
    """
    rest = {n for n in best.names if n != name}
    fit, below = book[best], best.without(name)
    left = remaining(fit, book.colour)
    explained = remaining(book[below], book.colour) - left if below in book else left
    found = {name: book.settled(best)}
    for members in book.sets:
        others = [n for n in members.names if n not in rest]
        if len(others) != 1 or set(members.names) != rest | set(others) or others[0] in found:
            continue
        even = book.price(members) - book.price(best) < RESOLUTION
        behind = remaining(book[members], book.colour) - left
        same = even or behind < least**2 * min(left, explained)
        if same and not _imitates(book[members], others[0]):
            found[others[0]] = book[members]
    return found


def _refined(book: Book, best: Members) -> tuple[str, ...]:
    own = book.base.base
    joined = [n for n, e in best.base if n not in own and n != best.law]
    return (*joined, *best.free)


def _rivals(book: Book, best: Members, judge: Judge) -> tuple[Rival, ...]:
    """The best set with each hysteresis law but the foot's, against the best with that one."""
    own = book.base.law
    of_law: dict[str | None, Members] = {}
    for members in book.sets:
        of_law.setdefault(members.law, members)
    home = of_law.get(own)
    if home is None or own is None:
        return ()
    found = []
    for law, members in of_law.items():
        if law is None or law == own:
            continue
        gain = book.price(home) - book.price(members)
        without = tuple(n for n in best.names if n not in members.names)
        error = judge.error(book[members])
        found.append(Rival(law, book[members].rms, error, gain, gain > RESOLUTION, without))
    return tuple(sorted(found, key=lambda r: -r.delta_bic))
