"""Which numbers are estimated, between which bounds, and how they reach each record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    ChargeBackCoupling,
    Creep,
    Drift,
    Friction,
    HystereticForce,
    Offset,
    PiezoGain,
    SecondOrder,
)
from piezo_opt.identification.unknowns import Unknowns, limits, theta_of, unknowns
from tests.identification.truth import MOVING, STILL, TRUTH, loops, record

TIME, DRIVE = loops(200)
RECORD = po.Measurement(TIME, DRIVE, 1e-7 * DRIVE)
PAIR = (RECORD.rename("one"), RECORD.rename("two"))


def listed(question: po.Identification) -> Unknowns:
    return unknowns(question, po.Values.nominal(question.model))


def test_one_record_has_plain_names_and_its_memory_is_unknown() -> None:
    found = listed(po.Identification(STILL, RECORD))
    assert found.names == (
        "piezo_gain.d", "bouc_wen.alpha", "bouc_wen.beta", "bouc_wen.gamma", "offset.y0",
        "initial.bouc_wen.h",
    )  # fmt: skip
    assert dict(found.kept) == {"bouc_wen.n": 1.0, "bouc_wen.h_s": 1e-6}


def test_where_a_lag_begins_is_asked_only_without_mechanics() -> None:
    """Beside mechanics, which take that up, a lag would always beat a delay."""
    for model, asked in ((STILL, True), (MOVING, False)):
        names = listed(po.Identification(model + AmplifierLag(), RECORD)).names
        assert ("initial.amplifier_lag.z" in names) is asked


def test_a_virgin_start_leaves_no_memory_to_estimate() -> None:
    found = listed(po.Identification(MOVING, RECORD, start=po.Start.REST))
    assert not [n for n in found.names if n.startswith("initial.")]


def test_every_state_that_keeps_a_memory_is_an_unknown_within_half_a_stroke() -> None:
    found = listed(po.Identification(MOVING + Creep(elements=2), RECORD))
    starts = {m.name: m for m in found.members if m.name.startswith("initial.")}
    assert set(starts) == {
        "initial.bouc_wen.h", "initial.second_order.x", "initial.second_order.w",
        "initial.creep.z[0]", "initial.creep.z[1]",
    }  # fmt: skip
    stroke = float(np.ptp(RECORD.position))
    assert starts["initial.bouc_wen.h"].high == pytest.approx(0.5 * stroke)
    # An element may have followed the drive from 0 V on.
    followed = stroke * float(np.abs(RECORD.drive).max() / np.ptp(RECORD.drive))
    assert starts["initial.creep.z[1]"].low == pytest.approx(-0.5 * stroke - followed)


@pytest.mark.parametrize("stroke", [6e-9, 6e-6, 6e-3])
def test_a_contact_starts_within_one_and_a_half_of_its_largest_deflection(stroke: float) -> None:
    """A state without unit is a share: how far the stage moves says nothing about it."""
    record = RECORD.with_(position=stroke / 60.0 * DRIVE)
    found = listed(po.Identification(MOVING + Friction(), record))
    (contact,) = (m for m in found.members if m.name == "initial.friction.z")
    assert (contact.low, contact.high, contact.scale) == (-1.5, 1.5, 0.3)
    (loop,) = (m for m in found.members if m.name == "initial.bouc_wen.h")
    assert loop.high == pytest.approx(0.5 * float(np.ptp(record.position)))
    assert loop.scale == pytest.approx(0.05 * float(np.ptp(record.position)))


def test_a_campaign_numbers_what_each_record_has_of_its_own() -> None:
    question = po.Identification(STILL, PAIR, per_record=("bouc_wen.beta",))
    found = listed(question)
    assert found.names == (
        "piezo_gain.d", "bouc_wen.alpha", "bouc_wen.beta[0]", "bouc_wen.beta[1]",
        "bouc_wen.gamma", "offset.y0[0]", "offset.y0[1]",
        "initial.bouc_wen.h[0]", "initial.bouc_wen.h[1]",
    )  # fmt: skip
    theta = np.arange(9.0)
    one, two = found.of_record(0, theta), found.of_record(1, theta)
    assert [one[n] for n in ("bouc_wen.beta", "offset.y0", "initial.bouc_wen.h")] == [2, 5, 7]
    assert [two[n] for n in ("bouc_wen.beta", "offset.y0", "initial.bouc_wen.h")] == [3, 6, 8]
    assert one["piezo_gain.d"] == two["piezo_gain.d"] == 0.0
    assert found.columns(1) == [0, 1, 3, 4, 6, 8]


def test_a_start_reaches_numbered_unknowns_by_its_plain_name() -> None:
    found = listed(po.Identification(STILL, PAIR))
    theta = theta_of(found, {**TRUTH, "offset.y0[1]": 5e-7})
    start = dict(zip(found.names, theta, strict=True))
    assert start["offset.y0[0]"] == TRUTH["offset.y0"]
    assert start["offset.y0[1]"] == 5e-7
    assert start["initial.bouc_wen.h[0]"] == 0.0


def test_one_record_may_be_fixed_alone() -> None:
    found = listed(po.Identification(STILL, PAIR, fixed={"offset.y0[1]": 3e-7}))
    assert "offset.y0[0]" in found.names
    assert "offset.y0[1]" not in found.names
    assert found.of_record(1, np.zeros(len(found.members)))["offset.y0"] == 3e-7


def test_fixed_and_freed() -> None:
    question = po.Identification(
        STILL, RECORD, fixed={"bouc_wen.gamma": "0 1/V"}, free=("bouc_wen.n",),
        values={"bouc_wen.h_s": 2e-6},
    )  # fmt: skip
    found = listed(question)
    assert "bouc_wen.n" in found.names
    assert dict(found.kept) == {"bouc_wen.gamma": 0.0, "bouc_wen.h_s": 2e-6}


def test_bounds_of_the_user_stand_and_starts_are_clipped_into_them() -> None:
    question = po.Identification(
        STILL, PAIR, bounds={"piezo_gain.d": (1e-8, 2e-8), "offset.y0[1]": (0.0, 1e-9)}
    )
    found = listed(question)
    member = {m.name: (m.low, m.high) for m in found.members}
    assert member["piezo_gain.d"] == (1e-8, 2e-8)
    assert member["offset.y0[1]"] == (0.0, 1e-9)
    assert member["offset.y0[0]"] == (-1.0, 1.0)
    assert theta_of(found, TRUTH)[0] == 2e-8


def test_times_lie_between_a_tenth_of_a_step_and_three_durations() -> None:
    lag = AmplifierLag().parameters["tau"]
    low, high = limits(lag, (RECORD,))
    assert low == pytest.approx(max(lag.bounds[0], 0.1 * RECORD.step))
    assert high == pytest.approx(min(lag.bounds[1], 3.0 * RECORD.duration))
    slow = po.Measurement(100.0 * TIME, DRIVE, 1e-7 * DRIVE)
    creep = Creep().parameters["tau"]
    assert limits(creep, (slow,)) == pytest.approx((0.1, 3.0 * 199.0))


def test_a_natural_frequency_lies_within_what_sampling_and_duration_hold() -> None:
    omega = MOVING["second_order"].parameters["omega"]
    low, high = limits(omega, (RECORD,))
    assert high == pytest.approx(2 * np.pi * 0.45 * 100.0)
    assert low == pytest.approx(2 * np.pi / (4 * 1.99))
    # The best of several records counts.
    fast = po.Measurement(TIME / 10, DRIVE, 1e-7 * DRIVE)
    assert limits(omega, (RECORD, fast))[1] == pytest.approx(2 * np.pi * 450.0)


def test_a_mirrored_sensor_mirrors_one_sided_strokes_only() -> None:
    mirrored = po.Measurement(TIME, DRIVE, -1e-7 * DRIVE)
    assert mirrored.falls
    assert not RECORD.falls
    alpha, d = BoucWen().parameters["alpha"], PiezoGain().parameters["d"]
    assert limits(alpha, (mirrored,)) == (-alpha.bounds[1], 0.0)
    back = ChargeBackCoupling(whole=True).parameters["back"]
    assert limits(back, (mirrored,)) == (-back.bounds[1], 0.0)
    assert limits(alpha, (RECORD,)) == alpha.bounds
    assert limits(d, (mirrored,)) == d.bounds


def test_a_loop_does_not_saturate_within_a_three_thousandth_of_the_range() -> None:
    beta, gamma = (BoucWen().parameters[name] for name in ("beta", "gamma"))
    sharpest = 1.0 / (3e-4 * np.ptp(RECORD.drive))
    assert limits(beta, (RECORD,)) == pytest.approx((0.0, sharpest))
    assert limits(gamma, (RECORD,)) == pytest.approx((-sharpest, sharpest))
    wider = RECORD.with_(drive=10.0 * RECORD.drive)
    assert limits(beta, (RECORD, wider)) == pytest.approx((0.0, 0.1 * sharpest))
    tiny = RECORD.with_(drive=1e-3 * RECORD.drive)
    assert limits(beta, (tiny,)) == beta.bounds


def test_other_units_keep_their_declared_bounds() -> None:
    for effect, name in ((Drift(), "rate"), (Offset(), "y0"), (BoucWen(), "alpha")):
        parameter = effect.parameters[name]
        assert limits(parameter, (RECORD,)) == parameter.bounds


def test_a_mirrored_actuator_is_fitted() -> None:
    truth = {**TRUTH, "piezo_gain.d": -1.2e-7, "bouc_wen.alpha": -4e-8}
    fit = po.solve(po.Identification(STILL, record(STILL, truth, TIME, DRIVE)))
    assert {n: fit.values[n] for n in truth} == pytest.approx(truth, rel=1e-3)


def test_frequencies_and_forces_per_mass_change_in_proportion() -> None:
    time = np.arange(100) / 100.0
    record = po.Measurement(time, 10.0 * np.sin(time), 1e-6 * np.sin(time))
    model = PiezoGain() + SecondOrder() + Friction() + HystereticForce()
    question = po.Identification(model, record)
    unknown = unknowns(question, po.Values.nominal(model))
    chosen = {m.name for m in unknown.members if m.relative}
    assert chosen == {"second_order.omega", "friction.F", "hysteretic_force.alpha"}
    assert unknown.relative.tolist() == [m.relative for m in unknown.members]
    # A force that the user lets be negative has no logarithm.
    free = replace(question, bounds={"friction.F": (-1.0, 1.0)})
    assert not {m.name: m.relative for m in unknowns(free, po.Values.nominal(model)).members}[
        "friction.F"
    ]


def test_a_resonance_is_no_mirror() -> None:
    """Beyond it the position falls as the drive rises; the slow part says which way it goes."""
    time = np.arange(2000) / 2000.0
    fast = 2.0 * np.pi * 200.0 * time
    drive = 50.0 + 20.0 * np.sin(2.0 * np.pi * time) + 20.0 * np.sin(fast)
    position = 1e-7 * (20.0 * np.sin(2.0 * np.pi * time) - 100.0 * np.sin(fast))
    assert np.corrcoef(drive, position)[0, 1] < 0.0
    assert not po.Measurement(time, drive, position).falls
    assert po.Measurement(time, drive, -position).falls


@pytest.mark.parametrize("seed", range(8))
def test_what_settles_at_the_beginning_mirrors_no_fast_record(seed: int) -> None:
    generator = np.random.default_rng(seed)
    time = np.arange(30_000) / 500.0
    lines = np.geomspace(1.0, 50.0, 12)
    drive = 50.0 + np.sum(
        [np.cos(2.0 * np.pi * f * time + generator.uniform(0.0, 6.28)) for f in lines], axis=0
    )
    settles = 2e-6 * np.exp(-time / 2.0)
    for settling in (settles, -settles):
        record = po.Measurement(time, drive, 1e-7 * drive + settling)
        assert not record.falls
        assert record.with_(position=-record.position).falls
