"""The scheme against CVODES, closed forms, its own order, and finite differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.effects import (
    AmplifierLag,
    Asymmetry,
    BoucWen,
    Creep,
    CubicStiffness,
    Delay,
    MainsPickup,
    Model,
    Offset,
    PiezoGain,
    RateDependence,
    SecondOrder,
    SensorLag,
    Temperature,
)
from piezo_opt.errors import ModelError
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import Simulator, Substeps
from piezo_opt.simulation.scheme import scheme
from piezo_opt.values import Values

FloatArray = NDArray[Any]


def record(time: FloatArray, drive: FloatArray, between: Between = Between.LINEAR) -> Measurement:
    return Measurement(time, drive, 1e-7 * drive, between=between)


def fine(time: FloatArray, count: int = 50) -> Substeps:
    """Sub-steps so short that the scheme's error is rounding."""
    return Substeps(float(np.diff(time).max()) / count, 1e9)


# --- another integrator ---------------------------------------------------------------------


def cvodes(
    system: System, time: FloatArray, drive: FloatArray, values: Mapping[str, float]
) -> FloatArray:
    """Readings by CVODES, stretch by stretch, so that it never meets a corner of the drive."""
    x = ca.MX.sym("x", len(system.state_names))
    t, u, du, h = (ca.MX.sym(n) for n in ("t", "u", "du", "h"))
    p = np.array([values[n] for n in system.parameter_names])
    none = ca.MX(0, 1)
    rate = h * system.rate(t * h, x, u + du * h * t, du, none, none, p)
    tight = {"abstol": 1e-16, "reltol": 1e-11}
    problem = {"x": x, "t": t, "p": ca.vertcat(u, du, h), "ode": rate}
    over = ca.integrator("over", "cvodes", problem, 0.0, 1.0, tight)
    state = system.start(time[0], drive[0], [], p, np.zeros(x.numel()))
    readings = [float(system.reading(time[0], state, drive[0], 0.0, [], [], p))]
    for k in range(time.size - 1):
        length = time[k + 1] - time[k]
        slope = (drive[k + 1] - drive[k]) / length
        state = over(x0=state, p=[drive[k], slope, length])["xf"]
        readings.append(float(system.reading(0.0, state, drive[k + 1], slope, [], [], p)))
    return np.array(readings)


FULL = (
    AmplifierLag() + PiezoGain() + BoucWen() + Creep(elements=2) + RateDependence() + SecondOrder()
    + CubicStiffness() + Offset()
)  # fmt: skip
OPEN = {
    "amplifier_lag.share": 0.8, "amplifier_lag.tau": 1e-4, "creep.c": 0.08, "creep.tau": 1e-3,
    "bouc_wen.beta": 0.05, "bouc_wen.gamma": -0.02, "offset.y0": 2e-7, "second_order.zeta": 0.03,
    "second_order.omega": 7e3,
}  # fmt: skip


def test_the_reading_equals_that_of_cvodes_on_uneven_time_with_a_gap() -> None:
    rng = np.random.default_rng(4)
    time = 3.0 + np.cumsum(rng.uniform(2e-5, 2e-4, 120))
    time[70:] += 4e-3
    drive = 40.0 + 30.0 * np.sin(2 * np.pi * 130 * time) + 10.0 * rng.standard_normal(time.size)
    values = Values.nominal(FULL).with_(OPEN)
    # Short sub-steps: behind a lagging amplifier the drive turns within one of them.
    run = Simulator(FULL, record(time, drive), values, substeps=Substeps(2.5e-7, 1e9))
    reading = run.reading(values)
    expected = cvodes(run.system, time, drive, values)
    np.testing.assert_allclose(reading, expected, rtol=0, atol=6e-8 * np.ptp(expected))
    # And every part of the model takes part in it.
    for name in ("amplifier_lag.share", "creep.c", "bouc_wen.gamma", "second_order.zeta"):
        other = run.reading(values.with_({name: 0.9 * values[name]}))
        assert np.abs(other - reading).max() > 1e-5 * np.ptp(expected), name


