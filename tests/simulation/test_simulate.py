"""One simulation, two engines, several threads; and what it refuses."""

from __future__ import annotations

import platform
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, final

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from piezo_opt.assembly import assemble
from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Chain,
    Creep,
    Delay,
    Drift,
    Effect,
    Equations,
    Friction,
    MainsPickup,
    Model,
    Offset,
    Parameter,
    PiezoGain,
    Place,
    PrandtlIshlinskii,
    Saturation,
    SecondMode,
    SecondOrder,
    SensorLag,
    Temperature,
)
from piezo_opt.errors import ModelError
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import Initial, Simulator, Substeps, simulate
from piezo_opt.simulation.compiler import find_compiler
from piezo_opt.simulation.engine import Ceiling, engine
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="compiles C: no compiler")

TIME = np.linspace(0.0, 119e-4, 120)
DRIVE = np.asarray(20.7 + 44.1 * np.sin(2 * np.pi * 250 * TIME), dtype=np.float64)
RECORD = Measurement(TIME, DRIVE, 1e-7 * DRIVE, period=4e-3)

BASE = PiezoGain() + BoucWen() + SecondOrder() + Offset()
MODELS: dict[str, Model] = {
    "no states": PiezoGain() + Offset(),
    "base": BASE,
    "all places": AmplifierLag() + Saturation() + BASE + Creep() + Friction() + SecondMode()
    + Drift() + Delay(),
    "jumping states": PiezoGain() + PrandtlIshlinskii() + SecondOrder(),
}  # fmt: skip


def opened(model: Model) -> Values:
    """Every gate away from its null, so that every effect acts."""
    values = Values.nominal(model)
    for gate in model.gates.values():
        typical = model.parameters[gate].typical
        assert typical is not None
        values = values.with_({gate: 0.5 * (typical[0] + typical[1]) or typical[1]})
    return values


@needs_compiler
@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("initial", list(Initial))
@pytest.mark.parametrize("name", MODELS)
def test_both_engines_give_the_same_numbers(name: str, initial: Initial, exact: bool) -> None:
    model = MODELS[name]
    values = opened(model)
    directions = tuple(n for n, p in model.parameters.items() if not p.fixed)
    runs = [
        Simulator(
            model, RECORD, values, directions=directions, initial=initial,
            substeps=Substeps(2e-5, 2.0, exact=exact), prefer_compiled=compiled,
        )
        for compiled in (True, False)
    ]  # fmt: skip
    assert [r.compiled for r in runs] == [True, False]
    (y, slopes), (other, other_slopes) = (r.with_sensitivities(values) for r in runs)
    assert np.isfinite(y).all()
    np.testing.assert_allclose(y, other, rtol=0, atol=1e-12 * np.ptp(y))
    for column, direction in enumerate(directions):
        size = np.abs(slopes[:, column]).max()
        np.testing.assert_allclose(
            slopes[:, column], other_slopes[:, column], rtol=0, atol=3e-11 * size, err_msg=direction
        )
    one, two = (r.response(values) for r in runs)
    sizes = np.abs(two.states).max(axis=0, initial=0.0)
    assert (np.abs(one.states - two.states) <= 1e-11 * sizes).all()
    assert one.state_names == two.state_names


RESTING = np.repeat([0.0, 31.0, 31.0, -4.0, 12.0, 12.0, 12.0, 40.0], 15)
"""A drive that stands still but for steps."""
WARMING = np.linspace(0.0, 3.0, 120) * (np.arange(120) > 40)


@needs_compiler
@pytest.mark.parametrize("between", [Between.HELD, Between.LINEAR])
@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("name", [*MODELS, "beside the drive"])
def test_what_is_left_out_while_the_drive_stands_still_changes_nothing(
    name: str, exact: bool, between: Between
) -> None:
    """Nor does a drive that stands still beside a channel that does not."""
    beside = {"temperature": WARMING}
    record = Measurement(TIME, RESTING, 1e-7 * RESTING, between=between, channels=beside)
    model = {**MODELS, "beside the drive": BASE + Temperature() + MainsPickup() + SensorLag()}[name]
    values = opened(model)
    directions = tuple(n for n, p in model.parameters.items() if not p.fixed)
    one, other = (
        Simulator(
            model, record, values, directions=directions, prefer_compiled=compiled,
            substeps=Substeps(4e-5, 9.0, exact=exact),
        ).with_sensitivities(values)
        for compiled in (True, False)
    )  # fmt: skip
    np.testing.assert_allclose(one[0], other[0], rtol=0, atol=1e-12 * np.ptp(other[0]))
    sizes = np.abs(other[1]).max(axis=0)
    assert (np.abs(one[1] - other[1]).max(axis=0) <= 3e-11 * sizes).all()


