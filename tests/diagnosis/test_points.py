"""The ladder as it is told, from the baseline up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from piezo_opt.diagnosis.points import Point, _in_detail, points
from piezo_opt.effects import Creep, Model, PrandtlIshlinskii, SecondOrder
from tests.diagnosis.plants import STILL

FOOT = Point("baseline", 9.0, 10.0)
MOVING = STILL + SecondOrder() + Creep()


def step(name: str, before: float, after: float) -> Any:
    return SimpleNamespace(
        name=name, rms_before=before, rms_after=after, held_out_before=before + 1.0,
        held_out_after=after + 1.0, delta_bic=50.0,
    )  # fmt: skip


def told(*steps: Any, final: float, refined: tuple[str, ...] = (), model: Model = STILL) -> Any:
    return points(FOOT, steps, Point("final", final, final + 1.0), STILL, model, refined)


def test_it_begins_at_the_baseline_also_where_mechanics_joined_before_the_first_effect() -> None:
    ladder = told(
        step("creep", 4.0, 2.0), final=2.0, refined=("second_order", "bouc_wen.n"), model=MOVING
    )
    assert ladder == (
        FOOT,
        Point("with second_order, n free", 4.0, 5.0),
        Point("+ creep", 2.0, 3.0, 50.0),
    )


@pytest.mark.parametrize(
    ("details", "label"),
    [((), "+ creep"), (("creep.power",), "+ creep, power free"),
     (("creep.power", "creep.spread"), "+ creep in detail")],
)  # fmt: skip
def test_details_of_an_effect_come_with_it(details: tuple[str, ...], label: str) -> None:
    ladder = told(step("creep", 4.0, 2.0), final=2.0, refined=("bouc_wen.n", *details))
    assert [point.label for point in ladder[1:]] == ["n free", label]


def test_another_hysteresis_law_is_a_point_of_its_own() -> None:
    assert told(final=4.0, model=STILL.replaced("bouc_wen", PrandtlIshlinskii())) == (
        FOOT,
        Point("with prandtl_ishlinskii", 4.0, 5.0),
    )


def test_a_ladder_on_which_nothing_changed_is_empty() -> None:
    assert told(final=9.0, refined=("bouc_wen.n",)) == ()


@pytest.mark.parametrize(
    ("refined", "said"),
    [
        ((), []),
        (("bouc_wen.n",), ["n free"]),
        (("second_order",), ["with second_order"]),
        (("bouc_wen.n", "bouc_wen.x0"), ["bouc_wen in detail"]),
        (("bouc_wen.n", "creep", "creep.power"), ["n free", "power free"]),
        (("creep",), ["creep in detail"]),
        (("mains_pickup.f", "second_order", "mains_pickup.s2", "bouc_wen.n"),
         ["mains_pickup in detail", "with second_order", "n free"]),
    ],
)  # fmt: skip
def test_refinements_are_told_in_few_words(refined: tuple[str, ...], said: list[str]) -> None:
    assert _in_detail(refined, {"second_order"}) == said
