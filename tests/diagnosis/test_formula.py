"""A formula reads as it computes, and as an effect it brings the error to the noise."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import Formula, Quantity
from piezo_opt.diagnosis.formula import Factor, Shape, Term
from piezo_opt.diagnosis.propose import library, propose, readable, scale_of
from piezo_opt.effects.base import Place
from tests.diagnosis.planted import FLOOR, HIDDEN, entering, planted
from tests.diagnosis.plants import MOVING, NOISE, TRUTH

PLANTED = (
    ("drag", Place.MOTION, "X'|X'|"),
    ("drive wave", Place.STRAIN, "sin(2 pi v/(31."),
    ("input wave", Place.INPUT, "sin(2 pi v/(25."),
    ("loop wave", Place.LOOP, "sin(2 pi v/("),
)


def proposed(name: str, place: Place) -> Formula:
    found = propose(entering(name), place, FLOOR)
    assert found is not None
    return found


@pytest.mark.parametrize(("name", "place", "text"), PLANTED)
def test_the_planted_law_is_proposed(name: str, place: Place, text: str) -> None:
    formula = proposed(name, place)
    assert len(formula.terms) == 1, str(formula)
    assert text in str(formula)
    assert str(formula).startswith(f"w [{place.unit}] = ")
    assert formula.share > 0.9


def test_coefficients_are_those_that_were_planted() -> None:
    drag = proposed("drag", Place.MOTION)
    (factor,) = drag.terms[0].factors
    _, planted_drag = HIDDEN["drag"]
    assert drag.coefficients[0] / factor.scale**2 == pytest.approx(-planted_drag["k"], rel=0.1)
    wave = proposed("drive wave", Place.STRAIN)
    (factor,) = wave.terms[0].factors
    assert factor.scale == pytest.approx(5.0, rel=0.01)
    assert wave.coefficients[0] == pytest.approx(HIDDEN["drive wave"][1]["a"], rel=0.05)


@pytest.mark.parametrize(("name", "place", "_"), PLANTED)
def test_added_as_an_effect_the_error_falls_to_the_noise(name: str, place: Place, _: str) -> None:
    fit = planted(name)
    effect = proposed(name, place).as_effect()
    assert effect.name == "suspect"
    assert effect.gate == "size"
    richer = po.solve(fit.question.with_model(fit.model + effect), start=fit.values)
    assert fit.rms > 1.3 * NOISE
    assert richer.rms == pytest.approx(NOISE, rel=0.04)
    assert abs(richer.values["suspect.size"]) > 10.0 * richer.std["suspect.size"]


def test_a_law_that_no_term_has_is_met_by_few() -> None:
    """Terms that were chosen first make room for better ones once others stand beside them."""
    fit, formula = planted("hump"), proposed("hump", Place.MOTION)
    assert len(formula.terms) <= 3
    assert formula.share > 0.98
    richer = po.solve(fit.question.with_model(fit.model + formula.as_effect()), start=fit.values)
    assert fit.rms > 9.0 * NOISE
    assert richer.rms < 1.25 * NOISE


STEEP = (Shape.SIGN, Shape.ROOT, Shape.SIGNED_ROOT)


def everything(place: Place) -> Formula:
    """A formula with every shape, of every signal that this place can read."""
    can = readable(entering("drag"), place)
    signals = entering("drag").signals
    terms = [
        Term((Factor(q, shape, scale_of(signals[q]) * (1.0 + 0.1 * k)),))
        for k, shape in enumerate(Shape)
        # The loop follows a jump of the drive within a sample along its path: no straight line.
        if place is not Place.INPUT or shape not in STEEP
        for q in can
    ]
    terms += [t for t in library({q: signals[q] for q in can}) if len(t.factors) == 2][::7]
    if place is Place.INPUT:
        terms = [t for t in terms if all(f.shape not in STEEP for f in t.factors)]
    sizes = np.random.default_rng(0).uniform(0.5, 2.0, len(terms))
    return Formula(place, tuple(terms), tuple(sizes.tolist()), 1.0)


@pytest.mark.parametrize("place", list(Place))
def test_the_effect_is_what_the_numbers_say(place: Place) -> None:
    """The gate's derivative at null is the chain's answer to the terms along the trajectory."""
    chain = entering("drag")
    formula = everything(place)
    effect = formula.as_effect("all_of_it")
    model = MOVING + effect
    record = chain.fit.records[0]
    values = {
        **po.Values.nominal(model), **chain.fit.values, "all_of_it.size": 0.0,
    }  # fmt: skip
    response = po.simulate(model, record, values, sensitivities=("all_of_it.size",))
    signals = chain.signals
    first = formula.coefficients[0]
    w = sum(
        c / first * term.along(signals)
        for c, term in zip(formula.coefficients, formula.terms, strict=True)
    )
    answer = chain.answers(place, np.asarray(w)[:, None])[:, 0]
    exact = response.sensitivities[:, 0]
    # Between samples the terms bend and w is straight: agreement to the sampling.
    error = chain.project(answer - exact)
    assert np.std(error) < 0.03 * np.std(chain.project(exact))


def test_only_what_closes_no_circle_can_be_read() -> None:
    chain = entering("drag")
    # The rest position follows the strain, the loop's rate the drive's.
    assert Quantity.POSITION not in readable(chain, Place.STRAIN)
    assert Quantity.HYSTERESIS not in readable(chain, Place.INPUT)
    assert Quantity.POSITION in readable(chain, Place.MOTION)
    assert Quantity.DRIVE_RATE in readable(chain, Place.STRAIN)
    for place in Place:
        assert {Quantity.DRIVE, Quantity.VELOCITY} <= set(readable(chain, place))


def test_it_vanishes_at_its_null() -> None:
    effect = proposed("drag", Place.MOTION).as_effect()
    record = planted("drag").records[0]
    gone = {**TRUTH, "suspect.size": 0.0}
    with_it = po.simulate(MOVING + effect, record, gone).reading
    np.testing.assert_allclose(with_it, po.simulate(MOVING, record, TRUTH).reading, atol=1e-15)


def test_it_travels_to_other_processes_and_equals_itself() -> None:
    formula = proposed("loop wave", Place.LOOP)
    effect = formula.as_effect("loop_wave")
    again = pickle.loads(pickle.dumps(effect))
    assert again == effect
    assert (MOVING + again).parameters == (MOVING + effect).parameters
    assert str(formula) in (effect.__doc__ or "")


def test_every_wavelength_has_a_parameter_of_its_own() -> None:
    short = Factor(Quantity.POSITION, Shape.SINE, 1e-7)
    long = Factor(Quantity.POSITION, Shape.COSINE, 3e-7)
    both = Formula(Place.OUTPUT, (Term((short,)), Term((long,))), (1e-8, 2e-8), 1.0)
    parameters = both.as_effect().parameters
    assert parameters["length_position"].nominal == 1e-7
    assert parameters["length_position_2"].nominal == 3e-7
    assert parameters["ratio_2"].nominal == 2.0
    assert "sin(2 pi x/(628" in str(both)


def test_noise_gets_no_formula() -> None:
    assert propose(entering("noise"), Place.MOTION, FLOOR) is None


@pytest.mark.parametrize("name", ["Suspect", "two words", "2nd", ""])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(po.InputError, match="snake_case"):
        proposed("drag", Place.MOTION).as_effect(name)
