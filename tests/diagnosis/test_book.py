"""The book of a search: what is followed, and what is given up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import piezo_opt as po
from piezo_opt.diagnosis.book import Book, Start
from piezo_opt.diagnosis.moves import anew, crossed, details, laws, still
from piezo_opt.diagnosis.search import _lawful
from piezo_opt.effects import (
    AmplifierLag,
    Creep,
    Dahl,
    Duhem,
    Effect,
    MaxwellSlip,
    NonlinearGain,
    Offset,
    PiezoGain,
    PrandtlIshlinskii,
    Preisach,
    Saturation,
    SensorLag,
)  # fmt: skip
from tests.diagnosis.plants import MOVING, NOISE, STILL, clock, measured, opened, rich

CREEPING = Creep(1), {"c": 0.1, "tau": 0.1}


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


def test_who_does_not_promise_to_come_near_the_best_is_left_after_five_iterations() -> None:
    book = opened(CREEPING)
    near = book.base.with_(Creep(1))
    far = replace(book.base, base=STILL.replaced("bouc_wen", Preisach(free=True)))
    book.race([Start(near, None), Start(far, None)])
    promised = book[far].outcome.promised
    assert promised is not None
    assert promised > 2.0 * book[near].rms
    assert book[far].trace.rms.size == 6
    assert book[near].rms == pytest.approx(NOISE, rel=0.05)


def test_a_fit_is_interrupted_on_its_way_and_what_it_has_reached_is_kept() -> None:
    passed = []

    def check() -> None:
        passed.append(1)
        if len(passed) > 3:
            raise KeyboardInterrupt

    fit = opened(CREEPING).foot
    book = Book(fit, 1, 1, check=check)
    members = book.base.with_(Creep(1))
    with pytest.raises(KeyboardInterrupt):
        book.race([Start(members, None)])
    assert book[members].trace.rms.size == 4
    assert book[members].rms == pytest.approx(book[members].trace.rms[-1], rel=1e-3)
    assert book[members].rms < 0.5 * fit.rms
    book.hurry()
    less_creep = {**book[members].values, "creep.c": 0.0}
    book.race([Start(members, less_creep)])
    assert len(passed) == 4
    assert book.refits == 2


def test_where_the_time_is_over_nothing_more_is_tidied_up() -> None:
    book = opened(CREEPING)
    start = Start(book.base.with_(Creep(1)), None)
    book.hurry()
    book.tidy([start])
    assert book.refits == 0
    book.race([start])
    assert book.refits == 1


def test_sub_steps_are_as_fine_as_what_is_left_asks_for() -> None:
    """A resonance that is swept through: its range is large, and noise far below a usual share."""
    time, noise = clock(2000, 2000.0), 0.2 * NOISE
    sweep = 20.0 * np.sin(2.0 * np.pi * (10.0 + 100.0 * time) * time)
    record = measured(MOVING, time, sweep, CREEPING, noise=noise)
    fit = po.solve(po.Identification(MOVING + Creep(1), record))
    assert fit.rms == pytest.approx(noise, rel=0.1)
    book = Book(fit, 1, 1)
    lagging = book.base.with_(SensorLag())
    begun = {**fit.values, "sensor_lag.share": 1e-3, "sensor_lag.tau": 1e-3}
    book.race([Start(lagging, begun)])
    assert book[lagging].accuracy[0].error < 0.2 * noise
    assert book[lagging].rms == pytest.approx(fit.rms, rel=0.02)


def test_a_law_that_was_led_astray_is_begun_again() -> None:
    """A sum of plays that was fitted with a width far too large, beside an effect."""
    time = clock(1200, 100.0)
    drive = rich(time)
    law = {"rho": 6e-8, "decay": 1.0, "r": 25.0}
    truth = {f"prandtl_ishlinskii.{k}": v for k, v in law.items()}
    model = PiezoGain() + PrandtlIshlinskii(dead_zones=0) + Creep(1) + Offset()
    truth |= {"creep.c": 0.05, "creep.tau": 1.0}
    blank = po.Measurement(time, drive, 1e-7 * drive)
    reading = po.simulate(model, blank, truth).reading
    record = blank.with_(position=reading + 1e-9 * np.random.default_rng(1).normal(size=time.size))
    large = {"prandtl_ishlinskii.r": 2000.0}
    stuck = po.solve(po.Identification(model, record), start=large)
    assert stuck.rms > 10.0 * 1e-9
    book = Book(stuck, 1, 1)
    book.race(anew(stuck, book))
    (begun,) = {start.members for start in anew(stuck, book)}
    assert {k.split(".")[1] for k in begun.free} >= {"origin", "swing", "swing_before"}
    assert book[begun].rms == pytest.approx(1e-9, rel=0.1)


def test_a_law_begins_again_where_it_ended() -> None:
    book = opened()
    fit = book.foot
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
    starts = _lawful(book.base, fit, (), book, done=False, quiet=False)
    assert {start.members.law for start in starts} > {"duhem", "maxwell_slip", "preisach"}
    assert all("second_order" in start.members.model.names for start in starts)


def test_mechanics_that_join_must_ring_but_not_the_user_s_own() -> None:
    """Overdamped, they would be but another lag."""
    time = clock(600)
    lag = AmplifierLag(), {"share": 1.0, "tau": 0.004}
    record = measured(STILL, time, rich(time), lag)
    fit = po.solve(po.Identification(STILL, record))
    book = Book(fit, 1, 1)
    book.race(details(fit, book))
    joined = [m for m in book.sets if not m.model.quasi_static]
    assert joined
    assert all(book[m].values["second_order.zeta"] <= np.sqrt(0.5) for m in joined)
    # Where they would not ring any more, they are no answer.
    at_the_edge = [m for m in joined if "second_order.zeta" in book[m].at_bound]
    assert at_the_edge
    assert all(book.price(m) == np.inf for m in at_the_edge)
    assert book.best not in at_the_edge
    asked = replace(book.base, base=MOVING).question(po.Identification(MOVING, record))
    assert "second_order.zeta" not in asked.bounds


def test_what_two_laws_have_by_one_name_is_carried_over() -> None:
    book = opened()
    fit = book.foot
    starts = [s for s in laws(book.base, fit, (), book) if s.members.law == "duhem"]
    begun = [s.values for s in starts if s.values is not None]
    shared = {f"duhem.{k}": fit.values[f"bouc_wen.{k}"] for k in ("alpha", "beta")}
    assert any(shared.items() <= dict(values).items() for values in begun)


def test_what_helps_beside_one_law_is_tried_beside_the_others_as_it_ended_there() -> None:
    """A law that bends easily hides what is missing beside all of them."""
    book = opened(CREEPING)
    others = [replace(book.base, base=STILL.replaced("bouc_wen", law())) for law in (Dahl, Duhem)]
    book.race([Start(members, None) for members in others], everyone=True)
    beside = {effect.name: others[0].with_(effect) for effect in (Saturation(), Creep(1))}
    book.race([Start(members, None) for members in beside.values()], everyone=True)
    assert book[beside["creep"]].rms < 0.2 * book[others[0]].rms
    (start,) = crossed(others[1:], 1, book)
    assert start.members == others[1].with_(Creep(1))
    assert start.values is not None
    ended = book[beside["creep"]].values["creep.tau"]
    assert start.values["creep.tau"] == ended == pytest.approx(0.1, rel=0.1)
    own = {k: v for k, v in start.values.items() if k.startswith("duhem.")}
    assert own == {k: v for k, v in book[others[1]].values.items() if k.startswith("duhem.")}
    assert crossed([], 1, book) == []


def test_no_set_with_one_effect_more_is_better_than_it_might_be() -> None:
    """The bound by which a law is not looked at is kept by every set that was fitted."""
    book = opened(CREEPING, choices=40)
    other = replace(book.base, base=STILL.replaced("bouc_wen", Dahl()))
    effects = Creep(1), Saturation(), NonlinearGain(), AmplifierLag()
    sets = [m for at in (book.base, other) for m in (at, *map(at.with_, effects))]
    book.race([Start(members, None) for members in sets])
    for at in (book.base, other):
        bounds = [book.price(at.with_(effect)) for effect in effects if at.with_(effect) in book]
        assert bounds
        assert min(bounds) >= book.bound(at, 1)
    best = book.best
    assert best == book.base.with_(Creep(1))
    # What the best asks for beside a set of one number and effect less, and nothing else.
    one_less = book.price(best) - book.bound(book.base, 1)
    numbers = len(book[best].names) - len(book[book.base].names) - 1
    assert one_less == pytest.approx(numbers * np.log(600), abs=1e-6)
    # Where only the best was fitted the bound is that, or lower.
    blank = Book(book.foot, 40, 1)
    blank.keep(best, book[best])
    for members in book.sets:
        assert blank.bound(members) <= book.bound(members) <= book.price(members) + 1e-6
    plays = replace(book.base, base=STILL.replaced("bouc_wen", Preisach(free=True)))
    # Twenty weights, three lengths, a slope and an offset; how the record begins is not counted;
    # nine numbers of the best one, two of them of how it begins, and an effect chosen of forty.
    more = blank.bound(plays) - book.price(best)
    assert more == pytest.approx(16.0 * np.log(600) - 2.0 * np.log(40), abs=1e-6)


def test_where_an_effect_was_enough_laws_of_too_many_numbers_are_not_tried() -> None:
    book = opened(CREEPING, choices=40)
    book.race([Start(book.base.with_(Creep(1)), None)])

    def tried(*, quiet: bool) -> set[Effect]:
        starts = _lawful(book.base, book.foot, (), book, done=False, quiet=quiet)
        return {start.members.base[start.members.law or ""] for start in starts}

    assert tried(quiet=False) - tried(quiet=True) == {MaxwellSlip(free=True), Preisach(free=True)}
    assert {Dahl(), Duhem(), Preisach()} <= tried(quiet=True)


def test_a_set_that_leaves_only_noise_is_asked_for_no_mechanics() -> None:
    book = opened()
    assert book.foot.model.quasi_static
    more, quiet = (details(book.foot, book, quiet=q) for q in (False, True))
    assert any(not start.members.model.quasi_static for start in more)
    assert quiet
    assert all(start.members.model.quasi_static for start in quiet)