# --- closed forms ---------------------------------------------------------------------------

LINEAR = PiezoGain() + SecondOrder()
LINEAR_VALUES = Values({"piezo_gain.d": 1e-7, "second_order.omega": 5e3, "second_order.zeta": 0.1})


def step_response(t: FloatArray, omega: float, zeta: float) -> FloatArray:
    """Of omega^2 / (s^2 + 2 zeta omega s + omega^2), for t >= 0."""
    damped = omega * np.sqrt(1.0 - zeta**2)
    fade = np.exp(-zeta * omega * t)
    return np.asarray(
        1.0 - fade * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t))
    )


def ramp_response(t: FloatArray, omega: float, zeta: float) -> FloatArray:
    """The same system's answer to a ramp of slope 1."""
    damped = omega * np.sqrt(1.0 - zeta**2)
    fade = np.exp(-zeta * omega * t)
    wave = 2 * zeta / omega * np.cos(damped * t) + (2 * zeta**2 - 1) / damped * np.sin(damped * t)
    return np.asarray(t - 2 * zeta / omega + fade * wave)


def test_the_mechanics_answer_a_ramp_as_they_should() -> None:
    time = np.linspace(0.0, 4e-3, 41)
    drive = 2e4 * time
    reading = Simulator(LINEAR, record(time, drive), LINEAR_VALUES, substeps=fine(time)).reading(
        LINEAR_VALUES
    )
    expected = 1e-7 * 2e4 * ramp_response(time, 5e3, 0.1)
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-8 * np.ptp(expected))


@pytest.mark.parametrize("chosen", [False, True])
def test_a_held_step_is_a_step_and_never_lost(chosen: bool) -> None:
    time = np.linspace(0.0, 4e-3, 41)
    drive = np.where(np.arange(41) >= 5, 60.0, 0.0)
    held = record(time, drive, Between.HELD)
    substeps = None if chosen else fine(time)
    run = Simulator(LINEAR, held, LINEAR_VALUES, substeps=substeps)
    reading = run.reading(LINEAR_VALUES)
    since = time - time[5]
    # The step is a ramp of a thousandth of a sample that ends at its sample: its middle counts.
    late = np.maximum(0.0, since + 0.5e-3 * (time[1] - time[0]))
    expected = np.where(since >= 0, 6e-6 * step_response(late, 5e3, 0.1), 0.0)
    scheme_error = 4.0 * run.accuracy.error if chosen else 0.0
    np.testing.assert_allclose(reading, expected, rtol=0, atol=1e-5 * 6e-6 + scheme_error)


def loop(h: float, before: float, after: float, p: Mapping[str, float]) -> float:
    """Bouc-Wen with n = 1 after a straight move of the drive, in closed form.

    For rising drive dh/dv = alpha - (beta sign(h) + gamma) |h|, for falling drive the same with
    -beta; between sign changes of h an exponential.
    """
    alpha, gamma = p["bouc_wen.alpha"], p["bouc_wen.gamma"]
    way = np.sign(after - before)
    left = abs(after - before)
    while left > 0.0:
        side = np.sign(h) if h != 0.0 else way
        # With w = |v|: dh/dw = way alpha - beta h - way gamma side h.
        k, push = p["bouc_wen.beta"] + way * gamma * side, way * alpha
        if side == way:
            return float(push / k + (h - push / k) * np.exp(-k * left))
        to_zero = np.log(1.0 - h * k / push) / k
        if to_zero >= left:
            return float(push / k + (h - push / k) * np.exp(-k * left))
        h, left = 0.0, left - to_zero
    return h


CORNERS = np.array([0.0, 70.0, 20.0, 55.0, -30.0, 10.0, -60.0, 90.0, 0.0])


