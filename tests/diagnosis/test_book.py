"""The book of a search: what is followed, and what is given up."""

from __future__ import annotations

import piezo_opt as po
from piezo_opt.diagnosis.book import Book
from piezo_opt.diagnosis.moves import laws, still
from piezo_opt.effects import Creep
from tests.diagnosis.plants import MOVING, STILL, clock, measured, rich


def test_what_is_far_behind_and_hardly_falls_is_given_up() -> None:
    """Creep goes on for long to imitate a resonance that it never will."""
    time = clock()
    creep = {"c": 0.1, "tau": 0.1}
    record = measured(MOVING, time, rich(time), (Creep(), creep))
    fit = po.solve(po.Identification(MOVING + Creep(), record))
    refits = {}
    for beyond in (float("inf"), fit.rms):
        book = Book(fit, 1, 1)
        begun, _ = still(book.base, fit, fit.question)
        book.race([begun], beyond=beyond)
        refits[beyond] = book.refits
        assert book[begun.members].rms > 10.0 * fit.rms
        assert book.best == book.base
    assert refits[fit.rms] < refits[float("inf")]


def test_a_law_begins_again_where_it_ended() -> None:
    time = clock(600)
    fit = po.solve(po.Identification(STILL, measured(STILL, time, rich(time))))
    book = Book(fit, 1, 1)
    plays = [s for s in laws(book.base, fit, (), book) if s.members.law == "prandtl_ishlinskii"]
    assert len(plays) > 1
    book.race(plays)
    (again,) = (s for s in laws(book.base, fit, (), book) if s.members.law == "prandtl_ishlinskii")
    ended = book[plays[0].members].values
    assert again.values is not None
    own = {k: v for k, v in again.values.items() if k.startswith("prandtl_ishlinskii.")}
    assert own
    assert own == {k: ended[k] for k in own}
