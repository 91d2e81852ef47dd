"""State feedback with an observer: its gains, its slopes, and what it does in the loop."""

from __future__ import annotations

import control
import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.control import Limits, ModelPlant, close_loop, linearise, tune_lqr, tune_pid
from piezo_opt.control.loop_program import LoopProgram
from piezo_opt.control.lqg_family import LQGFamily
from piezo_opt.control.margins import sampled
from piezo_opt.control.tune_loop import task
from piezo_opt.effects import BoucWen, Creep, PiezoGain, SecondOrder
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
    with pytest.raises(InputError, match="does not show every state"):
        # Two resonances that are one: the reading cannot tell whose swing it is.
        tune_lqr(
            PiezoGain() + Creep(elements=2) + SecondOrder(), SAW, period=PERIOD,
            values={**{k: v for k, v in VALUES.items() if k[:4] != "bouc"}, "creep.spread": 1.0},
        )  # fmt: skip
    with pytest.raises(InputError, match="How often the loop is sampled"):
        tune_lqr(STAGE, SAW, values=VALUES)
