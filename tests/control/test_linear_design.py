"""Linear designs give the numbers of the thesis, and of the textbooks."""

from __future__ import annotations

import control
import numpy as np
import pytest

from piezo_opt.control import (
    ei,
    insensitivity,
    kalman,
    linearise,
    lqr,
    lqr_as_program,
    pole_placement,
    zv,
    zvd,
)
from piezo_opt.effects import BoucWen, Creep, PiezoGain, SecondOrder
from piezo_opt.errors import InputError

THESIS = control.ss([[-0.82, -34.8], [1.0, 0.0]], [[1.0], [0.0]], [[0.0, 0.85]], [[0.0]])
"""Eq. 3.16 of the thesis."""


def test_lqr_of_the_thesis_by_riccati_and_as_a_program() -> None:
    found = lqr(THESIS, [443.0, 335.0])
    assert found.gain == pytest.approx(np.array([[20.457, 4.5197]]), rel=5e-5)
    assert found.precompensator == pytest.approx(46.258, rel=5e-5)
    again = lqr_as_program(THESIS, [443.0, 335.0])
    assert again.gain == pytest.approx(found.gain, rel=1e-6)
    assert float(found.closed.dcgain().real) == pytest.approx(1.0, rel=1e-12)


def test_the_program_finds_the_gain_of_an_unstable_system_of_three_states() -> None:
    generator = np.random.default_rng(5)
    system = control.ss(
        generator.normal(size=(3, 3)), generator.normal(size=(3, 1)), np.eye(3)[:1], 0
    )
    assert system.poles().real.max() > 0.0
    assert lqr_as_program(system, [1.0, 2.0, 3.0], 0.5).gain == pytest.approx(
        lqr(system, [1.0, 2.0, 3.0], 0.5).gain, rel=1e-6
    )


def test_pole_placement_of_the_thesis() -> None:
    found = pole_placement(THESIS, overshoot=0.02, settling=0.5)
    assert found.gain == pytest.approx(np.array([[15.18, 70.474]]), rel=1e-5)
    assert found.precompensator == pytest.approx(123.85, rel=5e-5)
    _, answer = control.step_response(found.closed, np.linspace(0.0, 2.0, 4001))
    assert answer.max() == pytest.approx(1.02, abs=1e-4)


def test_designs_refuse_what_makes_no_sense() -> None:
    idle = control.ss([[-1.0, 0.0], [0.0, -2.0]], [[1.0], [0.0]], [[1.0, 1.0]], [[0.0]])
    with pytest.raises(InputError, match="cannot be moved"):
        lqr(idle, [1.0, 1.0])
    with pytest.raises(InputError, match="does not show"):
        kalman(
            control.ss(idle.A, [[1.0], [1.0]], [[1.0, 0.0]], 0), drive_noise=1.0, reading_noise=1.0
        )
    with pytest.raises(InputError, match="2 states"):
        lqr(THESIS, [1.0, 1.0, 1.0])
    with pytest.raises(InputError, match="positive"):
        lqr(THESIS, [1.0, 1.0], 0.0)
    with pytest.raises(InputError, match="between 0 and 1"):
        pole_placement(THESIS, overshoot=2.0, settling=0.5)
    with pytest.raises(InputError, match="swings"):
        zv(10.0, 1.0)


def test_the_kalman_gain_solves_its_riccati_equation() -> None:
    q, r = 3.0, 0.2
    gain = kalman(THESIS, drive_noise=q, reading_noise=r)
    p, *_ = control.care(THESIS.A.T, THESIS.C.T, q * THESIS.B @ THESIS.B.T, np.array([[r]]))
    assert gain == pytest.approx(p @ THESIS.C.T / r, rel=1e-9)
    assert np.linalg.eigvals(THESIS.A - gain @ THESIS.C).real.max() < 0.0


def test_the_shaper_of_the_thesis() -> None:
    omega = np.sqrt(34.8)
    shaper = zv(omega, 0.8194 / (2.0 * omega))
    assert shaper.amplitudes == pytest.approx([0.5545, 0.4456], abs=1e-4)
    assert shaper.times == pytest.approx([0.0, 0.5338], abs=1e-4)


@pytest.mark.parametrize(("make", "width"), [(zv, 0.06), (zvd, 0.29), (ei, 0.40)])
def test_insensitivities_are_those_of_the_textbook(make, width) -> None:  # type: ignore[no-untyped-def]
    shaper = make(7.0, 0.0)
    assert insensitivity(shaper, 7.0, 0.0) == pytest.approx(width, abs=0.005)
    assert shaper.amplitudes.sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(("make", "left"), [(zv, 0.0), (zvd, 0.0), (ei, 0.05)])
def test_a_simulated_mode_swings_by_what_the_shaper_says(make, left) -> None:  # type: ignore[no-untyped-def]
    omega, zeta = 40.0, 0.08
    mode = control.tf([omega**2], [1.0, 2.0 * zeta * omega, omega**2])
    shaper = make(omega, zeta)
    time = np.linspace(0.0, 1.0, 40001)
    after = time > shaper.delay

    def swing(command: np.ndarray) -> np.ndarray:
        # Displacement and speed of the swing, as one complex number that only decays.
        _, y = control.forced_response(mode, time, command)
        speed = np.gradient(y, time)
        damped = omega * np.sqrt(1.0 - zeta**2)
        return np.abs(y - 1.0 + 1j * (speed + zeta * omega * (y - 1.0)) / damped)

    step = np.ones_like(time)
    bare = swing(step)
    shaped = sum(
        a * np.where(time >= t, 1.0, 0.0)
        for a, t in zip(shaper.amplitudes, shaper.times, strict=True)
    )
    # Both decay alike; a bare step's own swing began at 1 when the last impulse would have come.
    begun = 1.0 / np.sqrt(1.0 - zeta**2)
    late = begun * np.exp(-zeta * omega * (time - shaper.delay))
    assert bare[100] == pytest.approx(begun * np.exp(-zeta * omega * time[100]), rel=1e-3)
    share = np.median((swing(np.asarray(shaped)) / late)[after & (time < 0.5)])
    assert share == pytest.approx(left, abs=2e-3)
    assert shaper.vibration(omega, zeta) == pytest.approx(left, abs=1e-9)


def test_linearised_the_loop_has_the_slope_of_small_signals() -> None:
    model = PiezoGain() + BoucWen() + SecondOrder()
    omega, zeta = 2.0 * np.pi * 300.0, 0.05
    values = {
        "piezo_gain.d": 2e-7, "bouc_wen.alpha": 5e-8,
        "second_order.omega": omega, "second_order.zeta": zeta,
    }  # fmt: skip
    linear = linearise(model, values)
    assert linear.nstates == 2
    assert linear.dcgain().real == pytest.approx(1.5e-7, rel=1e-12)
    s = 1j * 2.0 * np.pi * 200.0
    expected = 1.5e-7 * omega**2 / (s**2 + 2.0 * zeta * omega * s + omega**2)
    assert linear(s) == pytest.approx(expected, rel=1e-9)
    creeping = linearise(PiezoGain() + Creep(elements=1) + SecondOrder(), {"creep.c": 0.1})
    assert creeping.nstates == 3
