"""Names, near names, and models from data."""

from __future__ import annotations

from typing import Any

import pytest

import piezo_opt.effects
from piezo_opt.effects import CATALOGUE, BoucWen, Creep, PiezoGain, effect, model_from_dict
from piezo_opt.errors import InputError, ModelError


def test_an_effect_is_had_by_its_name_and_options() -> None:
    assert effect("bouc_wen") == BoucWen()
    assert effect("creep", elements=4) == Creep(4)


def test_a_misspelt_name_gets_the_near_ones() -> None:
    with pytest.raises(InputError, match="did you mean creep"):
        effect("crep")
    with pytest.raises(InputError, match="second_order"):
        effect("secnd_ordr")
    with pytest.raises(InputError, match=r"there are saturation, dead_zone, .*offset"):
        effect("zzz")
    with pytest.raises(InputError, match="no effect 'backlash': it is an option of dead_zone"):
        effect("backlash")


def test_an_unknown_option_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="creep has no option 'element': it has elements"):
        effect("creep", element=4)
    with pytest.raises(InputError, match="bouc_wen has no option 'n': it has none"):
        effect("bouc_wen", n=2)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({}, "no list of effects"),
        ([], "no list of effects"),
        ({"effects": {"effect": "creep"}}, "no list of effects"),
        ({"effects": ["creep"]}, "Effect 1 of the model has no name"),
        ({"effects": [{"effect": "creep"}, {"elements": 3}]}, "Effect 2 of the model has no name"),
        ({"effects": [{"effect": "wax"}]}, "no effect 'wax'"),
    ],
)
def test_data_that_is_no_model_is_refused(data: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        model_from_dict(data)


def test_data_with_two_laws_of_hysteresis_is_refused() -> None:
    data = {"effects": [{"effect": "bouc_wen"}, {"effect": "dahl"}]}
    with pytest.raises(ModelError, match="2 hysteresis loops"):
        model_from_dict(data)


def test_the_package_exports_every_effect_of_the_catalogue() -> None:
    for kind in CATALOGUE.values():
        assert kind.__name__ in piezo_opt.effects.__all__
        assert getattr(piezo_opt.effects, kind.__name__) is kind


def test_the_catalogue_cannot_be_changed() -> None:
    with pytest.raises(TypeError):
        CATALOGUE["mine"] = PiezoGain  # type: ignore[index]
