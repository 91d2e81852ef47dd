"""A model is an immutable sum of effects that can say what it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import pytest

from piezo_opt.assembly import assemble
from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Chain,
    Creep,
    Delay,
    Effect,
    Equations,
    MaxwellSlip,
    Model,
    NonlinearGain,
    Offset,
    Parameter,
    PiezoGain,
    Place,
    RateDependence,
    SecondOrder,
    SensorLag,
    State,
)
from piezo_opt.errors import ModelError

FULL = (
    Delay() + AmplifierLag() + PiezoGain() + BoucWen() + RateDependence() + SecondOrder() + Offset()
)


def test_the_plus_sign_appends_and_leaves_its_terms_alone() -> None:
    base = PiezoGain() + BoucWen()
    richer = base + Creep()
    assert base.names == ("piezo_gain", "bouc_wen")
    assert richer.names == ("piezo_gain", "bouc_wen", "creep")
    assert (base + (Creep() + Offset())).names == (*richer.names, "offset")
    assert Model.of(PiezoGain(), BoucWen()) == base
    assert hash(Model.of(PiezoGain(), BoucWen())) == hash(base)
    assert richer != base
    assert base + Creep(elements=2) != richer


def test_repeated_effects_are_numbered_and_structural_ones_refused() -> None:
    model = PiezoGain() + NonlinearGain() + NonlinearGain() + NonlinearGain()
    assert model.names[1:] == ("nonlinear_gain", "nonlinear_gain_2", "nonlinear_gain_3")
    assert "nonlinear_gain_2.k2" in model.parameters
    with pytest.raises(ModelError, match="already has piezo_gain"):
        model + PiezoGain()


def test_a_second_loop_is_refused_with_the_remedy() -> None:
    with pytest.raises(ModelError, match=r"2 hysteresis loops.*without"):
        PiezoGain() + BoucWen() + _other_loop()


def _other_loop() -> Model:
    from piezo_opt.effects import GeneralisedBoucWen

    return Model.of(GeneralisedBoucWen())


def test_without_and_replaced_name_what_is_missing() -> None:
    assert FULL.without("delay").names == FULL.names[1:]
    swapped = (PiezoGain() + BoucWen() + Offset()).replaced("bouc_wen", MaxwellSlip())
    assert swapped.names == ("piezo_gain", "maxwell_slip", "offset")
    for call in (FULL.without, FULL.__getitem__):
        with pytest.raises(ModelError, match=r"no effect 'creep'; it has delay, amplifier_lag"):
            call("creep")


def test_places_gates_and_mechanics_are_read_off() -> None:
    assert [n for n, _ in FULL.at(Place.INPUT)] == ["delay", "amplifier_lag"]
    assert FULL.loop == "bouc_wen"
    assert PiezoGain().name == "piezo_gain"
    assert not FULL.quasi_static
    assert FULL.without("second_order").quasi_static
    assert FULL.gates == {
        "delay": "delay.T", "amplifier_lag": "amplifier_lag.share",
        "rate_dependence": "rate_dependence.r",
    }  # fmt: skip
    assert "delay" in FULL
    assert "creep" not in FULL
    assert len(FULL) == 7


def test_needs_are_refused_with_the_effect_to_add() -> None:
    assert "BoucWen()" in str(Model.of(PiezoGain()).refusal(RateDependence()))
    assert FULL.refusal(RateDependence()) is None


def test_printing_shows_the_chain_the_equations_and_every_parameter_with_its_unit() -> None:
    text = str(FULL + SensorLag())
    lines = text.splitlines()
    chain = text.split("Equations", maxsplit=1)[0]
    assert [chain.index(p.value) for p in Place] == sorted(chain.index(p.value) for p in Place)
    assert "input line [V]: delay -> amplifier_lag -> drive v" in chain
    assert "strain balance [m]: piezo_gain + bouc_wen -> free displacement s" in chain
    assert "motion balance [m/s^2]: second_order -> position x" in chain
    assert "output line [m]: offset -> sensor_lag -> reading y" in chain
    assert "alpha v' - beta |v'|" in text
    for name, parameter in (FULL + SensorLag()).parameters.items():
        (row,) = [line for line in lines if line.strip().startswith(f"{name} ")]
        assert f" {parameter.unit} " in row
        assert parameter.meaning in row
        assert f"{parameter.nominal:.4g}" in row
        assert ("(fixed)" in row) == parameter.fixed
    assert "quasi-static" not in text
    assert "quasi-static" in str(PiezoGain() + BoucWen())


@final
@dataclass(frozen=True)
class Hollow(Effect):
    """Strain with a memory in two of its four forms.

    s += k z,  z' = v - z if it is rough or worn
    """

    place = Place.STRAIN
    k = Parameter("m/V", "size", nominal=1e-9, null=0.0)
    z = State("V", "memory", when=("rough", "worn"), unless=("new", "smooth"))
    rough: bool = False
    worn: bool = False
    new: bool = False
    smooth: bool = False

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        if "z" not in self.states:
            return Equations(gives=p.k * chain.drive.value)
        return Equations(gives=p.k * x.z, moves={"z": chain.drive.value - x.z})


def test_a_state_may_be_of_several_forms() -> None:
    """With any of some options, and without any of others."""
    base = PiezoGain()
    for options in ({"rough": True}, {"worn": True}, {"rough": True, "worn": True}):
        assert Hollow(**options).states == {"z": 1}
        assert assemble(base + Hollow(**options)).state_names == ("hollow.z",)
        for other in ("new", "smooth"):
            assert Hollow(**options, **{other: True}).states == {}
    assert Hollow().states == {}
    assert assemble(base + Hollow()).state_names == ()


def test_a_form_that_is_no_option_is_refused() -> None:
    with pytest.raises(ModelError, match="'bend' depends on the option 'curved'"):

        class Bent(Effect):
            place = Place.STRAIN
            a = Parameter("1", "size", nominal=0.0, null=0.0)
            bend = Parameter("1", "shape", nominal=0.0, fixed=True, when="curved")

    with pytest.raises(ModelError, match="the state 'z' depends on the option 'rough'"):

        class Worn(Effect):
            place = Place.STRAIN
            a = Parameter("1", "size", nominal=0.0, null=0.0)
            z = State("m", "memory", unless="rough")

    with pytest.raises(ModelError, match="the state 'z' depends on the option 'torn'"):

        class Torn(Effect):
            place = Place.STRAIN
            a = Parameter("1", "size", nominal=0.0, null=0.0)
            z = State("m", "memory", when=("rough", "torn"))
            rough: bool = False
