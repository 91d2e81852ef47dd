"""The inverted model: against a known drive, against its conditions, on an independent plant."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import piezo_opt as po
from piezo_opt.control import Limits, ModelPlant, optimal_feedforward
from piezo_opt.control.motion import RISE
from piezo_opt.effects import BoucWen, Creep, Delay, PiezoGain, SecondMode, SecondOrder
from piezo_opt.errors import InputError

STAGE = PiezoGain() + BoucWen() + Creep(elements=1) + SecondOrder() + SecondMode()
VALUES = {
    "piezo_gain.d": 1.5e-7, "bouc_wen.alpha": 5e-8, "bouc_wen.beta": 0.03,
    "bouc_wen.gamma": -0.005, "creep.c": 0.05, "creep.tau": 0.1,
    "second_order.omega": 2.0 * np.pi * 200.0, "second_order.zeta": 0.03,
    "second_mode.g": 0.1, "second_mode.omega": 2.0 * np.pi * 330.0, "second_mode.zeta": 0.02,
}  # fmt: skip
PERIOD = 1e-3
TIGHT = Limits(-5.0, 42.0, 8.5e3)
SAW = 6e-6 * (1.0 - np.abs(2.0 * ((10.0 * PERIOD * np.arange(201)) % 1.0) - 1.0))


def independent(drive: np.ndarray, v: dict[str, float]) -> np.ndarray:
    """The plant by scipy from its equations, with another scheme and none of our code."""
    x, before, read = np.zeros(6), 0.0, [0.0]

    def rate(_: float, z: np.ndarray, u: float, du: float) -> list[float]:
        h, creeping, place, speed, second, second_speed = z
        bare = v["piezo_gain.d"] * u - h
        free = bare + v["creep.c"] * creeping
        dh = (
            v["bouc_wen.alpha"] * du - v["bouc_wen.beta"] * abs(du) * h
            - v["bouc_wen.gamma"] * du * abs(h)
        )  # fmt: skip
        w, m = v["second_order.omega"], v["second_mode.omega"]
        return [
            dh, (free - creeping) / v["creep.tau"], speed,
            w * w * (free - place) - 2.0 * v["second_order.zeta"] * w * speed, second_speed,
            m * m * (free - second) - 2.0 * v["second_mode.zeta"] * m * second_speed,
        ]  # fmt: skip

    for u in drive.tolist():
        slope = (u - before) / (RISE * PERIOD)
        for start, length, du in ((before, RISE * PERIOD, slope), (u, (1 - RISE) * PERIOD, 0.0)):
            step = solve_ivp(
                lambda t, z, s=start, d=du: rate(t, z, s + d * t, d), (0.0, length), x,
                method="DOP853", rtol=1e-9, atol=1e-16,
            )  # fmt: skip
            x = step.y[:, -1]
        before = u
        read.append(x[2] + v["second_mode.g"] * x[4])
    return np.array(read[:-1])


def test_what_is_predicted_is_achieved_on_an_independent_plant() -> None:
    found = optimal_feedforward(STAGE, SAW, period=PERIOD, values=VALUES, limits=TIGHT)
    achieved = independent(found.drive, VALUES)
    assert achieved == pytest.approx(found.predicted, abs=1e-11)
    assert float(np.sqrt(np.mean((SAW - achieved) ** 2))) < 8e-9
    assert found.drive.max() <= 42.0
    assert found.drive.max() > 41.9
    assert np.abs(np.diff(found.drive)).max() <= 8.5 * (1.0 + 1e-6)
    # Without creep and the second mode in the model it is many times worse on the same plant.
    poor = STAGE.without("creep").without("second_mode")
    less = optimal_feedforward(
        poor, SAW, period=PERIOD, limits=TIGHT,
        values={k: x for k, x in VALUES.items() if k in poor.parameters},
    )  # fmt: skip
    lost = SAW - independent(less.drive, VALUES)
    assert float(np.sqrt(np.mean(lost**2))) > 20.0 * found.rms


def test_a_reference_that_a_drive_has_made_gives_that_drive() -> None:
    known = 20.0 * (1.0 - np.cos(2.0 * np.pi * 15.0 * PERIOD * np.arange(120)))
    plant = ModelPlant(STAGE, VALUES)
    plant.begin(0.0)
    made = np.array([0.0, *(plant.advance(float(u), PERIOD) for u in known)])[:-1]
    found = optimal_feedforward(
        STAGE, made, period=PERIOD, values=VALUES, limits=Limits(-20.0, 100.0), effort=1e-12
    )
    assert found.rms < 1e-12
    assert found.drive[:-1] == pytest.approx(known[:-1], abs=1e-3)


def test_no_feasible_move_is_better() -> None:
    """First-order conditions: of many small changes within the limits none lowers the cost."""
    effort, volts, span = 1e-3, 6e-6 / (1.05 * 1.1 * 1.5e-7), 6e-6
    limits = Limits(-5.0, 60.0)
    found = optimal_feedforward(
        STAGE, SAW[:121], period=PERIOD, values=VALUES, limits=limits, effort=effort
    )
    assert found.converged

    def cost(drive: np.ndarray) -> float:
        plant = ModelPlant(STAGE, VALUES)
        plant.begin(0.0)
        read = np.array([plant.advance(float(u), PERIOD) for u in drive[:-1]])
        moves = np.diff(drive[:-1], prepend=0.0)
        off = (read - SAW[1:121]) / span
        return float(off @ off + effort * (moves / volts) @ (moves / volts))

    least, generator = cost(found.drive), np.random.default_rng(0)
    for size in (0.3, 0.03):
        for _ in range(25):
            other = found.drive + size * generator.normal(size=121)
            assert cost(np.clip(other, limits.low, limits.high)) > least * (1.0 - 1e-5)


def test_a_delay_is_played_ahead() -> None:
    late = optimal_feedforward(
        Delay() + STAGE, SAW, period=PERIOD, values={**VALUES, "delay.T": 3e-3}, limits=TIGHT
    )
    prompt = optimal_feedforward(STAGE, SAW[3:], period=PERIOD, values=VALUES, limits=TIGHT)
    assert late.drive[:-4] == pytest.approx(prompt.drive[:-1], abs=1e-9)
    assert (late.predicted[:4] == 0.0).all()


def test_what_cannot_be_is_said() -> None:
    with pytest.raises(InputError, match="widen the limits"):
        po.optimal_feedforward(STAGE, 3.0 * SAW, period=PERIOD, values=VALUES, limits=TIGHT)
    with pytest.raises(InputError, match="positive weight"):
        po.optimal_feedforward(STAGE, SAW, period=PERIOD, values=VALUES, effort=0.0)
    with pytest.raises(InputError, match="has no parameter 'second_mode"):
        po.optimal_feedforward(STAGE, SAW, period=PERIOD, values={"second_mode.share": 0.1})
