"""Many sets at once: the numbers of one at a time, whatever the model, and nothing copied."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import (
    AmplifierLag,
    Asymmetry,
    BoucWen,
    Creep,
    Delay,
    Friction,
    MainsPickup,
    Model,
    Offset,
    PiezoGain,
    PrandtlIshlinskii,
    Saturation,
    SecondOrder,
)
from piezo_opt.measurement import FloatArray
from piezo_opt.simulation import Simulator, Substeps
from piezo_opt.simulation.compiler import find_compiler
from piezo_opt.simulation.lanes import WIDTH, source
from tests.identification.truth import MOVING, STILL, TRUTH, loops, record

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")

TIME, DRIVE = loops(300, rate=1000.0)
MECHANICS = {"second_order.omega": 900.0, "second_order.zeta": 0.1}
COUNT = 2 * WIDTH + 3


def bare(**more: Any) -> po.Measurement:
    return po.Measurement(TIME, DRIVE, np.linspace(0.0, 1e-6, TIME.size), **more)


def sets(truth: Mapping[str, float], count: int = COUNT) -> dict[str, FloatArray]:
    generator = np.random.default_rng(0)
    return {k: v * generator.uniform(0.9, 1.1, count) for k, v in truth.items()}


def one(values: Mapping[str, Any], k: int, model: Model) -> dict[str, float]:
    own = {n: float(v[k]) if np.ndim(v) else float(v) for n, v in values.items()}
    return {**po.Values.nominal(model), **own}


def alone(model: Model, values: Mapping[str, Any], k: int, substeps: Substeps,
          record: po.Measurement, **more: Any) -> FloatArray:  # fmt: skip
    runtime = [n for n in values if n in model.parameters]
    own = one(values, k, model)
    return Simulator(model, record, own, substeps=substeps, runtime=runtime, **more).reading(own)


@pytest.mark.parametrize(
    ("model", "truth"),
    [
        (STILL, TRUTH),
        (MOVING, {**TRUTH, **MECHANICS}),
        (STILL, {**TRUTH, "bouc_wen.n": 1.4}),
        (MOVING, {**TRUTH, **MECHANICS, "initial.bouc_wen.h": 2e-7}),
        (
            AmplifierLag() + Saturation() + PiezoGain() + BoucWen() + Creep() + Offset(),
            {
                **TRUTH, "amplifier_lag.share": 0.8, "amplifier_lag.tau": 2e-3, "creep.c": 0.03,
                "creep.tau": 0.05, "saturation.s": 0.5, "saturation.v_s": 40.0,
            },
        ),
        (
            PiezoGain() + SecondOrder() + Friction() + Offset(),
            {"piezo_gain.d": 1.2e-7, **MECHANICS, "friction.F": 0.6, "friction.z0": 4e-7},
        ),
        (
            PiezoGain() + PrandtlIshlinskii() + Offset(),
            {
                "piezo_gain.d": 1.2e-7, "prandtl_ishlinskii.rho": 4e-8,
                "prandtl_ishlinskii.r": 40.0, "prandtl_ishlinskii.decay": 1.0,
            },
        ),
        (
            PiezoGain() + BoucWen() + Asymmetry() + Offset() + MainsPickup(),
            {**TRUTH, "asymmetry.delta": 3e-11, "mains_pickup.a": 5e-9, "mains_pickup.phi": 0.3},
        ),
    ],
    ids=lambda given: " ".join(given.names) if isinstance(given, Model) else "",
)  # fmt: skip
def test_a_lane_is_a_simulation(model: Model, truth: Mapping[str, float]) -> None:
    values = sets(truth)
    many = po.simulate_many(model, values, bare())
    assert many.lanes == WIDTH
    assert many.readings.shape == (COUNT, TIME.size)
    for k in (0, 1, WIDTH - 1, WIDTH, COUNT - 1):
        wanted = alone(model, values, k, many.substeps, bare())
        span = np.ptp(wanted)
        np.testing.assert_allclose(many.readings[k], wanted, atol=1e-12 * span, rtol=0)
        off = float(np.sum((wanted - bare().position) ** 2))
        assert many.squares[k] == pytest.approx(off, rel=1e-9)


def test_where_nothing_asks_for_finer_sub_steps_it_is_po_simulate() -> None:
    """Sub-steps are chosen for the extremes; sets that are all alike share those of each."""
    values = {n: np.full(5, v) for n, v in {**TRUTH, **MECHANICS}.items()}
    many = po.simulate_many(MOVING, values, bare())
    wanted = po.simulate(MOVING, bare(), one(values, 0, MOVING)).reading
    np.testing.assert_allclose(many.readings[3], wanted, atol=1e-12 * np.ptp(wanted), rtol=0)


def test_the_sub_steps_are_enough_for_all() -> None:
    values = {**TRUTH, "second_order.zeta": 0.05,
              "second_order.omega": np.linspace(200.0, 2500.0, 9)}  # fmt: skip
    many = po.simulate_many(MOVING, values, bare())
    for k in range(9):
        fine = po.simulate(MOVING, bare(), one(values, k, MOVING), tolerance=1e-8).reading
        assert np.sqrt(np.mean((many.readings[k] - fine) ** 2)) < 5e-5 * np.ptp(fine)


def test_threads_and_strides_change_nothing() -> None:
    values = sets({**TRUTH, **MECHANICS}, 10 * WIDTH + 1)
    single = po.simulate_many(MOVING, values, bare(), threads=1)
    double = po.simulate_many(MOVING, values, bare(), threads=4)
    np.testing.assert_array_equal(single.readings, double.readings)
    # A column of a table lies in memory with a stride, and is read where it is.
    table = np.array(list(values.values())).T.copy()
    columns = {name: table[:, i] for i, name in enumerate(values)}
    assert not columns["bouc_wen.beta"].flags.c_contiguous
    strided = po.simulate_many(MOVING, columns, bare())
    np.testing.assert_array_equal(strided.readings, single.readings)
    back = {name: column[::-1] for name, column in values.items()}
    np.testing.assert_array_equal(
        po.simulate_many(MOVING, back, bare()).readings[::-1], single.readings
    )


def test_sums_of_squares_need_no_room_for_readings() -> None:
    measured = record(STILL, TRUTH, TIME, DRIVE, noise=3e-9, startup=0.05)
    values = sets(TRUTH)
    whole = po.simulate_many(STILL, values, measured)
    lean = po.simulate_many(STILL, values, measured, readings=False)
    assert lean.readings.shape == (0, TIME.size)
    np.testing.assert_array_equal(lean.squares, whole.squares)
    off = (whole.readings - measured.position)[:, measured.counted]
    np.testing.assert_allclose(lean.squares, np.sum(off**2, axis=1), rtol=1e-12)


def test_a_set_that_runs_away_takes_no_other_along() -> None:
    values: dict[str, Any] = {n: np.full(20, v) for n, v in TRUTH.items()}
    values["bouc_wen.gamma"][7] = -80.0
    many = po.simulate_many(STILL, values, bare(), substeps=Substeps(1e-3, 10.0))
    assert not many.squares[7] < 1.0
    assert np.isfinite(np.delete(many.readings, 7, axis=0)).all()


def test_a_delay_and_a_steady_state_are_simulated_one_by_one() -> None:
    late = STILL + Delay()
    values = {**TRUTH, "delay.T": np.linspace(0.0, 2e-3, 4)}
    many = po.simulate_many(late, values, bare())
    assert many.lanes == 1
    wanted = alone(late, values, 2, many.substeps, bare())
    np.testing.assert_array_equal(many.readings[2], wanted)
    # One delay for all is the same time axis for all.
    same = po.simulate_many(late, {**sets(TRUTH), "delay.T": 1.5e-3}, bare())
    assert same.lanes == WIDTH
    wanted = alone(late, {**sets(TRUTH), "delay.T": 1.5e-3}, 4, same.substeps, bare())
    np.testing.assert_allclose(same.readings[4], wanted, atol=1e-12 * np.ptp(wanted), rtol=0)
    turning = 30.0 - 30.0 * np.cos(2.0 * np.pi * TIME / 0.1)
    steady = replace(bare(), drive=turning, period=0.1)
    around = po.simulate_many(STILL, sets(TRUTH, 3), steady, initial=po.Initial.PERIODIC)
    assert around.lanes == 1
    wanted = po.simulate(
        STILL, steady, one(sets(TRUTH, 3), 1, STILL), initial=po.Initial.PERIODIC
    ).reading
    np.testing.assert_allclose(around.readings[1], wanted, atol=1e-4 * np.ptp(wanted))


def test_without_a_compiler_the_numbers_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    values = sets(TRUTH, 4)
    many = po.simulate_many(STILL, values, bare())
    from piezo_opt.simulation import many as room

    monkeypatch.setattr(room, "_library", lambda _: None)
    slow = po.simulate_many(STILL, values, bare())
    assert (many.lanes, slow.lanes) == (WIDTH, 1)
    np.testing.assert_allclose(many.readings, slow.readings, atol=1e-18)


def test_every_loop_over_the_lanes_is_for_the_vectoriser() -> None:
    """No call into the C library stands in a sub-step, which would end it."""
    from piezo_opt.assembly import assemble, folded

    text = source(assemble(STILL, folded(STILL, ["bouc_wen.n"])))
    inner = text.split("for (int i = 0; i < m; ++i) {")[1].split("t_0 += h_0")[0]
    assert "po_exp" in inner
    for call in (" pow(", " exp(", " log("):
        assert call not in inner


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"piezo_gain.d": 1e-7}, "at least one parameter as an array"),
        ({"piezo_gain.d": np.ones(2), "offset.y0": np.ones(3)}, "all of one length"),
        ({"piezo_gain.d": np.ones((2, 2))}, "in one row"),
        ({"piezo_gain.d": np.array([1.0, np.nan])}, "finite numbers"),
        ({"piezo_gain.x": np.ones(2)}, "no parameter 'piezo_gain.x'"),
    ],
)
def test_what_makes_no_sense_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(po.PiezoOptError, match=words):
        po.simulate_many(STILL, values, bare())