@pytest.mark.parametrize("between", [Between.LINEAR, Between.HELD])
@pytest.mark.parametrize("gamma", [-0.01, 0.0, 0.015])
def test_the_loop_is_the_closed_form_on_every_monotone_stretch(
    between: Between, gamma: float
) -> None:
    model = PiezoGain() + BoucWen()
    values = Values.nominal(model).with_(
        {"bouc_wen.alpha": 4e-8, "bouc_wen.beta": 0.03, "bouc_wen.gamma": gamma}
    )
    time = np.arange(CORNERS.size) * 1e-2
    h = np.zeros(CORNERS.size)
    for k in range(1, h.size):
        h[k] = loop(h[k - 1], CORNERS[k - 1], CORNERS[k], values)
    expected = values["piezo_gain.d"] * CORNERS - h
    run = Simulator(model, record(time, CORNERS, between), values, substeps=Substeps(1.0, 0.25))
    assert np.abs(run.reading(values) - expected).max() < 2e-6 * np.ptp(expected)
    assert np.ptp(h) > 0.1 * np.ptp(expected)
    # With sub-steps chosen by the simulator: to the accuracy that it states.
    own = Simulator(model, record(time, CORNERS, between), values)
    error = float(np.sqrt(np.mean((own.reading(values) - expected) ** 2)))
    assert error <= 1.1 * own.accuracy.error + 1e-12 * np.ptp(expected)
    assert own.accuracy.error <= 5e-5 * np.ptp(expected) * 1.01


def test_creep_after_a_step_is_an_exponential() -> None:
    model = PiezoGain() + Creep(elements=1)
    values = Values({"piezo_gain.d": 1e-7, "creep.c": 0.1, "creep.tau": 0.5})
    time = np.arange(60) * 0.05
    drive = np.where(np.arange(60) >= 3, 50.0, 0.0)
    run = Simulator(model, record(time, drive, Between.HELD), values, substeps=fine(time))
    since = np.maximum(0.0, time - time[3] + 0.5e-3 * 0.05)
    # tau z' = d v - (1 - c) z and the reading is d v + c z.
    crept = 0.1 / 0.9 * (1.0 - np.exp(-0.9 * since / 0.5))
    expected = np.where(time >= time[3], 5e-6 * (1.0 + crept), 0.0)
    np.testing.assert_allclose(run.reading(values), expected, rtol=0, atol=1e-9 * 5e-6)


# --- order ----------------------------------------------------------------------------------


