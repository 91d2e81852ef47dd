"""What a fit says about records it has not seen."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import Offset, PiezoGain, PrandtlIshlinskii, Temperature
from tests.identification.truth import STILL, TRUTH, loops, record

TIME, DRIVE = loops(400)
NOISE = 3e-9
WHOLE = record(STILL, TRUTH, TIME, DRIVE, noise=NOISE)


@pytest.fixture(scope="module")
def fit() -> po.Fit:
    """A fit to a stretch cut out of motion, so that its start is far from rest."""
    return po.solve(po.Identification(STILL, WHOLE.slice(0.7, 2.5)))


def test_its_own_record_is_read_as_it_was_fitted(fit: po.Fit) -> None:
    np.testing.assert_allclose(fit.predict(fit.records[0]), fit.readings[0], atol=1e-3 * NOISE)


def test_the_held_out_rest_is_simulated_through_from_the_fitted_start(fit: po.Fit) -> None:
    longer = WHOLE.slice(0.7, None)
    predicted = fit.predict(longer)
    by_hand = po.simulate(STILL, longer, fit.values, tolerance=1e-8).reading
    np.testing.assert_allclose(predicted, by_hand, rtol=0, atol=0.05 * NOISE)
    assert fit.values["initial.bouc_wen.h"] != 0.0
    late = longer.time > 2.5
    assert late.sum() > 100
    left = (longer.position - predicted)[late]
    assert np.sqrt(np.mean(left**2)) < 1.5 * NOISE
    # Nothing of the held-out readings was looked at.
    spoilt = longer.position.copy()
    spoilt[late] += 1e-6
    np.testing.assert_array_equal(fit.predict(longer.with_(position=spoilt)), predicted)


def test_a_split_is_predicted_on_its_test_part() -> None:
    train, test = WHOLE.split(at=2.0)
    fit = po.solve(po.Identification(STILL, train))
    left = (test.position - fit.predict(test))[test.counted]
    assert test.counted.sum() == 200
    assert np.sqrt(np.mean(left**2)) < 1.5 * NOISE


def test_of_another_record_only_zero_and_start_are_estimated(fit: po.Fit) -> None:
    moved = {**TRUTH, "offset.y0": -4e-6}
    other = record(STILL, moved, TIME, 0.9 * DRIVE, noise=NOISE, seed=5).slice(1.3, None)
    left = other.position - fit.predict(other)
    assert np.sqrt(np.mean(left**2)) < 1.5 * NOISE
    # The stroke is not refitted: another actuator does not fit.
    strong = {**moved, "piezo_gain.d": 1.3e-7}
    alien = record(STILL, strong, TIME, 0.9 * DRIVE, noise=NOISE, seed=5).slice(1.3, None)
    rest = alien.position - fit.predict(alien)
    drive = alien.drive - alien.drive.mean()
    assert np.sqrt(np.mean(rest**2)) > 20 * NOISE
    slope = float(drive @ rest) / float(drive @ drive)
    assert slope == pytest.approx(1e-8, rel=0.2)


def test_a_prediction_that_only_compares_models_is_that_of_a_fine_one(fit: po.Fit) -> None:
    """But for the scheme; also where the start lies far from what a linear step would find."""
    moved = {**TRUTH, "offset.y0": -4e-6}
    other = record(STILL, moved, TIME, 0.9 * DRIVE, noise=NOISE, seed=5).slice(1.3, None)
    stroke = float(np.ptp(other.position))
    rough, fine = fit.predict(other, refine=False), fit.predict(other)
    assert rough.shape == fine.shape
    np.testing.assert_allclose(rough, fine, rtol=0, atol=5e-5 * stroke)
    errors = [np.sqrt(np.mean((other.position - read) ** 2)) for read in (rough, fine)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-3)


def test_another_record_keeps_an_offset_that_the_user_has_fixed() -> None:
    fixed = {"offset.y0": TRUTH["offset.y0"]}
    fit = po.solve(po.Identification(STILL, WHOLE, fixed=fixed, start=po.Start.REST))
    moved = record(STILL, {**TRUTH, "offset.y0": -4e-6}, TIME, 0.9 * DRIVE, noise=NOISE)
    left = moved.position - fit.predict(moved)
    assert left.mean() == pytest.approx(-4e-6 - TRUTH["offset.y0"], rel=1e-2)


def test_a_parameter_of_each_record_is_estimated_on_a_new_one() -> None:
    one = WHOLE.rename("one")
    two = record(STILL, {**TRUTH, "piezo_gain.d": 1e-7}, TIME, DRIVE, noise=NOISE, name="two")
    fit = po.solve(po.Identification(STILL, [one, two], per_record=("piezo_gain.d",)))
    third = {**TRUTH, "piezo_gain.d": 1.4e-7}
    new = record(STILL, third, TIME, 0.9 * DRIVE, noise=NOISE, name="three")
    left = new.position - fit.predict(new)
    assert np.sqrt(np.mean(left**2)) < 1.5 * NOISE
    # The records fitted to are known by their readings, each with its own values.
    for index, known in enumerate((one, two)):
        np.testing.assert_allclose(fit.predict(known), fit.readings[index], atol=1e-2 * NOISE)


def test_a_freed_exponent_is_kept_on_other_records() -> None:
    bent = {**TRUTH, "bouc_wen.n": 1.3}
    measured = record(STILL, bent, TIME, DRIVE, noise=NOISE)
    fit = po.solve(po.Identification(STILL, measured, free=("bouc_wen.n",)))
    other = record(STILL, bent, TIME, 0.9 * DRIVE, noise=NOISE)
    left = other.position - fit.predict(other)
    assert np.sqrt(np.mean(left**2)) < 1.5 * NOISE


def test_a_channel_that_is_missing_is_named() -> None:
    model = STILL + Temperature()
    warm = {"temperature": np.linspace(293.0, 303.0, TIME.size)}
    bare = po.Measurement(
        TIME, DRIVE, WHOLE.position, channels=warm, channel_units={"temperature": "K"}
    )
    fit = po.solve(po.Identification(model, bare))
    with pytest.raises(po.InputError, match="temperature"):
        fit.predict(WHOLE)


def test_where_plays_were_reached_from_is_estimated_on_a_new_record() -> None:
    """The fitted record began anew; the other one after a large swing, which its plays remember."""
    model = PiezoGain() + PrandtlIshlinskii(operators=8, dead_zones=0) + Offset()
    truth = {
        "piezo_gain.d": 1.2e-7, "prandtl_ishlinskii.rho": 5e-8, "prandtl_ishlinskii.decay": 1.0,
        "prandtl_ishlinskii.r": 40.0, "offset.y0": 2e-7,
    }  # fmt: skip
    known = {"prandtl_ishlinskii.r": 40.0}
    measured = record(model, truth, TIME, DRIVE, noise=NOISE)
    fit = po.solve(po.Identification(model, measured, fixed=known))
    past = {"prandtl_ishlinskii.origin": 20.0, "prandtl_ishlinskii.swing": -1.2}
    drive = 20.0 + 0.3 * DRIVE
    other = record(model, {**truth, **past}, TIME, drive, noise=NOISE, seed=3)
    left = other.position - fit.predict(other)
    assert np.sqrt(np.mean(left**2)) < 1.1 * NOISE
    # What the user has said of it stays; a virgin actuator has no past.
    told = {f"prandtl_ishlinskii.{name}": 0.0 for name in ("origin", "swing", "swing_before")}
    for question in (
        po.Identification(model, measured, fixed={**known, **told}),
        po.Identification(model, measured, fixed=known, start=po.Start.REST),
    ):
        fit = po.solve(question)
        left = other.position - fit.predict(other)
        assert np.sqrt(np.mean(left**2)) > 5.0 * NOISE
