"""Starting values: found where nobody knows them, left alone where somebody does."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import (
    ChargeBackCoupling,
    Creep,
    CubicStiffness,
    DeadZone,
    Effect,
    SecondMode,
)
from piezo_opt.identification import Ending, starting
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.starting import (
    _Search,
    resonance_start,
    starting_values,
)
from piezo_opt.measurement import FloatArray
from piezo_opt.values import Values
from tests.identification.truth import LINE, MOVING, STILL, TRUTH, loops, objective_of, record

RATE = 2000.0


def steps(samples: int = 800) -> tuple[FloatArray, FloatArray]:
    """Time and drive: a triangle and steps up and down, 0..60 V."""
    time = np.arange(samples) / RATE
    at = np.array([0, 0.15, 0.3, 0.301, 0.5, 0.501, 0.7, 0.701, 0.85, 0.851, 1.0]) * time[-1]
    return time, np.interp(time, at, [0, 60, 0, 30, 30, 60, 60, 15, 15, 40, 40])


def ringing(
    hertz: float, zeta: float = 0.03, seed: int = 0
) -> tuple[po.Measurement, dict[str, float]]:
    truth = {**TRUTH, "second_order.omega": 2 * np.pi * hertz, "second_order.zeta": zeta}
    return record(MOVING, truth, *steps(), noise=5e-9, seed=seed), truth


@pytest.mark.parametrize("hertz", [25.0, 60.0, 140.0, 310.0, 640.0])
def test_the_resonance_is_found_among_many_local_minima(hertz: float) -> None:
    measured, truth = ringing(hertz)
    fit = po.solve(po.Identification(MOVING, measured, start=po.Start.REST))
    assert fit.rms < 1.1 * 5e-9
    assert fit.values["second_order.omega"] == pytest.approx(truth["second_order.omega"], rel=2e-3)
    assert fit.values["second_order.zeta"] == pytest.approx(0.03, rel=0.1)


@pytest.mark.parametrize("hertz", [25.0, 60.0, 140.0, 310.0])
def test_spectra_tell_which_resonances_are_worth_a_simulation(hertz: float) -> None:
    """Of thirty candidates, where the model is right but for the mechanics."""
    measured, truth = ringing(hertz)
    still = {k: v for k, v in truth.items() if not k.startswith("second_order")}
    quasi_static = po.simulate(STILL, measured, still).reading
    residual = measured.position - quasi_static
    omega = truth["second_order.omega"]
    others = np.geomspace(2.0 * np.pi * 5.0, 0.9 * np.pi * RATE, 29).tolist()
    kept = starting._likeliest(measured, residual, [], [*others, omega])
    assert kept[0] == pytest.approx(omega, rel=0.01)
    assert omega in kept[:2]
    assert len(kept) == 5
    # A start-up that is not counted has no residual.
    later = measured.with_(startup=0.1)
    counted = starting._likeliest(later, residual[later.counted], [], [*others, omega])
    assert counted[0] == pytest.approx(omega, rel=0.01)
    # Spectra are of even time: else all are simulated.
    uneven = measured.with_(time=measured.time * (1.0 + 0.3 * measured.time))
    assert starting._likeliest(uneven, residual, [3.0], others) == [3.0, *others]


@pytest.mark.parametrize("hertz", [60.0, 640.0])
def test_an_actuator_stiffer_than_its_record_can_show_is_not_searched(hertz: float) -> None:
    """Where even the stiffest mechanics that can be sampled round off what the record shows."""
    grid = np.geomspace(0.1 * np.pi * RATE, 0.9 * np.pi * RATE, 14).tolist()
    truth = {k: v for k, v in TRUTH.items() if not k.startswith("second_order")}
    stiff = record(STILL, truth, *steps(), noise=5e-9)
    left = stiff.position - po.simulate(STILL, stiff, truth).reading
    assert starting._likeliest(stiff, left, [], grid) == []
    start = {**Values.nominal(STILL), **truth}
    question = po.Identification(MOVING, stiff, start=po.Start.REST)
    assert resonance_start(question, start, left, "second_order", {}) is None
    # Far less damped than the trial is.
    moving, swung = ringing(hertz, zeta=0.005)
    still = moving.position - po.simulate(STILL, moving, truth).reading
    question = po.Identification(MOVING, moving, start=po.Start.REST)
    found = resonance_start(question, start, still, "second_order", {})
    assert found is not None
    assert found["second_order.omega"] == pytest.approx(swung["second_order.omega"], rel=0.1)


def shaken(hertz: float) -> tuple[po.Measurement, dict[str, float]]:
    """A weakly damped resonance under a multisine: an alley of local minima to either side."""
    time = np.arange(800) / RATE
    lines = np.arange(10.0, 320.0, 10.0)
    phases = np.random.default_rng(5).uniform(0.0, 2 * np.pi, lines.size)
    waves = np.sin(2 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
    truth = {**TRUTH, "second_order.omega": 2 * np.pi * hertz, "second_order.zeta": 0.005}
    drive = (30.0 + 3.0 * waves) * np.minimum(1.0, time / 0.02)
    return record(MOVING, truth, time, drive, noise=5e-9), truth


@pytest.mark.parametrize("hertz", [35.0, 80.0, 150.0, 270.0])
def test_the_resonance_is_found_under_a_multisine(hertz: float) -> None:
    measured, truth = shaken(hertz)
    fit = po.solve(po.Identification(MOVING, measured, start=po.Start.REST))
    assert fit.rms < 1.1 * 5e-9
    assert fit.values["second_order.omega"] == pytest.approx(truth["second_order.omega"], rel=1e-4)


@pytest.mark.parametrize("off", [0.2, 0.4])
def test_there_are_local_minima_to_be_lost_in(off: float) -> None:
    # Otherwise the tests above would ask nothing: a wrong start ends in a wrong minimum.
    measured, truth = shaken(150.0)
    wrong = {**truth, "second_order.omega": off * truth["second_order.omega"]}
    fit = po.solve(po.Identification(MOVING, measured, start=po.Start.REST, values=wrong))
    assert fit.rms > 1000 * 5e-9
    assert abs(fit.values["second_order.omega"] / truth["second_order.omega"] - 1.0) > 0.3


def test_a_start_given_by_the_user_is_where_the_solver_begins() -> None:
    measured, truth = ringing(60.0)
    own = {**truth, "second_order.omega": 500.0, "bouc_wen.beta": 0.11, "piezo_gain.d": 2e-7}
    fit = po.solve(po.Identification(MOVING, measured, values=own))
    begun = dict(zip(fit.trace.names, fit.trace.values[0], strict=True))
    assert {n: begun[n] for n in own} == own


@pytest.mark.parametrize("name", ["piezo_gain.d", "bouc_wen.alpha", "offset.y0"])
def test_a_given_stroke_is_not_moved_by_the_search_for_the_others(name: str) -> None:
    measured, _ = ringing(60.0)
    own = {name: 1.5 * TRUTH[name]}
    fit = po.solve(po.Identification(MOVING, measured, values=own))
    assert fit.trace.values[0][fit.names.index(name)] == own[name]
    assert fit.rms < 1.1 * 5e-9


def test_a_gate_that_may_not_move_the_right_way_still_leaves_its_null() -> None:
    time, drive = steps(300)
    truth = {**TRUTH, "creep.c": -0.06, "creep.tau": 0.03}
    model = STILL + Creep(elements=1)
    measured = record(model, truth, time, drive, noise=2e-9)
    question = po.Identification(
        model, measured, bounds={"creep.c": (0.0, 0.9)}, fixed={"creep.tau": 0.03}
    )
    assert 0.0 < starting_values(question, Monitor(()))["creep.c"] < 0.05


def test_a_given_start_of_some_is_kept_while_the_others_are_found() -> None:
    measured, truth = ringing(60.0)
    question = po.Identification(
        MOVING, measured, values={"second_order.zeta": 0.2, "bouc_wen.beta": 0.02}
    )
    found = starting_values(question, Monitor(()))
    assert found["bouc_wen.beta"] == 0.02
    assert found["second_order.zeta"] == 0.2
    assert found["second_order.omega"] == pytest.approx(truth["second_order.omega"], rel=0.1)
    assert found["piezo_gain.d"] == pytest.approx(truth["piezo_gain.d"], rel=0.5)


def test_the_loop_is_found_whatever_its_width() -> None:
    time, drive = loops(300)
    for beta in (0.01, 0.05, 0.3):
        truth = {**TRUTH, "bouc_wen.beta": beta, "bouc_wen.gamma": -0.2 * beta}
        fit = po.solve(po.Identification(STILL, record(STILL, truth, time, drive, noise=2e-9)))
        assert fit.rms < 1.1 * 2e-9
        assert fit.values["bouc_wen.beta"] == pytest.approx(beta, rel=0.05)


def test_a_loop_that_leads_is_found_and_remarked() -> None:
    """Wen's own form: y = d v + z, whose z runs ahead of the drive at each turn."""
    time, drive = loops(300)
    leads = "The loop leads its drive"
    for alpha in (-4e-8, 4e-8):
        truth = {**TRUTH, "bouc_wen.alpha": alpha}
        fit = po.solve(po.Identification(STILL, record(STILL, truth, time, drive, noise=2e-9)))
        assert fit.rms < 1.1 * 2e-9
        assert fit.values["bouc_wen.alpha"] == pytest.approx(alpha, rel=0.1)
        assert any(leads in remark for remark in fit.remarks) is (alpha < 0.0)
    # Whoever says how strong it is, or may be, says which way it turns.
    told = {"values": {"bouc_wen.alpha": 4e-8}}, {"bounds": {"bouc_wen.alpha": (0.0, 1e-6)}}
    truth = {**TRUTH, "bouc_wen.alpha": -4e-8}
    led = record(STILL, truth, time, drive, noise=2e-9)
    for known in told:
        fit = po.solve(po.Identification(STILL, led, **known))
        assert fit.values["bouc_wen.alpha"] >= 0.0
        assert fit.rms > 10.0 * 2e-9