@pytest.mark.parametrize("exact", [False, True])
def test_the_scheme_is_of_order_four(exact: bool) -> None:
    # gamma = 0: the loop's rate has no corner of its own; those of the drive lie on boundaries.
    model = PiezoGain() + BoucWen() + Creep(elements=1) + SecondOrder()
    values = Values.nominal(model).with_(
        {"creep.c": 0.1, "creep.tau": 1e-3, "bouc_wen.gamma": 0.0, "bouc_wen.beta": 0.04}
    )
    time = np.arange(50) * 2e-4
    drive = 50.0 * (1.0 - np.cos(2 * np.pi * 200 * time))

    def error(count: int) -> float:
        cut = Substeps(2e-4 / count, 1e9, exact=exact)
        run = Simulator(model, record(time, drive), values, substeps=cut)
        return float(np.sqrt(np.mean((run.reading(values) - true) ** 2)))

    # The other scheme's, so that they must agree.
    cut = Substeps(2e-4 / 256, 1e9, exact=not exact)
    true = Simulator(model, record(time, drive), values, substeps=cut).reading(values)
    errors = [error(count) for count in (4, 8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders[1:], 4.0, atol=0.15)


# --- sensitivities --------------------------------------------------------------------------


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("prefer_compiled", [True, False])
def test_sensitivities_are_those_of_the_scheme_itself(prefer_compiled: bool, exact: bool) -> None:
    # Coarse sub-steps on purpose: the derivative is that of the numbers, not of the physics.
    model = FULL + Asymmetry()
    values = Values.nominal(model).with_({**OPEN, "asymmetry.delta": 1e-10})
    time = np.arange(80) * 1e-4
    drive = 30.0 + 40.0 * np.sin(2 * np.pi * 100 * time)
    directions = (
        *(n for n, p in model.parameters.items() if not p.fixed),
        "initial.bouc_wen.h", "initial.creep.z[1]", "initial.second_order.w",
    )  # fmt: skip
    run = Simulator(
        model, record(time, drive), values, directions=directions,
        substeps=Substeps(1e-4, 1e9, exact=exact), prefer_compiled=prefer_compiled,
    )  # fmt: skip
    reading, slopes = run.with_sensitivities(values)
    np.testing.assert_allclose(reading, run.reading(values), rtol=0 if not exact else 1e-13)
    scales = {
        "initial.bouc_wen.h": 1e-7,
        "initial.creep.z[1]": 1e-7,
        "initial.second_order.w": 1e-3,
    }
    for column, name in enumerate(directions):
        if name in model.parameters:
            size = abs(values[name]) or model.parameters[name].scale
        else:
            size = scales[name]
        at = values.get(name, 0.0)
        up = run.reading({**values, name: at + 1e-5 * size})
        down = run.reading({**values, name: at - 1e-5 * size})
        difference = (up - down) / 2e-5
        slope = slopes[:, column] * size
        assert np.abs(slope).max() > 1e-9 * np.ptp(reading), name
        np.testing.assert_allclose(
            slope, difference, rtol=0, atol=1e-5 * np.abs(slope).max(), err_msg=name
        )


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("prefer_compiled", [True, False])
def test_a_delay_moves_the_clock_and_the_channels_with_the_drive(
    prefer_compiled: bool, exact: bool
) -> None:
    """A sub-step that begins later sees the warmth, and what time moves, of another moment."""
    model = PiezoGain() + Temperature() + SecondOrder() + MainsPickup() + SensorLag() + Delay()
    values = Values.nominal(model).with_({
        "temperature.a": 1e-9, "mains_pickup.a": 1e-7, "mains_pickup.phi": 0.3,
        "delay.T": 2.3e-4, "sensor_lag.share": 0.9, "sensor_lag.tau": 2e-4,
        "second_order.omega": 3e3,
    })  # fmt: skip
    time = np.arange(200) * 1e-4
    drive = 30.0 + 40.0 * np.sin(2 * np.pi * 60 * time)
    warmth = 295.0 + 3.0 * np.sin(2 * np.pi * 90 * time)
    given = record(time, drive).with_(channels={"temperature": warmth})
    run = Simulator(
        model, given, values, directions=("delay.T",), prefer_compiled=prefer_compiled,
        substeps=replace(fine(time, 1), exact=exact),
    )  # fmt: skip
    _, slopes = run.with_sensitivities(values)
    step = 1e-9
    up, down = (run.reading({**values, "delay.T": 2.3e-4 + d}) for d in (step, -step))
    difference = (up - down) / (2.0 * step)
    tolerance = 1e-5 * np.abs(difference).max()
    np.testing.assert_allclose(slopes[:, 0], difference, rtol=0, atol=tolerance)


def test_only_entries_that_can_move_are_carried() -> None:
    model = PiezoGain() + BoucWen() + SecondOrder() + Offset()
    values = Values.nominal(model)
    time = np.arange(20) * 1e-4
    run = Simulator(model, record(time, np.sin(1e3 * time)), values, substeps=fine(time))
    directions = ("offset.y0", "piezo_gain.d", "bouc_wen.beta", "second_order.zeta")
    made = scheme(run.system, directions)
    carried = {
        (run.system.state_names[r].split(".")[1], directions[c])
        for r, c in zip(made.rows, made.columns, strict=True)
    }
    mechanics = {(s, n) for s in "xw" for n in directions if n != "offset.y0"}
    # The hysteretic displacement feels neither the gain nor the mechanics nor the offset.
    assert carried == {("h", "bouc_wen.beta"), *mechanics}


def test_an_unknown_direction_is_refused_by_name() -> None:
    model: Model = PiezoGain() + BoucWen()
    time = np.arange(20) * 1e-4
    for name in ("bouc_wen.delta", "initial.bouc_wen.z"):
        with pytest.raises(ModelError, match=name):
            Simulator(
                model, record(time, np.sin(1e3 * time)), Values.nominal(model),
                directions=(name,), substeps=fine(time),
            ).with_sensitivities(Values.nominal(model))  # fmt: skip
