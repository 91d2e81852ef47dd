"""What is told of a book: no more names than the criterion asks for."""

from __future__ import annotations

from dataclasses import replace

import pytest

from piezo_opt.diagnosis.book import Start
from piezo_opt.diagnosis.evidence import RESOLUTION
from piezo_opt.diagnosis.judge import Judge
from piezo_opt.diagnosis.told import told
from piezo_opt.effects import Creep, SensorLag
from tests.diagnosis.plants import opened


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
