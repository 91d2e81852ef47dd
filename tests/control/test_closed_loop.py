"""Closed loops: laws of the loop, and the thesis' triangle."""

from __future__ import annotations

import control
import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.control import (
    PID,
    InverseCompensation,
    Limits,
    LinearLaw,
    ModelPlant,
    close_loop,
)
from piezo_opt.effects import BoucWen, PiezoGain, SecondOrder
from piezo_opt.errors import InputError

STACK = PiezoGain() + BoucWen() + SecondOrder()
VALUES = {
    "piezo_gain.d": 0.2057e-6, "bouc_wen.alpha": 0.0805e-6, "bouc_wen.beta": 0.00384,
    "bouc_wen.gamma": -0.00535, "second_order.omega": 8.0321, "second_order.zeta": 0.1992,
}  # fmt: skip
"""The thesis' actuator: its loop, and the mechanics of its Eq. 3.5."""
STILL = STACK.without("second_order")
LOOP = {k: v for k, v in VALUES.items() if not k.startswith("second")}
THESIS_PID = PID(50.137e6, 84.405e6, 3.9926e6, tau=0.01)


def triangle(period: float, peak: float = 15e-6, duration: float = 50.0) -> np.ndarray:
    time = np.arange(0.0, duration, period)
    return np.asarray(peak * (1.0 - np.abs(2.0 * time / duration - 1.0)))


def test_the_plant_is_the_package_s_own_simulation() -> None:
    generator = np.random.default_rng(1)
    drive = np.convolve(60.0 * generator.random(400), np.ones(10) / 10.0, mode="same")
    plant = ModelPlant(STACK, VALUES)
    plant.begin(float(drive[0]))
    read = [plant.advance(float(u), 0.01) for u in drive]
    # The same drive as the record of an instrument that goes to each value in 2 % of a period.
    k = np.arange(drive.size)
    time = np.concatenate([[0.0], np.column_stack([0.01 * (k + 0.02), 0.01 * (k + 1)]).ravel()])
    volts = np.concatenate([drive[:1], np.repeat(drive, 2)])
    record = po.Measurement(time, volts, np.zeros(time.size), allow_saturated=True)
    answer = po.simulate(STACK, record, VALUES, tolerance=1e-7)
    assert np.asarray(read) == pytest.approx(answer.reading[2::2], abs=1e-4 * np.ptp(read))


def test_pid_tracks_the_triangle_of_the_thesis() -> None:
    """Fig. 4.4: the error stays within about 0.15 um."""
    period = 0.005
    loop = close_loop(
        ModelPlant(STACK, VALUES, substeps=2), THESIS_PID, triangle(period), period=period,
        limits=Limits(-30.0, 150.0),
    )  # fmt: skip
    # Remanence takes a negative drive on the way back.
    assert loop.drive.min() < 0.0
    assert loop.largest < 0.15e-6
    assert loop.drive.max() < 150.0
    bare = close_loop(
        ModelPlant(STACK, VALUES, substeps=2), _Open(0.2057e-6), triangle(period), period=period
    )
    assert loop.iae < 0.05 * bare.iae


class _Open:
    """Drives by the gain alone."""

    def __init__(self, gain: float) -> None:
        self._gain = gain

    def begin(self) -> None:
        return None

    def act(
        self, state: None, reference: float, reading: float, period: float, low: float, high: float
    ) -> tuple[float, None]:
        return reference / self._gain, None


def test_inverse_compensation_straightens_the_loop() -> None:
    """Eq. 3.14: on its own model the position is the reference."""
    period = 0.05
    reference = triangle(period, duration=20.0)
    inverse = InverseCompensation.of_values(STILL, LOOP)
    loop = close_loop(ModelPlant(STILL, LOOP, substeps=40), inverse, reference, period=period)
    # A drive that is held reaches its position one period later.
    assert loop.position[1:] == pytest.approx(reference[:-1], abs=1e-9)
    bare = close_loop(ModelPlant(STILL, LOOP), _Open(0.2057e-6), reference, period=period)
    assert np.abs(bare.position[1:] - reference[:-1]).max() > 1e-6


def test_the_controller_reads_nothing_of_the_plant_but_the_measurement() -> None:
    class Replay:
        """Another plant that happens to read the same."""

        def __init__(self, readings: np.ndarray) -> None:
            self._left = list(readings)

        def begin(self, drive: float) -> float:
            return float(self._left.pop(0))

        def advance(self, drive: float, period: float) -> float:
            return float(self._left.pop(0)) if self._left else 0.0

    reference = triangle(0.01, duration=4.0)
    asked = {"period": 0.01, "limits": Limits(0.0, 150.0, 400.0), "noise": 5e-9, "seed": 3}
    first = close_loop(ModelPlant(STACK, VALUES), THESIS_PID, reference, delay=1, **asked)  # type: ignore[arg-type]
    again = close_loop(Replay(first.position), THESIS_PID, reference, delay=1, **asked)  # type: ignore[arg-type]
    assert (again.drive == first.drive).all()


def test_a_controller_of_python_control_s_is_the_same_in_the_loop() -> None:
    reference = triangle(0.01, duration=4.0)
    laws = (THESIS_PID, LinearLaw(THESIS_PID.transfer_function(0.01)))
    loops = [close_loop(ModelPlant(STACK, VALUES), one, reference, period=0.01) for one in laws]
    assert loops[1].drive == pytest.approx(loops[0].drive, abs=1e-7 * np.ptp(loops[0].drive))


