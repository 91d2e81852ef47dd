"""What the simulation says about its own error is true."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Delay,
    Friction,
    HystereticForce,
    Model,
    Offset,
    PiezoGain,
    SecondOrder,
)
from piezo_opt.errors import ModelError
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import Accuracy, Simulator, Substeps
from piezo_opt.simulation.accuracy import choose, fastest_rates
from piezo_opt.values import Values

FloatArray = NDArray[Any]

BASE = PiezoGain() + BoucWen() + SecondOrder()
MODELS: dict[str, tuple[Model, Mapping[str, float]]] = {
    "loop": (PiezoGain() + BoucWen(), {}),
    "mechanics": (BASE + Offset(), {}),
    "friction": (BASE + Friction(), {"friction.F": 2.0}),
    "hysteretic force": (BASE + HystereticForce(), {"hysteretic_force.alpha": 1e7}),
    "delay": (BASE + Delay(), {"delay.T": 1.3e-4}),
}


def record(seed: int, between: Between) -> Measurement:
    rng = np.random.default_rng(seed)
    time = np.arange(300) / 5e3
    phase = rng.uniform(0, 6, 2)
    slow, fast = rng.uniform(10, 60), rng.uniform(60, 200)
    drive = 30.0 + 40.0 * np.sin(2 * np.pi * slow * time + phase[0])
    drive += 10.0 * np.sin(2 * np.pi * fast * time + phase[1])
    return Measurement(time, drive, 1e-7 * drive, between=between)


def finer(run: Simulator, values: Mapping[str, float], times: int) -> FloatArray:
    """The reading with every sub-step cut into that many."""
    own = run.accuracy
    run.accuracy = Accuracy(replace(own.substeps, times=times), 0.0, 0.0)
    reading = run.reading(values)
    run.accuracy = own
    return reading


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("between", [Between.LINEAR, Between.HELD])
@pytest.mark.parametrize("name", MODELS)
def test_the_stated_error_is_the_difference_to_sixteen_times_the_substeps(
    name: str, between: Between, exact: bool
) -> None:
    model, own = MODELS[name]
    for seed, tolerance in enumerate((1e-4, 1e-5, 1e-6)):
        values = Values.nominal(model).with_({"bouc_wen.gamma": 0.01, **own})
        run = Simulator(model, record(seed, between), values, tolerance=tolerance, exact=exact)
        # A loop alone has nothing that is linear.
        assert run.accuracy.substeps.exact == (exact and name != "loop")
        reading = run.reading(values)
        error = float(np.sqrt(np.mean((finer(run, values, 16) - reading) ** 2)))
        stated = run.accuracy.error
        assert 0.2 * stated <= error <= 1.2 * stated
        assert stated <= tolerance * np.ptp(reading) * 1.01
        total = run.accuracy.substeps.of(run.segment(values)).sum()
        assert run.accuracy.per_sample == pytest.approx(total / 300)
        assert run.substeps(values) == total


def test_a_tighter_tolerance_costs_more_and_a_looser_one_less() -> None:
    values = Values.nominal(BASE)
    given = record(0, Between.LINEAR)
    counts = [
        Simulator(BASE, given, values, tolerance=t).substeps(values) for t in (1e-3, 1e-5, 1e-8)
    ]
    assert counts[0] < counts[1] < counts[2]
    # Order four: five digits more cost 10^(5/4) = 18 times the sub-steps.
    assert counts[2] < 40 * counts[0]


def test_substeps_obey_both_limits_and_never_vanish() -> None:
    values = Values.nominal(BASE)
    given = record(0, Between.LINEAR)
    for limits in (Substeps(3.1e-5, 1e9), Substeps(1.0, 0.9), Substeps(7e-5, 0.7)):
        run = Simulator(BASE, given, values, substeps=limits)
        segment = run.segment(values)
        cut = limits.of(segment)
        assert cut.min() >= 1
        assert (segment.length / cut <= limits.longest * (1 + 1e-5)).all()
        moves = np.abs(segment.slope) * segment.length / cut
        assert (moves <= limits.largest_move * (1 + 1e-5)).all()
        # And not one sub-step more than they ask for.
        one_less = np.maximum(cut - 1, 1)
        loose = (segment.length / one_less > limits.longest) | (
            np.abs(segment.slope) * segment.length / one_less > limits.largest_move
        )
        assert (loose | (cut == 1)).all()
        # The first reading is taken at the start: there is nothing to be cut.
        thrice = np.where(segment.length > 0.0, 3, 1) * cut
        np.testing.assert_array_equal(replace(limits, times=3).of(segment), thrice)


def test_the_motion_goes_no_farther_than_asked_within_a_sub_step() -> None:
    values = Values.nominal(BASE)
    given = record(1, Between.HELD)
    limits = Substeps(1.0, 1e9, farthest=5e-8)
    segment = Simulator(BASE, given, values, substeps=limits).segment(values)
    cut = limits.of(segment)
    assert (segment.travel / cut <= limits.farthest * (1 + 1e-5)).all()
    assert (segment.travel / np.maximum(cut - 1, 1) > limits.farthest)[cut > 1].all()
    assert cut.max() > 4 * cut.min() == 4
    # As far as the fastest of each stretch and its neighbours.
    moves = np.abs(np.diff(given.position))
    around = np.stack([np.append(moves[1:], 0.0), moves, np.append(0.0, moves[:-1])]).max(axis=0)
    assert segment.travel.sum() == pytest.approx(around.sum())
    assert (replace(limits, farthest=np.inf).of(segment) == 1).all()


def test_rounding_of_time_stamps_adds_no_substep() -> None:
    time = np.asarray(np.arange(200) * 0.1 + 12345.6, dtype=np.float64)
    drive = np.sin(time)
    values = Values.nominal(BASE)
    run = Simulator(
        BASE, Measurement(time, drive, 1e-7 * drive), values, substeps=Substeps(0.05, 1e9)
    )
    assert set(run.accuracy.substeps.of(run.segment(values))[1:]) == {2}


def test_a_model_too_stiff_for_the_record_is_refused_with_the_remedy() -> None:
    values = Values.nominal(BASE).with_({"second_order.omega": 1e7})
    time = np.linspace(0.0, 99.0, 100)
    drive = np.sin(time)
    with pytest.raises(ModelError, match=r"too stiff.*sub-steps.*drop the mechanics"):
        Simulator(BASE, Measurement(time, drive, 1e-7 * drive), values)


def test_the_rates_that_sub_steps_are_first_guessed_by() -> None:
    """A mass moves by itself, a loop with the drive: h' = -beta |v'| h where h is small."""
    time = np.linspace(0.0, 1.0, 101)
    record = Measurement(time, 30.0 * time, 1e-6 * time)
    model = PiezoGain() + BoucWen() + SecondOrder() + Offset()
    values = {
        **Values.nominal(model), "bouc_wen.beta": 40.0, "bouc_wen.gamma": 0.0,
        "second_order.omega": 25.0, "second_order.zeta": 0.1,
    }  # fmt: skip
    simulator = Simulator(model, record, values)
    parameters = np.array([values[name] for name in simulator.system.parameter_names])
    segment = simulator.segment(values)
    by_itself, by_drive = fastest_rates(simulator.system, segment, parameters, np.zeros(3))
    assert by_itself == pytest.approx(25.0)
    assert by_drive == pytest.approx((40.0 * 30.0 - 25.0) / 30.0)


def test_a_lagged_drive_that_is_left_behind_at_the_start_costs_nothing_later() -> None:
    """60 V behind, a lag of 0.3 ms would rush at 2e5 V/s through a loop that is narrow."""
    time = np.arange(800) / 8e3
    drive = 60.0 * np.sin(2.0 * np.pi * 20.0 * time)
    model = PiezoGain() + BoucWen() + AmplifierLag()
    sharp = {"bouc_wen.beta": 5.0, "amplifier_lag.share": 1.0, "amplifier_lag.tau": 3e-4}
    values = Values.nominal(model).with_(sharp)
    run = Simulator(model, Measurement(time, drive, 1e-7 * drive), values)
    assert run.accuracy.per_sample < 10.0
    reading = run.reading(values)
    error = float(np.sqrt(np.mean((finer(run, values, 16) - reading) ** 2)))
    assert error <= 5e-5 * np.ptp(reading)


def test_with_a_limit_the_best_within_it_is_taken() -> None:
    values = Values.nominal(BASE)
    run = Simulator(BASE, record(0, Between.LINEAR), values)
    limit = 3 * run.substeps(values)
    limited = run.choose(values, 1e-14, most=limit)
    assert limited.per_sample * 300 <= limit
    assert limited.error < run.accuracy.error


def test_halving_stops_where_it_helps_no_more() -> None:
    """A simulation whose error is rounding from the start."""
    values = Values.nominal(BASE)
    run = Simulator(BASE, record(0, Between.LINEAR), values)
    segment = run.segment(values)
    rng = np.random.default_rng(0)
    calls: list[Substeps] = []

    def noisy(substeps: Substeps, _: NDArray[np.int32]) -> FloatArray:
        calls.append(substeps)
        return np.sin(np.arange(300)) + 1e-3 * rng.standard_normal(300)

    parameters = np.array([values[n] for n in run.system.parameter_names])
    found = choose(run.system, segment, parameters, np.zeros(3), noisy, 1e-9)
    assert len(calls) < 20
    assert 1e-3 < found.error < 4e-3


def test_nothing_is_simulated_twice_while_sub_steps_are_chosen() -> None:
    """On a ramp a sub-step of half the length is every sub-step cut in two."""
    time = 1e-3 * np.arange(300)
    model = PiezoGain() + BoucWen()
    values = Values.nominal(model)
    run = Simulator(model, Measurement(time, 100.0 * time, 1e-5 * time), values)
    segment = run.segment(values)
    asked: list[bytes] = []

    def slowly(substeps: Substeps, cut: NDArray[np.int32]) -> FloatArray:
        asked.append(cut.tobytes())
        assert cut.tolist() == substeps.of(segment).tolist()
        return np.asarray(np.sin(np.arange(300)) * (1.0 + 1.0 / cut.mean() ** 2))

    parameters = np.array([values[n] for n in run.system.parameter_names])
    found = choose(run.system, segment, parameters, np.zeros(1), slowly, 1e-3)
    n = found.per_sample
    assert len(asked) == len(set(asked)) == round(np.log2(n)) + 2 > 4
    # 1 / n^2 against 1 / (2 n)^2, and a third of that more to the end.
    assert found.error == pytest.approx(np.sqrt(0.5) / n**2, rel=0.02)


def test_a_reading_that_ran_away_is_infinitely_far_without_a_warning() -> None:
    values = Values.nominal(BASE)
    run = Simulator(BASE, record(0, Between.LINEAR), values)
    reading = run.reading(values)
    assert run.halving(values, reading) < 1e-3 * np.ptp(reading)
    assert run.halving(values, np.full(reading.size, 1e200)) == np.inf
