"""State feedback with an observer: its gains, its slopes, and what it does in the loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import control
import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.control import PID, Limits, ModelPlant, close_loop, linearise, tune_lqr, tune_pid
from piezo_opt.control.calm import calm
from piezo_opt.control.loop_program import LoopProgram
from piezo_opt.control.lqg_family import LQGFamily
from piezo_opt.control.margins import response, sampled
from piezo_opt.control.minimal import KEPT, minimal
from piezo_opt.control.task import task
from piezo_opt.effects import BoucWen, Creep, PiezoGain, SecondMode, SecondOrder
from piezo_opt.errors import InputError

STAGE = PiezoGain() + BoucWen() + Creep(elements=1) + SecondOrder()
VALUES = {
    "piezo_gain.d": 1.5e-7, "bouc_wen.alpha": 5e-8, "bouc_wen.beta": 0.03,
    "bouc_wen.gamma": -0.005, "creep.c": 0.05, "creep.tau": 1.0,
    "second_order.omega": 2.0 * np.pi * 200.0, "second_order.zeta": 0.03,
}  # fmt: skip
PERIOD = 1e-3
LIMITS = Limits(-5.0, 42.0, 8.5e3)
SAW = 6e-6 * (1.0 - np.abs(2.0 * ((10.0 * PERIOD * np.arange(300)) % 1.0) - 1.0))


def program(delay: int = 0) -> LoopProgram:
    what = task(STAGE, SAW, period=PERIOD, values=VALUES, limits=LIMITS, delay=delay)
    return LoopProgram(what.plant.model, what.plant.numbers, (), what.asked, LQGFamily)


@pytest.mark.parametrize("delay", [0, 2])
def test_slopes_through_riccati_and_the_loop_are_exact(delay: int) -> None:
    made = program(delay)
    theta = made.stable(np.array([0.5, -0.5, 0.2, -1.5]))
    at = made.evaluate(theta)
    assert at is not None
    for k in range(4):
        step = 1e-5 * np.eye(4)[k]
        up, down = made.bare(theta + step), made.bare(theta - step)
        assert up is not None
        assert down is not None
        assert at.slope[k] == pytest.approx((up.cost - down.cost) / 2e-5, rel=1e-6, abs=1e-8)
        by = (up.constraints - down.constraints) / 2e-5
        assert at.slopes[:, k] == pytest.approx(by, abs=1e-7)


def test_gains_are_those_of_riccati_and_of_kalman() -> None:
    family, theta = program().family, np.array([0.5, -0.5, 0.2, -1.5])
    found = family.controller(theta)
    a, b, c = found.a, found.b[:, np.newaxis], found.c[np.newaxis]
    gain = float(np.asarray(linearise(STAGE, VALUES).dcgain()).ravel()[0])
    change = c @ (a - np.eye(3))
    q = (c.T @ c + np.exp(-0.5) * change.T @ change) / gain**2
    k, _, _ = control.dlqr(a, b, q, np.array([[np.exp(0.5)]]))
    assert found.gain == pytest.approx(np.asarray(k).ravel(), rel=1e-7)
    wide = np.block([[a, b], [np.zeros((1, 3)), np.ones((1, 1))]])
    noise = np.exp(0.4) * np.outer(np.append(b, 0.0), np.append(b, 0.0)) / gain**2
    noise[3, 3] = np.exp(-3.0) / gain**2
    l_, _, _ = control.dlqe(wide, np.eye(4), np.append(c, [[0.0]], axis=1), noise, np.eye(1))
    # python-control gives the gain with the step of prediction after it.
    assert wide @ found.filter == pytest.approx(np.asarray(l_).ravel(), rel=1e-6)
    # The states are scaled, the plant is the same.
    z = np.exp(1j * np.array([0.1, 1.0, 2.5]))
    plant = control.ss(*sampled(linearise(STAGE, VALUES), PERIOD), 0.0, PERIOD)
    own = control.ss(a, b, c, 0.0, PERIOD)
    assert own(z) == pytest.approx(plant(z), rel=1e-9)


def test_its_transfer_function_is_what_it_does() -> None:
    found = program().family.controller(np.array([0.5, -0.5, 0.2, -1.5]))
    error = 1e-7 * np.random.default_rng(2).normal(size=60)
    _, drives = control.forced_response(found.state_space(), inputs=error)
    state, own = found.begin(), []
    for e in error:
        drive, state = found.act(state, 0.0, -float(e), PERIOD, -1e9, 1e9)
        own.append(drive)
    assert np.array(own) == pytest.approx(drives, rel=1e-9, abs=1e-12)
    with pytest.raises(InputError, match="controller is sampled every"):
        found.act(state, 0.0, 0.0, 0.5e-3, -1.0, 1.0)


def test_no_offset_stays_and_a_lost_sample_does_no_harm() -> None:
    tuned = tune_lqr(STAGE, SAW, period=PERIOD, values=VALUES, limits=LIMITS, noise=5e-9)
    other = ModelPlant(STAGE, {**VALUES, "piezo_gain.d": 1.65e-7, "creep.c": 0.08})
    steady = np.full(6000, 3e-6)  # creep is over
    loop = close_loop(
        other, tuned.controller, steady, period=PERIOD, limits=LIMITS, disturbance=2e-7
    )
    assert np.abs(loop.error[-100:]).max() < 2e-9
    state = tuned.controller.begin()
    drive, state = tuned.controller.act(state, 1e-6, 0.0, PERIOD, -5.0, 42.0)
    again, state = tuned.controller.act(state, 1e-6, float("nan"), PERIOD, -5.0, 42.0)
    held, state = tuned.controller.act(state, float("nan"), 1e-6, PERIOD, -5.0, 42.0)
    assert np.isfinite([drive, again, held]).all()
    assert held == again


def test_it_follows_five_times_closer_than_a_pid_within_the_same_limits() -> None:
    asked = {"period": PERIOD, "values": VALUES, "limits": LIMITS, "noise": 5e-9}
    pid = po.tune_pid(STAGE, SAW, **asked)  # type: ignore[arg-type]
    lqr = po.tune_lqr(STAGE, SAW, **asked)  # type: ignore[arg-type]
    assert lqr.loops[0].rms < pid.loops[0].rms / 4.0
    assert lqr.margins.peak <= 2.0 * (1.0 + 1e-3)
    assert "LQR on the estimate" in str(lqr)
    assert lqr.to_dict()["schema"] == "piezo_opt/tune_lqr/1"
    assert len(lqr.to_dict()["controller"]["gain"]) == 3


def test_what_cannot_be_is_said_at_design_time() -> None:
    asked = {"period": PERIOD, "values": VALUES}
    with pytest.raises(InputError, match="widen the limits"):
        tune_lqr(STAGE, 2.0 * SAW, limits=LIMITS, **asked)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="as long as the reference"):
        tune_pid(STAGE, SAW, delay=300, **asked)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="How often the loop is sampled"):
        tune_lqr(STAGE, SAW, values=VALUES)


def test_what_is_left_out_changes_the_response_by_less_than_is_said() -> None:
    """Balanced truncation against frequency responses; nothing goes where nothing may."""
    model = PiezoGain() + Creep(elements=7) + SecondOrder() + SecondMode()
    values = {k: v for k, v in VALUES.items() if k[:4] != "bouc"} | {
        "creep.tau": 0.05, "creep.spread": 0.4, "second_mode.g": 0.02, "second_mode.omega": 2400.0,
        "second_mode.zeta": 0.02,
    }  # fmt: skip
    whole = sampled(linearise(model, values), 5e-4)
    found = minimal(whole)
    kept = found.plant[0].shape[0]
    assert 4 < kept < whole[0].shape[0]
    z = np.exp(1j * np.geomspace(1e-5, np.pi, 3000))
    gain = float(np.asarray(linearise(model, values).dcgain()).ravel()[0])
    off = np.abs(response(found.plant, z) - response(whole, z)).max() / gain
    assert 0.01 * found.off < off <= found.off <= KEPT
    assert f"{kept} of {whole[0].shape[0]} states" in found.remarks[0]
    # A plant of two states that the drive moves and the reading shows is whole.
    small = sampled(linearise(PiezoGain() + SecondOrder(), values), 5e-4)
    assert minimal(small).plant[0].shape == (2, 2)
    assert minimal(small).remarks == ()


def test_a_loop_that_a_fault_leaves_swinging_is_made_softer() -> None:
    model = PiezoGain() + Creep(elements=2) + SecondOrder()
    values = {k: v for k, v in VALUES.items() if k[:4] != "bouc"}
    asked = {"period": PERIOD, "values": values, "limits": LIMITS, "noise": 5e-9}
    tuned = tune_lqr(model, SAW, **asked)  # type: ignore[arg-type]
    what = task(model, SAW, peak=1.6, **asked)  # type: ignore[arg-type]
    assert tuned.calm
    assert calm(tuned.controller, what)
    assert tuned.swinging is not None
    assert tuned.swinging < tuned.cost < 2.0 * tuned.swinging
    assert "Made softer than the closest" in str(tuned)
    # The closest one does swing, after a step alone.
    family = LoopProgram(what.plant.model, what.plant.numbers, (), what.asked, LQGFamily).family
    closest = family.controller(np.array([-9.0, -9.0, -7.95, -1.05]))
    assert not calm(closest, what)


@pytest.mark.parametrize("design", [po.tune_pid, po.tune_lqr, po.tune_mpc, po.tune_shaper])
def test_hidden_states_and_a_model_that_runs_away_are_said_at_design_time(
    design: Callable[..., Any],
) -> None:
    model = PiezoGain() + Creep(elements=2) + SecondOrder()
    values = {k: v for k, v in VALUES.items() if k[:4] != "bouc"}
    loop = {"period": PERIOD, "limits": LIMITS, "noise": 5e-9}
    if design is po.tune_mpc:
        loop["horizon"] = 5
    asked: tuple[Any, ...] = (SAW[:150],)
    if design is po.tune_shaper:
        loop, asked = {"scenarios": 1}, ()
    # Two elements of one time constant: the reading shows their sum.
    said = "The reading does not show creep.z[0] and creep.z[1] one by one"
    twice = design(model, *asked, values={**values, "creep.spread": 0.0}, **loop)
    assert said in str(twice).splitlines()[-1]
    assert said in twice.to_dict()["remarks"][0]
    assert said not in str(design(model, *asked, values=values, **loop))
    with pytest.raises(InputError, match="runs away by itself at a constant drive, e-fold in"):
        design(model, *asked, values={**values, "second_order.zeta": -0.02}, **loop)


def test_a_start_that_is_unstable_is_said() -> None:
    asked = {"period": PERIOD, "values": VALUES, "limits": LIMITS}
    wild = tune_pid(STAGE, SAW, start=PID(1e9, 1e12, 1e6, 1e-4), **asked)  # type: ignore[arg-type]
    assert "start's gains make the loop unstable" in str(wild)
    assert wild.margins.stable
    tame = tune_pid(STAGE, SAW, start=PID(1e3, 1e8, 0.0, 1e-3), **asked)  # type: ignore[arg-type]
    assert "unstable" not in str(tame)
