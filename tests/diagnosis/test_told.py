"""What is told of a book: no more names than the criterion asks for."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

import piezo_opt as po
from piezo_opt.diagnosis.book import Book, Start
from piezo_opt.diagnosis.evidence import RESOLUTION
from piezo_opt.diagnosis.judge import Judge
from piezo_opt.diagnosis.moves import at_home
from piezo_opt.diagnosis.refit import refit
from piezo_opt.diagnosis.told import told
from piezo_opt.effects import Creep, Delay, GeneralisedBoucWen, SecondOrder, SensorLag
from tests.diagnosis.plants import NOISE, STILL, clock, measured, opened, sine


def test_details_that_do_not_pay_do_not_make_a_rival_dear() -> None:
    """Creep beside a law with an exponent that the record does not ask for."""
    book = opened((Creep(1), {"c": 0.1, "tau": 0.1}), choices=40)
    plain, lag = book.base.with_(Creep(1)), book.base.with_(SensorLag())
    rich = replace(plain, free=("bouc_wen.n",))
    begun = {"sensor_lag.share": 0.1, "sensor_lag.tau": 0.1}
    book.race([Start(lag, {**book.foot.values, **begun}), Start(rich, None)], everyone=True)
    assert plain not in book
    answer = told(book, (), 0.35, Judge(None))
    assert book.price(plain) < book.price(rich)
    assert set(answer.steps[0].group) == {"creep", "sensor_lag"}


@pytest.mark.parametrize("strength", [0.0019, 0.003])
def test_of_answers_that_are_even_the_one_with_fewer_names_is_told(strength: float) -> None:
    book = opened((Creep(1), {"c": strength, "tau": 0.1}))
    named = book.base.with_(Creep(1))
    book.race([Start(named, None)])
    asked = book.price(book.base) - book.price(named)
    assert asked > 0.0
    even = asked < RESOLUTION
    assert even is (strength < 0.0025)
    # However little an effect must explain, its name is not told for nothing.
    answer = told(book, (), 1e-9, Judge(None))
    assert [step.name for step in answer.steps] == ["creep"] * (not even)


def test_another_law_that_is_even_with_the_own_one_is_not_told() -> None:
    """Though the own one was never fitted beside the effect that was found."""
    book = opened((Creep(1), {"c": 0.1, "tau": 0.1}))
    base = book.base.base.replaced("bouc_wen", GeneralisedBoucWen())
    other = replace(book.base, base=base).with_(Creep(1))
    book.race([Start(other, None)])
    assert book.best == other
    assert book[other].rms == pytest.approx(NOISE, rel=0.1)
    answer = told(book, (), 0.35, Judge(None))
    assert answer.members.law == "bouc_wen"
    assert answer.final.rms == pytest.approx(book[other].rms, rel=0.01)
    assert answer.final.values["bouc_wen.beta"] == pytest.approx(0.03, rel=0.05)
    assert [step.name for step in answer.steps] == ["creep"]


def test_what_the_user_has_fixed_of_the_own_law_stays_fixed() -> None:
    plain = opened((Creep(1), {"c": 0.1, "tau": 0.1}))
    question = replace(plain.question, fixed={"bouc_wen.n": 1.0})
    for book, free in (
        (plain, {(), ("bouc_wen.n",)}),
        (Book(replace(plain.foot, question=question), 1, 1), {()}),
    ):
        base = book.base.base.replaced("bouc_wen", GeneralisedBoucWen())
        other = replace(book.base, base=base)
        book.race([Start(other, None)])
        begun = at_home(other, book[other], book)
        assert {start.members.free for start in begun} == free
        assert {start.members.law for start in begun} == {"bouc_wen"}


def test_a_step_on_mechanics_that_do_not_ring_has_a_figure() -> None:
    book = opened((Creep(1), {"c": 0.1, "tau": 0.1}))
    slow = replace(book.base, base=book.base.base + SecondOrder())
    begun = {**book.foot.values, "second_order.omega": 600.0, "second_order.zeta": 1.5}
    held = {"creep.c": 0.1, "creep.tau": 0.1}
    more = slow.with_(Creep(1))
    for members, values in ((slow, begun), (more, {**begun, **held})):
        book.keep(members, refit(members.question(book.question), values, 0))
    assert book.price(slow) == math.inf
    samples = sum(book.colour.lengths)
    gained = samples * math.log((book[slow].rms / book[more].rms) ** 2)
    asked = 3.0 * math.log(samples)  # for its strength, its time, and where it begins
    assert book.fall(slow, more) == pytest.approx(gained - asked)


def test_of_answers_that_leave_as_little_the_one_that_predicts_better_is_told() -> None:
    """A lag that a slow record cannot tell from a delay, and a fast one can."""
    lag = SensorLag(), {"share": 1.0, "tau": 5e-4}
    time = clock(600)
    record = measured(STILL, time, sine(time, 2.0), lag)
    book = Book(po.solve(po.Identification(STILL, record)), 1, 1)
    late, lagging = book.base.with_(Delay()), book.base.with_(SensorLag())
    begun = {"delay.T": 5e-4, "sensor_lag.share": 1.0, "sensor_lag.tau": 5e-4}
    book.race([Start(m, {**book.foot.values, **begun}) for m in (late, lagging)], everyone=True)
    assert book.best == late
    assert book[lagging].rms == pytest.approx(book[late].rms, rel=0.02)
    assert told(book, (), 0.35, Judge(None)).members == late
    fast = measured(STILL, time, sine(time, 80.0), lag, seed=1, name="fast")
    answer = told(book, (), 0.35, Judge(fast))
    assert [step.name for step in answer.steps] == ["sensor_lag"]
    assert answer.steps[0].held_out_after == pytest.approx(NOISE, rel=0.1)
    # A record that tells them apart no better changes nothing.
    slow = measured(STILL, time, sine(time, 2.0), lag, seed=2, name="slow")
    assert told(book, (), 0.35, Judge(slow)).members == late