def test_the_virtual_machine_goes_over_the_ends_of_its_chunks() -> None:
    """A run of 11 000 sub-steps equals itself in one piece of 1 and of 3 sub-steps a sample."""
    model = PiezoGain() + BoucWen()
    time = np.linspace(0.0, 3.699, 3700)
    record = Measurement(time, 50.0 * np.sin(time * 9.0), time)
    values = Values.nominal(model)
    run = Simulator(model, record, values, substeps=Substeps(0.34e-3, 1e9), prefer_compiled=False)
    assert run.substeps(values) > 20 * 512
    whole = run.response(values)
    cuts = Simulator(
        model, record.slice(None, 0.5), values, substeps=Substeps(0.34e-3, 1e9),
        prefer_compiled=False,
    )  # fmt: skip
    np.testing.assert_array_equal(cuts.reading(values), whole.reading[:500])
    step = np.diff(whole.states[:, 0])
    assert np.abs(step).max() < 1e-7


@needs_compiler
def test_several_threads_may_share_a_simulator() -> None:
    model = BASE + Delay()
    directions = ("bouc_wen.beta", "delay.T")
    start = Values.nominal(model)
    run = Simulator(model, RECORD, start, directions=directions, substeps=Substeps(2e-5, 1e9))
    points = [
        start.with_({"bouc_wen.beta": 0.01 + 1e-3 * k, "delay.T": 1e-4 * (k % 5)})
        for k in range(60)
    ]
    alone = [run.with_sensitivities(p) for p in points]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(run.with_sensitivities, points))
    for (y, slopes), (y_alone, slopes_alone) in zip(together, alone, strict=True):
        np.testing.assert_array_equal(y, y_alone)
        np.testing.assert_array_equal(slopes, slopes_alone)
    assert np.ptp([y[-1] for y, _ in alone]) > 0


def test_threads_may_build_the_same_simulator_at_once() -> None:
    values = Values.nominal(BASE)

    def build(_: int) -> FloatArray:
        return Simulator(BASE, RECORD, values, substeps=Substeps(2e-5, 1e9)).reading(values)

    with ThreadPoolExecutor(6) as pool:
        readings = list(pool.map(build, range(12)))
    for reading in readings:
        np.testing.assert_array_equal(reading, readings[0])


