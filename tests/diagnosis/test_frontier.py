"""Which sets of effects are looked at next."""

from __future__ import annotations

from piezo_opt.diagnosis.book import Start
from piezo_opt.diagnosis.frontier import Effort, Frontier, fewest, plainer
from piezo_opt.diagnosis.members import Members
from piezo_opt.effects import Creep, Dahl, MaxwellSlip, Preisach, Saturation
from tests.diagnosis.plants import MOVING, STILL, opened

CREEPING = Creep(1), {"c": 0.1, "tau": 0.1}


def test_the_fewest_effects_come_first_and_each_law_once() -> None:
    """Best first, as a search has them; of three rows the first with anything new is taken."""
    loop, plays = Members(STILL), Members(STILL.replaced("bouc_wen", Preisach()))
    slip, moving = Members(STILL.replaced("bouc_wen", MaxwellSlip())), Members(MOVING)
    one, two = loop.with_(Creep()), loop.with_(Creep()).with_(Saturation())
    other = loop.with_(Saturation())
    best = [two, one, other, plays, moving, slip, loop]
    asks = {plays: 13, moving: 10, slip: 6, loop: 7, one: 9, other: 8, two: 10}.__getitem__

    def first(beam: int, *expanded: Members) -> list[Members]:
        return fewest(best, beam, [m.hypothesis for m in expanded], asks)

    assert first(1) == [moving, slip]  # plays ask for more than twice as many numbers as the slip
    assert first(1, moving, slip) == [plays]
    assert first(1, plays, slip, loop) == [one]
    assert first(2, plays, slip, loop) == [one, other]
    assert first(3, plays, slip, loop, one) == [other]
    assert first(3, plays, slip, loop, one, other) == [two]
    assert first(3, *best) == []


def test_a_law_with_free_weights_is_expanded_beside_its_smooth_form() -> None:
    smooth = Members(STILL.replaced("bouc_wen", Preisach()))
    free = Members(STILL.replaced("bouc_wen", Preisach(free=True)))
    asks = {smooth: 20, free: 33}.__getitem__
    assert fewest([smooth, free], 3, [], asks) == [smooth, free]
    assert fewest([free, smooth], 3, [smooth.hypothesis], asks) == [free]


def test_an_answer_is_noise_without_what_is_not_missed_and_has_its_best_law() -> None:
    """Beside the law of the best set the others may say less than beside another one."""
    book = opened(CREEPING, choices=40)
    effects = (Creep(1), Saturation())
    rough = Members(STILL.replaced("bouc_wen", Dahl()), effects)
    own = book.base.with_(Creep(1))
    book.race([Start(rough, None), Start(own, None)], everyone=True)
    frontier = Frontier(book, Effort.NORMAL, 0.35)
    assert frontier._lightest(rough) == own
    assert book.price(rough.without("saturation")) > book.price(own)
    assert frontier.answer == own


def test_laws_that_might_say_the_same_with_less_are_asked_before_two_effects_are_told() -> None:
    book = opened(CREEPING, choices=40)
    other = Members(STILL.replaced("bouc_wen", Dahl()))
    one = book.base.with_(Creep(1))
    two = one.with_(Saturation())
    book.race([Start(one, None), Start(two, None), Start(other, None)])
    assert book.best == one
    assert plainer(book, [other], two) == [other]
    assert plainer(book, [other], one) == []  # as plain as can be
    elsewhere = other.with_(Creep(1))
    book.race([Start(elsewhere, None)])
    assert plainer(book, [other], elsewhere) == []  # the same law
    assert plainer(book, [other.with_(Creep(1)).with_(Saturation())], two) == []  # says more
