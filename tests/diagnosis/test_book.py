"""The book of a search: what is followed, and what is given up."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

import piezo_opt as po
from piezo_opt.diagnosis.book import Book, Start
from piezo_opt.diagnosis.moves import details, laws, still
from piezo_opt.diagnosis.search import _lawful
from piezo_opt.effects import Creep
from tests.diagnosis.plants import MOVING, NOISE, STILL, clock, measured, rich


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


def test_noise_has_a_colour_only_where_noise_is_left() -> None:
    """What a fit lacks is correlated, too, and its colour would hide it."""
    time = clock()
    white = np.random.default_rng(3).normal(size=time.size)
    own = {"c": 0.1, "tau": 0.1}
    noise = NOISE * np.asarray(signal.lfilter([1.0], [1.0, -0.5], white))
    record = measured(STILL, time, rich(time), (Creep(1), own), noise=noise)
    fit = po.solve(po.Identification(STILL, record))
    book = Book(fit, 1, 1)
    book.race([Start(book.base, fit.values)])
    assert book.colour.coefficients == ()
    begun = {**fit.values, **{f"creep.{k}": v for k, v in own.items()}}
    book.race([Start(book.base.with_(Creep(1)), begun)])
    assert book.colour.coefficients[0] == pytest.approx(0.5, abs=0.15)


def test_other_laws_are_tried_with_the_mechanics_that_the_own_law_asked_for() -> None:
    """Without them what a resonance leaves would decide between laws."""
    time = clock(600)
    fit = po.solve(po.Identification(STILL, measured(MOVING, time, rich(time))))
    book = Book(fit, 1, 1)
    book.race(details(fit, book))
    assert book[book.best].rms < 0.5 * fit.rms
    starts = _lawful(book.base, fit, (), book, done=False)
    assert {start.members.law for start in starts} > {"duhem", "maxwell_slip", "preisach"}
    assert all("second_order" in start.members.model.names for start in starts)


def test_what_two_laws_have_by_one_name_is_carried_over() -> None:
    time = clock(600)
    fit = po.solve(po.Identification(STILL, measured(STILL, time, rich(time))))
    book = Book(fit, 1, 1)
    starts = [s for s in laws(book.base, fit, (), book) if s.members.law == "duhem"]
    begun = [s.values for s in starts if s.values is not None]
    shared = {f"duhem.{k}": fit.values[f"bouc_wen.{k}"] for k in ("alpha", "beta")}
    assert any(shared.items() <= dict(values).items() for values in begun)