@final
@dataclass(frozen=True)
class Bell(Effect):
    """Strain by an operation that C does not have.

        s += k erfinv(v / 1000)

    References: a user's own effect, 2026.
    """

    place = Place.STRAIN
    k = Parameter("m", "strength", nominal=0.0, bounds=(-1.0, 1.0), null=0.0)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement."""
        return Equations(gives=p.k * ca.erfinv(chain.drive.value / 1000.0))


def test_an_operation_that_c_does_not_have_is_left_to_casadi() -> None:
    model = PiezoGain() + Bell()
    run = Simulator(model, RECORD, {"piezo_gain.d": 1e-7, "bell.k": 1e-6})
    assert not run.compiled
    from scipy.special import erfinv

    expected = 1e-7 * DRIVE + 1e-6 * erfinv(DRIVE / 1000.0)
    reading = run.reading({"piezo_gain.d": 1e-7, "bell.k": 1e-6})
    np.testing.assert_allclose(reading, expected, rtol=1e-12)


@needs_compiler
@pytest.mark.parametrize("sensitive", [False, True])
def test_a_run_ends_where_it_has_missed_the_record_by_more_than_asked(sensitive: bool) -> None:
    values = Values.nominal(BASE)
    whole = Simulator(BASE, RECORD, values, directions=("piezo_gain.d",)).reading(values)
    off = np.full(TIME.size, 1e-9)
    off[50:] = 3e-9
    missed = RECORD.with_(position=whole - off, period=None, startup=TIME[10])
    run = Simulator(BASE, missed, values, directions=("piezo_gain.d",))
    first = int(missed.counted.argmax())
    assert 5 < first < 15

    def reading(most: float | None) -> FloatArray:
        return run.with_sensitivities(values, most)[0] if sensitive else run.reading(values, most)

    free = reading(None)
    np.testing.assert_allclose(free, whole, rtol=0, atol=1e-4 * np.ptp(whole))
    squares = np.cumsum(np.where(missed.counted, (free - missed.position) ** 2, 0.0))
    for most in (0.0, 0.5 * squares[49], 1.0001 * squares[49], 0.9 * squares[-1]):
        ended = int(np.argmax(squares > most))
        given_up = reading(float(most))
        np.testing.assert_array_equal(given_up[: ended + 1], free[: ended + 1])
        assert np.isnan(given_up[ended + 1 :]).all()
    np.testing.assert_array_equal(reading(1.0001 * squares[-1]), free)


@needs_compiler
def test_a_run_that_diverges_ends_at_once_under_any_ceiling() -> None:
    values = Values.nominal(BASE)
    run = Simulator(BASE, RECORD, values)
    for gain in (1e307, np.nan):
        seen = run.with_sensitivities({**values, "piezo_gain.d": gain}, 1e300)[0]
        assert np.isnan(seen[5:]).all()
    free = run.system.state_names.index("second_order.x")
    made = engine(run.system, ())
    segment = run.segment(values)
    start = np.zeros(len(run.system.state_names))
    start[free] = np.nan
    # Nothing is done once it is known: the state at the end is the one from which it began.
    p = np.array([values[n] for n in run.system.parameter_names])
    nothing = Ceiling(np.zeros(TIME.size), 1e300)
    cut = run.accuracy.substeps.of(segment)
    ended = made.run(segment, cut, p, start, np.zeros((start.size, 0)), ceiling=nothing)
    np.testing.assert_array_equal(ended.last, start)


def test_an_engine_refuses_arrays_of_the_wrong_size_instead_of_reading_beyond_them() -> None:
    values = Values.nominal(BASE)
    run = Simulator(BASE, RECORD, values, substeps=Substeps(1e-4, 1e9))
    segment, cut = run.segment(values), run.accuracy.substeps.of(run.segment(values))
    made = engine(run.system, ())
    p, x, s = np.zeros(len(run.system.parameter_names)), np.zeros(3), np.zeros((3, 0))
    if made.compiled:
        for wrong in (
            (segment, cut[:-1], p, x, s),
            (segment, cut, p[:-1], x, s),
            (segment, cut, p, x[:-1], s),
            (segment, cut, p, x, np.zeros((3, 1))),
        ):
            with pytest.raises(ValueError, match=r"shape|needed"):
                made.run(*wrong)
        with pytest.raises(ValueError, match="needed"):
            made.start(segment, p, np.zeros(4))


def test_a_start_is_rest_plus_the_deviation_carried_downstream() -> None:
    values = Values.nominal(BASE).with_({"initial.bouc_wen.h": 3e-7})
    response = simulate(BASE, RECORD, values)
    first = dict(zip(response.state_names, response.states[0], strict=True))
    assert first["bouc_wen.h"] == 3e-7
    assert first["second_order.x"] == pytest.approx(values["piezo_gain.d"] * DRIVE[0] - 3e-7)
    assert first["second_order.w"] == 0.0
    assert response.reading[0] == first["second_order.x"] + values["offset.y0"]


def test_a_response_holds_what_was_asked_for() -> None:
    response = simulate(BASE, RECORD, sensitivities=["offset.y0", "piezo_gain.d"])
    assert response.directions == ("offset.y0", "piezo_gain.d")
    np.testing.assert_array_equal(response.sensitivities[:, 0], 1.0)
    np.testing.assert_array_equal(response.time, TIME)
    assert response.states.shape == (120, 3)
    assert 0 < response.accuracy.error < 5e-5 * np.ptp(response.reading)
    assert simulate(BASE, RECORD).sensitivities.shape == (120, 0)
    assert simulate(BASE, RECORD, prefer_compiled=False).compiled is False


@pytest.mark.parametrize(
    "name", ["bouc_wen.delta", "initial.bouc_wen.z", "initial.creep.z[0]", "offset.y1[0]", "d"]
)
def test_a_value_for_nothing_is_refused_by_name(name: str) -> None:
    with pytest.raises(ModelError, match="no parameter or initial state") as caught:
        simulate(BASE, RECORD, {name: 1.0})
    assert f"'{name}'" in str(caught.value)


def test_values_of_a_record_and_of_elements_are_known() -> None:
    simulate(BASE + Creep(elements=2), RECORD, {"initial.creep.z[1]": 1e-8, "offset.y0[3]": 1e-7})


def test_a_missing_value_is_asked_for_by_name() -> None:
    run = Simulator(BASE, RECORD, Values.nominal(BASE))
    with pytest.raises(ModelError, match=r"piezo_gain\.d"):
        run.reading({})


def test_a_constant_of_the_code_cannot_be_changed_behind_its_back() -> None:
    values = Values.nominal(BASE)
    run = Simulator(BASE, RECORD, values)
    with pytest.raises(ModelError, match=r"bouc_wen\.n.*runtime"):
        run.reading(values.with_({"bouc_wen.n": 1.5}))
    # Given from the start, or named, it is a parameter like any other.
    other = values.with_({"bouc_wen.n": 1.5})
    given = Simulator(BASE, RECORD, other).reading(other)
    named = Simulator(BASE, RECORD, values, runtime=("bouc_wen.n",))
    assert np.abs(named.reading(other) - given).max() < 1e-4 * np.ptp(given)
    assert np.abs(named.reading(values) - given).max() > 1e-4 * np.ptp(given)


def test_where_there_is_no_periodic_state_the_reading_is_not_a_number() -> None:
    # Negative damping grows from period to period; no made-up state is returned.
    values = Values.nominal(BASE).with_({"second_order.zeta": -40.0, "second_order.omega": 1e7})
    run = Simulator(
        BASE, RECORD, values, initial=Initial.PERIODIC, directions=("piezo_gain.d",),
        substeps=Substeps(1e-4, 1e9),
    )  # fmt: skip
    with np.errstate(all="ignore"):
        reading, slopes = run.with_sensitivities(values)
    assert np.isnan(reading).all()
    assert np.isnan(slopes).all()


def test_the_first_call_does_not_change_the_second() -> None:
    values = Values.nominal(BASE)
    for initial, between in ((Initial.REST, Between.HELD), (Initial.PERIODIC, Between.LINEAR)):
        record = RECORD.with_(between=between)
        run = Simulator(BASE, record, values, initial=initial, directions=("bouc_wen.beta",))
        first = run.reading(values)
        run.with_sensitivities(values.with_({"bouc_wen.beta": 0.3}))
        np.testing.assert_allclose(run.reading(values), first, rtol=0, atol=1e-12 * np.ptp(first))


@needs_compiler
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="SSE's own habit")
def test_what_has_faded_away_is_zero_and_the_caller_keeps_his_smallest_numbers() -> None:
    model = PiezoGain() + SensorLag()
    start = f"initial.{assemble(model).state_names[0]}"
    values = Values.nominal(model).with_({"sensor_lag.tau": 5e-6, "sensor_lag.share": 1.0})
    record = Measurement(TIME, DRIVE, 1e-7 * DRIVE)
    _, slope = Simulator(model, record, values, directions=(start,)).with_sensitivities(values)
    assert slope[0, 0] == 1.0
    # On its way to nothing it passes what no normal number holds.
    ratio = np.abs(slope[:, 0])
    assert ratio[60] > 0.0
    assert ratio[-1] == 0.0
    smallest = np.finfo(float).tiny
    assert not ((ratio > 0.0) & (ratio < smallest)).any()
    assert np.multiply(smallest, 0.25) > 0.0


@pytest.mark.parametrize("exact", [False, True])
def test_an_interrupt_at_any_moment_is_one(monkeypatch: pytest.MonkeyPatch, exact: bool) -> None:
    """NumPy's own conversion of CasADi's numbers makes a SystemError of it."""
    model = PiezoGain() + Creep() + SecondOrder()
    values = opened(model)
    time = np.arange(50) / 1e3
    record = Measurement(time, 50.0 * np.sin(40.0 * time), time, allow_saturated=True)
    run = Simulator(
        model, record, values, substeps=Substeps(1e-3, 1e9, exact=exact), prefer_compiled=False
    )
    run.reading(values)

    def interrupted(_: ca.DM) -> object:
        raise KeyboardInterrupt

    monkeypatch.setattr(ca.DM, "full", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run.reading(values)