def test_an_interrupt_ends_all_further_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also the trial of a loop that leads, which would be kept."""

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["piezo_opt.identification.solve"], "another_start", stop)
    time, drive = loops(300)
    led = record(STILL, {**TRUTH, "bouc_wen.alpha": -4e-8}, time, drive, noise=2e-9)
    fit = po.solve(po.Identification(STILL, led))
    assert fit.outcome.ending is Ending.INTERRUPTED
    assert fit.values["bouc_wen.alpha"] >= 0.0


@pytest.mark.parametrize(("sweeps", "searched"), [(12, 20_000), (1, 60_000)])
def test_a_long_record_is_searched_by_a_stretch_that_shows_the_loop(
    monkeypatch: pytest.MonkeyPatch, sweeps: int, searched: int
) -> None:
    """Of one slow triangle no stretch does; the fit is that of the whole record all the same."""
    seen: list[int] = []
    scan = starting._scan_widths

    def spying(search: Any, *others: Any) -> dict[str, float]:
        seen.append(search.samples)
        return scan(search, *others)

    monkeypatch.setattr(starting, "_scan_widths", spying)
    time = np.arange(60_000) / 1000.0
    turns = np.linspace(0.0, time[-1], 2 * sweeps + 1)
    drive = np.interp(time, turns, np.resize([0.0, 60.0], turns.size))
    fit = po.solve(po.Identification(STILL, record(STILL, TRUTH, time, drive, noise=2e-9)))
    assert seen == [searched]
    assert fit.rms == pytest.approx(2e-9, rel=0.02)
    assert fit.values["bouc_wen.beta"] == pytest.approx(TRUTH["bouc_wen.beta"], rel=0.02)


def test_a_line_needs_no_search() -> None:
    time, drive = loops(50)
    measured = po.Measurement(time, drive, 1.5e-7 * drive - 4e-7)
    assert measured.line == pytest.approx((1.5e-7, -4e-7))
    monitor = Monitor(())
    found = starting_values(po.Identification(LINE, measured), monitor)
    assert found["piezo_gain.d"] == pytest.approx(1.5e-7)
    assert found["offset.y0"] == pytest.approx(-4e-7)
    assert monitor.evaluations.total == 0


def test_an_optional_effect_starts_away_from_its_null() -> None:
    # At its null a gate hides its shapes: nothing could be fitted from there.
    time, drive = steps()
    truth = {**TRUTH, "creep.c": 0.06, "creep.tau": 0.03}
    model = STILL + Creep(elements=1)
    question = po.Identification(model, record(model, truth, time, drive, noise=2e-9))
    start = starting_values(question, Monitor(()))
    assert start["creep.c"] == pytest.approx(0.06, abs=0.03)
    fit = po.solve(question)
    assert fit.rms < 1.1 * 2e-9
    for name in ("creep.c", "creep.tau"):
        low, high = fit.interval(name, 0.999)
        assert low < truth[name] < high


def test_what_is_known_of_the_base_is_not_searched_again() -> None:
    measured, _ = ringing(60.0)
    question = po.Identification(MOVING + Creep(), measured, start=po.Start.REST)
    alone, beside = Monitor(()), Monitor(())
    base = starting_values(question.with_model(MOVING), Monitor(()))
    whole = starting_values(question, alone)
    assert starting_values(question, beside, base) == whole
    assert beside.evaluations.with_sensitivities < 0.6 * alone.evaluations.with_sensitivities


def test_an_effect_without_shapes_is_tried_once() -> None:
    measured, _ = ringing(60.0)
    question = po.Identification(MOVING + CubicStiffness(), measured, start=po.Start.REST)
    base = starting_values(question.with_model(MOVING), Monitor(()))
    monitor = Monitor(())
    starting_values(question, monitor, base)
    assert monitor.evaluations.with_sensitivities == 1


def test_a_second_mode_is_found_by_what_the_first_leaves_over() -> None:
    time, drive = steps()
    model = LINE + SecondMode()
    truth = {
        "piezo_gain.d": 1.2e-7, "offset.y0": 0.0, "second_mode.g": 0.05,
        "second_mode.omega": 2 * np.pi * 170.0, "second_mode.zeta": 0.02,
    }  # fmt: skip
    truth = {n: v for n, v in truth.items() if n in model.parameters}
    assert len(truth) >= 4
    fit = po.solve(po.Identification(model, record(model, truth, time, drive, noise=2e-9)))
    assert fit.rms < 1.1 * 2e-9


def in_motion() -> tuple[po.Measurement, po.Measurement]:
    """A record cut in the middle of motion, without and with noise; and the states there."""
    time, drive = loops(500)
    whole = record(STILL, TRUTH, time, drive, noise=3e-9)
    return whole, whole.slice(1.2, None)


def test_the_remanent_start_is_estimated_and_lowers_the_misfit() -> None:
    whole, cut = in_motion()
    virgin = po.solve(po.Identification(STILL, cut, start=po.Start.REST))
    free = po.solve(po.Identification(STILL, cut))
    assert free.rms < 1.1 * 3e-9
    assert virgin.rms > 3.0 * free.rms
    states = po.simulate(STILL, whole, TRUTH, tolerance=1e-8)
    h = states.states[np.searchsorted(whole.time, cut.time[0]), 0]
    assert states.state_names[0] == "bouc_wen.h"
    assert abs(h) > 1e-7
    low, high = free.interval("initial.bouc_wen.h", 0.999)
    assert low < h < high
    assert high - low < 0.1 * abs(h)


@pytest.mark.parametrize(
    ("effect", "own"),
    [
        (ChargeBackCoupling(poles=2), {"kappa": 600.0, "tau": 4e-3}),
        (SecondMode(), {"g": 0.1, "omega": 2.0 * np.pi * 31.0, "zeta": 0.01}),
        (DeadZone(backlash=True), {"w": 4e-7}),
    ],
)
def test_a_record_cut_in_motion_leaves_no_effect_at_rest(
    effect: Effect, own: dict[str, float]
) -> None:
    model = MOVING + effect
    shaking, truth = shaken(80.0)
    truth |= {f"{effect.name}.{k}": v for k, v in own.items()}
    cut = record(model, truth, shaking.time, shaking.drive, noise=3e-9).slice(0.1, None)
    at = {n: v for n, v in truth.items() if n in model.parameters}

    def rms(**more: Any) -> float:
        return po.solve(po.Identification(model, cut, values=at, **more)).rms

    assert rms() < 1.05 * 3e-9
    rest = dict.fromkeys(
        (f"initial.{effect.name}.{s}[{i}]" if n > 1 else f"initial.{effect.name}.{s}"
         for s, n in effect.states.items() for i in range(n)),
        0.0,
    )  # fmt: skip
    assert rms(fixed=rest) > 1.2 * 3e-9


def test_a_trial_that_would_lead_nowhere_is_not_simulated_again() -> None:
    """Its step says to first order where it leads; one that would lead lower is looked at."""
    measured, truth = ringing(140.0)
    monitor = Monitor(())
    search = _Search(po.Identification(MOVING, measured), monitor)
    begin = {**po.Values.nominal(MOVING), **truth}
    cost, found = search.trial(begin)
    looked = monitor.simulations
    for worst, simulated in ((2.0 * cost, 1), (0.5 * cost, 0)):
        before = monitor.simulations
        again, values = search.trial(begin, worst=worst)
        assert monitor.simulations - before == simulated
        assert again >= cost
        assert values == (found if simulated else begin)
    assert looked > 0


def test_the_search_hands_over_a_start_near_the_answer() -> None:
    measured, _ = ringing(140.0)
    question = po.Identification(MOVING, measured)
    start = starting_values(question, Monitor(()))
    objective, theta = objective_of(question, start)
    spread = float(np.std(measured.position))
    assert objective.rms(objective.residual(theta)) < 0.15 * spread
