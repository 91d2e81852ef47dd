"""What is linear in a chain moves by its exponential, and what is not is left alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from piezo_opt.assembly import assemble
from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Creep,
    CubicStiffness,
    Delay,
    Friction,
    LoadMass,
    Model,
    Offset,
    PiezoGain,
    SecondMode,
    SecondOrder,
    SensorLag,
    SlewLimit,
)
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import Simulator, Substeps
from piezo_opt.simulation.exponential import LENGTHS, linear_part, longest, weights
from piezo_opt.values import Values

FloatArray = NDArray[Any]

LOOP = PiezoGain() + BoucWen()
MOVING = LOOP + SecondOrder() + Offset()
STEP = 1e-3
OMEGA = 2.0 * np.pi * 80.0


def record(between: Between = Between.LINEAR, jitter: float = 0.0) -> Measurement:
    time = np.arange(400) * STEP
    time = time + jitter * STEP * np.random.default_rng(0).uniform(-1.0, 1.0, time.size)
    drive = 30.0 + 30.0 * np.sin(2 * np.pi * 3.0 * time) + 5.0 * np.sin(2 * np.pi * 41.0 * time)
    return Measurement(time, drive, 1e-7 * drive, between=between)


def values_of(model: Model, own: Mapping[str, float] | None = None) -> Values:
    moving = {"second_order.omega": OMEGA} if "second_order" in model.names else {}
    return Values.nominal(model).with_({**moving, **(own or {})})


# --- the functions --------------------------------------------------------------------------

SWINGING = np.array([[0.0, 1.0], [-1.0, -0.04]])
CREEPING = np.array([[0.0, 1.0], [-1.0, -4.0]])
SKEW = np.array([[-1.0, 0.3], [0.5, 0.0]])
LAG = np.array([[-1.0]])


def phis(z: FloatArray) -> list[FloatArray]:
    """e^z, phi_1, phi_2 and phi_3 as the blocks of one larger exponential (Al-Mohy & Higham)."""
    n = z.shape[0]
    larger = np.zeros((4 * n, 4 * n))
    larger[:n, :n] = z
    for k in range(3):
        larger[k * n : (k + 1) * n, (k + 1) * n : (k + 2) * n] = np.eye(n)
    whole = expm(larger)
    return [whole[:n, k * n : (k + 1) * n] for k in range(4)]


@pytest.mark.parametrize("size", [1e-9, 1e-3, 0.7, 0.999, 1.001, 5.0, 25.0])
@pytest.mark.parametrize("block", [LAG, -LAG, SWINGING, CREEPING, SKEW])
def test_the_weights_are_those_of_the_exponential(block: FloatArray, size: float) -> None:
    h = 3e-4
    given = ca.SX.sym("L", *block.shape), ca.SX.sym("h")
    of = weights(*given)
    all_of = [of.half, of.half_input, of.whole, of.first, of.middle, of.last]
    z = size * block
    found = [np.array(one) for one in ca.Function("weights", given, all_of)(z / h, h)]
    whole, one, two, three = phis(z)
    half, half_one, *_ = phis(0.5 * z)
    inputs = (one - 3.0 * two + 4.0 * three, 2.0 * two - 4.0 * three, 4.0 * three - two)
    wanted = [half, 0.5 * h * half_one, whole, *(h * one for one in inputs)]
    for a, b, unit in zip(found, wanted, (1.0, h, 1.0, h, h, h), strict=True):
        # What has faded adds nothing to a state.
        np.testing.assert_allclose(a, b, rtol=0, atol=2e-13 * max(unit, np.abs(b).max()))


# --- what is linear -------------------------------------------------------------------------


def blocks(model: Model) -> set[tuple[str, ...]]:
    system = assemble(model, {})
    part = linear_part(system, exact=True)
    return {tuple(system.state_names[i] for i in block) for block in part.blocks}


MECHANICS = ("second_order.x", "second_order.w")


@pytest.mark.parametrize(
    ("model", "wanted"),
    [
        (LOOP, set()),
        (MOVING, {MECHANICS}),
        (MOVING + SecondMode(), {MECHANICS, ("second_mode.q", "second_mode.r")}),
        (MOVING + SensorLag(), {MECHANICS, ("sensor_lag.z",)}),
        # Neither the contact's memory nor the limited drive is linear in itself.
        (MOVING + Friction(), {MECHANICS}),
        (MOVING + SlewLimit(), {MECHANICS}),
        # The stiffening is left to the rest, the resonance is not.
        (MOVING + CubicStiffness(), {MECHANICS}),
    ],
)
def test_swinging_pairs_and_lags_are_found(model: Model, wanted: set[tuple[str, ...]]) -> None:
    assert blocks(model) == wanted


@pytest.mark.parametrize(
    "model",
    [
        MOVING + Creep() + SensorLag(), AmplifierLag() + MOVING + SecondMode(),
        MOVING + LoadMass() + Friction() + CubicStiffness(), SlewLimit() + MOVING + Delay(),
    ],
)  # fmt: skip
def test_the_parts_add_up_to_the_rates(model: Model) -> None:
    system = assemble(model, {})
    part = linear_part(system, exact=True)
    rng = np.random.default_rng(3)
    p = np.array([values_of(model)[name] for name in system.parameter_names])
    p = p * rng.uniform(0.9, 1.1, p.size) + rng.uniform(0.0, 1e-9, p.size)
    for _ in range(5):
        x = rng.normal(size=len(system.state_names)) * 1e-6
        rest_of = (0.1, x, 30.0, 400.0, np.zeros(0), np.zeros(0), p)
        whole = np.array(system.rate(*rest_of)).ravel()
        matrix = np.array(ca.densify(part.matrix(p)))
        again = matrix @ x + np.array(part.rest(*rest_of)).ravel()
        sizes = np.abs(matrix) @ np.abs(x) + np.abs(whole)
        assert (np.abs(again - whole) <= 1e-12 * sizes).all()
    inside = np.zeros(matrix.shape, dtype=bool)
    for block in part.blocks:
        inside[np.ix_(block, block)] = True
    assert (matrix[inside] != 0.0).any()
    assert (matrix[~inside] == 0.0).all()


def test_without_it_all_is_rest() -> None:
    system = assemble(MOVING, {})
    part = linear_part(system, exact=False)
    assert part.blocks == ()
    assert longest(part, np.ones(len(system.parameter_names))) == np.inf


def test_a_lag_that_something_follows_is_not_stepped_over() -> None:
    tau = 1e-5
    lagged = LOOP + SensorLag() + Offset()
    led = AmplifierLag() + LOOP + Offset()

    def reach(model: Model, own: Mapping[str, float]) -> float:
        system = assemble(model, {})
        p = np.array([values_of(model, own)[name] for name in system.parameter_names])
        return longest(linear_part(system, exact=True), p) / tau

    assert reach(lagged, {"sensor_lag.tau": tau}) == pytest.approx(32.0)
    assert reach(led, {"amplifier_lag.tau": tau}) == pytest.approx(4.0)


# --- a simulation ---------------------------------------------------------------------------


def test_mechanics_alone_are_exact_however_long_the_sub_step() -> None:
    """Under a straight drive nothing but rounding is left."""
    model = PiezoGain() + SecondOrder() + Offset()
    values = values_of(model, {"second_order.omega": 5e3, "second_order.zeta": 0.01})
    once, often = (
        Simulator(model, record(), values, substeps=Substeps(STEP / count, 1e9, exact=True))
        for count in (1, 50)
    )
    assert once.substeps(values) == len(record()) - 1 + 1
    a, b = once.reading(values), often.reading(values)
    assert np.abs(a - b).max() < 1e-10 * np.ptp(b)
    # Runge-Kutta is not even stable there.
    plain = Simulator(model, record(), values, substeps=Substeps(STEP, 1e9))
    with np.errstate(over="ignore", invalid="ignore"):
        assert not np.abs(plain.reading(values) - b).max() < np.ptp(b)


def test_a_second_mode_takes_a_tenth_of_the_sub_steps() -> None:
    model = MOVING + SecondMode()
    values = values_of(model, {"second_mode.share": 0.1})
    one, ten = (Simulator(model, record(), values, exact=exact) for exact in (True, False))
    assert one.accuracy.substeps.exact
    assert not ten.accuracy.substeps.exact
    assert ten.substeps(values) > 7 * one.substeps(values)
    a, b = one.reading(values), ten.reading(values)
    assert np.sqrt(np.mean((a - b) ** 2)) < 1e-4 * np.ptp(b)


def test_uneven_time_stays_with_runge_kutta() -> None:
    values = values_of(MOVING)
    uneven, even = (
        Simulator(MOVING, record(jitter=jitter), values, exact=True) for jitter in (0.2, 0.0)
    )
    assert not uneven.accuracy.substeps.exact
    assert even.accuracy.substeps.exact
    # The same instants on a clock that shows the hour are even, whatever their last digits.
    given = record()
    later = Measurement(3600.0 + given.time, given.drive, given.position)
    assert np.ptp(np.diff(later.time)) > 0.0
    assert Simulator(MOVING, later, values, exact=True).accuracy.substeps.exact


@pytest.mark.parametrize("between", [Between.LINEAR, Between.HELD])
def test_more_lengths_than_are_kept_change_nothing(between: Between) -> None:
    """Weights are forgotten and made again; the virtual machine keeps none."""
    given = record(between, jitter=0.2)
    model = MOVING + SensorLag()
    values = values_of(model, {"sensor_lag.share": 0.9, "sensor_lag.tau": 3e-4})
    directions = tuple(n for n, p in model.parameters.items() if not p.fixed)
    runs = [
        Simulator(
            model, given, values, directions=directions, prefer_compiled=compiled,
            substeps=Substeps(STEP, 2.0, exact=True),
        )
        for compiled in (True, False)
    ]  # fmt: skip
    assert np.unique(given.time[1:] - given.time[:-1]).size > LENGTHS
    (a, slopes), (b, others) = (run.with_sensitivities(values) for run in runs)
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * np.ptp(b))
    for one, other in zip(slopes.T, others.T, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-10 * np.abs(other).max())
