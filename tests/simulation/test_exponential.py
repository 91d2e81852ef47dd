"""What is linear in a chain moves by its exponential, and what is not is left alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from piezo_opt.assembly import assemble
from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Chain,
    ChargeBackCoupling,
    Creep,
    CubicStiffness,
    DeadZone,
    Delay,
    Effect,
    Equations,
    Friction,
    LoadMass,
    Model,
    Offset,
    Parameter,
    PiezoGain,
    Place,
    SecondMode,
    SecondOrder,
    SensorLag,
    SlewLimit,
    State,
)
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import Simulator, Substeps, exponential
from piezo_opt.simulation.exponential import (
    LENGTHS,
    LinearPart,
    linear_part,
    longest,
    split,
    weights,
)
from piezo_opt.values import Values

FloatArray = NDArray[Any]

LOOP = PiezoGain() + BoucWen()
MOVING = LOOP + SecondOrder() + Offset()
BOTH = (Between.HELD, Between.LINEAR)
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


@final
@dataclass(frozen=True)
class Written(Effect):
    """A lag as somebody may write it, beside what is not linear in it."""

    place = Place.OUTPUT
    z = State("m", "lagged")
    tau = Parameter("s", "its time", nominal=2e-4, bounds=(1e-6, 1.0), typical=(1e-4, 1e-2))
    share = Parameter("1", "gate", nominal=1.0, bounds=(0.0, 1.0), typical=(0.1, 1.0), null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        seen = chain.incoming.value
        rate = (-(x.z + x.z) + 3.0 * seen) / p.tau + (x.z - 0.2 * x.z * seen) * p.tau
        return Equations(gives=seen + p.share * (x.z - seen), moves={"z": rate}, starts={"z": seen})


@pytest.mark.parametrize(
    ("model", "wanted"),
    [
        (LOOP, set()),
        (MOVING, {MECHANICS}),
        (MOVING + SecondMode(), {MECHANICS, ("second_mode.q", "second_mode.r")}),
        (MOVING + SensorLag(), {MECHANICS, ("sensor_lag.z",)}),
        # Of two poles the second one follows but the first.
        (MOVING + SensorLag(poles=2), {MECHANICS, ("sensor_lag.z[0]", "sensor_lag.z[1]")}),
        (AmplifierLag(poles=2) + LOOP, {("amplifier_lag.z[0]", "amplifier_lag.z[1]")}),
        # What the velocity induces in the amplifier reaches the loop, which pulls at the mass.
        (ChargeBackCoupling() + MOVING, {MECHANICS}),
        # Whoever follows another lag and nothing else is its second pole.
        (LOOP + SensorLag() + Written(), {("sensor_lag.z",), ("written.z",)}),
        (PiezoGain() + SensorLag() + Written(), {("sensor_lag.z", "written.z")}),
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


def test_every_way_to_write_a_sum_is_taken_apart() -> None:
    system = assemble(PiezoGain() + Written(), {})
    part = linear_part(system, exact=True)
    assert part.blocks == ((0,),)
    d, tau = 1e-2, 2e-4
    given = {"piezo_gain.d": d, "written.tau": tau, "written.share": 1.0}
    p = [given[name] for name in system.parameter_names]
    slope = -2.0 / tau + tau
    assert float(part.matrix(p)) == pytest.approx(slope)
    for z, u in ((0.3, 0.0), (0.3, 40.0), (-2.0, 7.0)):
        seen = d * u
        rest = 3.0 * seen / tau - 0.2 * z * seen * tau
        none = np.zeros(0)
        assert float(part.rest(0.0, z, u, 0.0, none, none, p)) == pytest.approx(rest, abs=1e-9)


def test_a_negative_rate_is_taken_apart() -> None:
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    one = -(x * p)
    assert one.is_op(ca.OP_NEG)
    slopes, rest = split(one, {0: x}, x, x)
    assert float(ca.evalf(ca.substitute(slopes[0], p, 3.0))) == -3.0
    assert float(ca.evalf(rest)) == 0.0


def test_without_it_all_is_rest() -> None:
    system = assemble(MOVING, {})
    part = linear_part(system, exact=False)
    assert part.blocks == ()
    assert longest(part, np.ones(len(system.parameter_names))) == np.inf


def test_a_linear_part_that_was_kept_is_the_one_that_was_taken_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIEZO_OPT_CACHE", str(tmp_path))
    asked = [(assemble(model, {}), exact) for model in (MOVING, LOOP) for exact in (True, False)]
    linear_part.cache_clear()
    made = [linear_part(*one) for one in asked]
    assert len(list((tmp_path / "linear parts").iterdir())) == len(asked)

    def nobody(*_: object) -> None:
        raise AssertionError("taken out once more")

    monkeypatch.setattr(exponential, "_taken_out", nobody)
    linear_part.cache_clear()
    for part, one in zip(made, asked, strict=True):
        kept = linear_part(*one)
        assert kept is not part
        assert (kept.blocks, kept.heard) == (part.blocks, part.heard)
        for name in ("matrix", "rest", "slopes"):
            assert getattr(kept, name).serialize() == getattr(part, name).serialize()
    linear_part.cache_clear()


def test_slopes_are_those_of_the_rest() -> None:
    system = assemble(MOVING + CubicStiffness(), {})
    x = np.array([0.3, -0.2, 0.5][: len(system.state_names)])
    p = np.linspace(0.5, 1.5, len(system.parameter_names))
    for exact in (True, False):
        part = linear_part(system, exact)

        def rest(state: FloatArray, part: LinearPart = part) -> FloatArray:
            return np.array(part.rest(0.1, state, 2.0, -3.0, [], [], p)).ravel()

        steps = 1e-6 * np.eye(x.size)
        expected = np.stack([(rest(x + h) - rest(x - h)) / 2e-6 for h in steps], axis=1)
        slopes = np.array(part.slopes(0.1, x, 2.0, -3.0, [], [], p))
        np.testing.assert_allclose(slopes, expected, rtol=1e-6, atol=1e-6)


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


@pytest.mark.parametrize("zeta", [0.3, 1.0, 3.0, 10.0])
def test_a_lag_of_two_poles_is_exact_however_close_or_far_they_are(zeta: float) -> None:
    model = PiezoGain() + Offset() + SensorLag(poles=2)
    own = {"sensor_lag.share": 1.0, "sensor_lag.tau": 0.3 * STEP, "sensor_lag.zeta": zeta}
    values = values_of(model, own)
    once, often = (
        Simulator(model, record(), values, substeps=Substeps(STEP / count, 1e9, exact=True))
        for count in (1 if zeta < 2.0 else 64, 640)
    )
    a, b = once.reading(values), often.reading(values)
    assert np.abs(a - b).max() < 1e-10 * np.ptp(b)


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


def test_many_samples_of_even_time_are_even() -> None:
    """Rounding of instants makes more lengths than are kept, and of a held drive twice as many."""
    time = np.arange(20_000) / 3e3
    drive = 30.0 + 30.0 * np.sin(2 * np.pi * 3.0 * time)
    given = Measurement(time, drive, 1e-7 * drive, between=Between.HELD)
    run = Simulator(MOVING, given, values_of(MOVING), exact=True)
    assert run.accuracy.substeps.exact
    lengths = run.segment(values_of(MOVING)).length
    assert np.unique(lengths).size <= 4
    plain = Simulator(MOVING, given, values_of(MOVING)).segment(values_of(MOVING)).length
    assert np.unique(plain).size > LENGTHS
    np.testing.assert_allclose(lengths, plain, rtol=0, atol=1e-14)


def test_what_a_fast_lag_is_followed_by_is_not_stepped_over() -> None:
    model, tau = AmplifierLag() + MOVING, 5e-5
    own = {"amplifier_lag.share": 1.0, "amplifier_lag.tau": tau}
    run = Simulator(model, record(), values_of(model, own), exact=True, tolerance=1.0)
    assert run.accuracy.substeps.longest == pytest.approx(4.0 * tau)


def test_corners_along_the_drive_do_not_cut_the_time_between() -> None:
    """A held drive crosses a dead zone within its steps, a straight one on its way."""
    model = DeadZone() + MOVING
    own = {"dead_zone.share": 1.0, "dead_zone.width": 1.0, "second_order.zeta": 0.02}
    values = values_of(model, own)
    held, straight = (Simulator(model, record(between), values, exact=True) for between in BOTH)
    first = Simulator(model, record(), values, exact=True, tolerance=1.0).accuracy.substeps
    assert held.accuracy.substeps.longest == pytest.approx(STEP, rel=2e-3)
    assert held.accuracy.substeps.largest_move < 0.3 * first.largest_move
    assert straight.accuracy.substeps.longest < 0.3 * STEP
    assert straight.accuracy.substeps.largest_move == first.largest_move


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