def test_a_linear_controller_does_not_wind_up_and_holds_where_a_reading_is_none() -> None:
    law = LinearLaw(control.tf([4e6, -3.9e6], [1.0, -1.0], 0.01))
    reference = np.where(np.arange(600) < 300, 40e-6, 5e-6)
    limits = Limits(0.0, 60.0)
    loop = close_loop(ModelPlant(STILL, LOOP), law, reference, period=0.01, limits=limits)
    assert loop.drive[299] == 60.0
    # An integrator that had gone on for three seconds would hold the drive there for ten more.
    assert loop.drive[301] < 60.0
    assert abs(loop.error[-1]) < 0.02 * 40e-6
    _, state = law.act(law.begin(), 1e-6, 0.0, 0.01, 0.0, 60.0)
    drive, held = law.act(state, 1e-6, float("nan"), 0.01, 0.0, 60.0)
    assert drive == pytest.approx(4.0)
    assert held is state
    with pytest.raises(InputError, match="the loop every"):
        close_loop(ModelPlant(STILL, LOOP), law, reference, period=0.02)
    with pytest.raises(InputError, match="no sampling period"):
        LinearLaw(control.tf([1.0], [1.0, 1.0]))
    with pytest.raises(InputError, match="2 inputs and 1 outputs"):
        LinearLaw(control.ss([[0.5]], [[1.0, 1.0]], [[1.0]], [[0.0, 0.0]], 0.01))


def test_a_function_is_a_plant() -> None:
    reference, own = triangle(0.01, duration=2.0), ModelPlant(STACK, VALUES)

    def rig(drive: float, period: float) -> float:
        return own.advance(drive, period) if period > 0.0 else own.begin(drive)

    asked = {"period": 0.01, "limits": Limits(0.0, 150.0), "delay": 1}
    loops = [
        close_loop(one, THESIS_PID, reference, **asked)  # type: ignore[arg-type]
        for one in (rig, ModelPlant(STACK, VALUES))
    ]
    assert (loops[0].drive == loops[1].drive).all()
    assert loops[0].drive.max() > 10.0


def test_limits_resolution_delay_and_disturbance_hold() -> None:
    reference = np.full(300, 10e-6)
    limits = Limits(0.0, 60.0, 2000.0)
    loop = close_loop(
        ModelPlant(STACK, VALUES), THESIS_PID, reference, period=0.01, limits=limits, delay=2,
        resolution=0.1725e-6, noise=1e-8, seed=1, disturbance=lambda t: 1e-6 if t > 1.0 else 0.0,
    )  # fmt: skip
    assert loop.drive.min() >= 0.0
    assert loop.drive.max() <= 60.0
    assert np.abs(np.diff(loop.drive)).max() <= 2000.0 * 0.01 + 1e-9
    assert (loop.drive[:2] == 0.0).all()
    steps = loop.reading / 0.1725e-6
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    again = close_loop(
        ModelPlant(STACK, VALUES), THESIS_PID, reference, period=0.01, limits=limits, delay=2,
        resolution=0.1725e-6, noise=1e-8, seed=1,
    )  # fmt: skip
    assert loop.position[101] - again.position[101] == pytest.approx(1e-6, rel=1e-6)


def test_metrics_of_a_known_answer() -> None:
    class Lag:
        """y' = (u - y) / 1 s, in metres a volt."""

        def begin(self, drive: float) -> float:
            self._y = drive
            return self._y

        def advance(self, drive: float, period: float) -> float:
            self._y = drive + (self._y - drive) * np.exp(-period)
            return self._y

    loop = close_loop(Lag(), _Open(1.0), np.ones(20001), period=1e-3)
    assert loop.iae == pytest.approx(1.0, rel=1e-6)
    assert loop.ise == pytest.approx(0.5, rel=1e-6)
    assert loop.itae == pytest.approx(1.0, rel=1e-5)
    assert loop.settling() == pytest.approx(np.log(50.0), abs=2e-3)
    assert loop.overshoot == 0.0
    assert loop.largest == 1.0


def test_the_integral_does_not_wind_up() -> None:
    plant = ModelPlant(STILL, LOOP)
    reference = np.concatenate([np.full(400, 40e-6), np.full(200, 5e-6)])
    slow = PID(0.0, 20e6)
    loop = close_loop(plant, slow, reference, period=0.01, limits=Limits(0.0, 100.0))
    assert loop.drive[399] == 100.0
    # It turns at once, and not after it has unwound four seconds of an error of 20 um.
    assert loop.drive[410] < 100.0
    assert abs(loop.error[-1]) < 0.2e-6


def test_bad_loops_are_refused_in_a_sentence() -> None:
    plant = ModelPlant(STILL, LOOP)
    with pytest.raises(InputError, match="lower one is below"):
        Limits(10.0, 0.0)
    with pytest.raises(InputError, match="from 0 on"):
        PID(-1.0)
    with pytest.raises(InputError, match="positive time"):
        close_loop(plant, PID(1.0), [0.0, 1.0], period=0.0)
    with pytest.raises(InputError, match="two finite values"):
        close_loop(plant, PID(1.0), [0.0, np.nan], period=1.0)
    with pytest.raises(InputError, match="less steep"):
        InverseCompensation(1e-7, 2e-7, 0.0, 0.0)
    with pytest.raises(InputError, match="unstable"):
        close_loop(plant, PID(1e300), np.ones(2000), period=1.0)
