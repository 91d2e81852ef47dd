"""The time axis: steps of a held drive, exact delays, gaps, band-limited drives, periods."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import pytest
from numpy.typing import NDArray

from piezo_opt.effects import (
    BoucWen,
    Chain,
    Creep,
    Delay,
    Drift,
    Effect,
    Equations,
    Model,
    Parameter,
    PiezoGain,
    Place,
    SecondOrder,
    SensorLag,
    State,
)
from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import Initial, Simulator, Substeps
from piezo_opt.simulation.schedule import corners, cycle, led_in, segments
from piezo_opt.values import Values

FloatArray = NDArray[Any]

QUASI_STATIC = PiezoGain() + BoucWen()
MECHANICS = QUASI_STATIC + SecondOrder()
STEP = 1e-4


def record(
    time: FloatArray, drive: FloatArray, between: Between = Between.LINEAR, **more: Any
) -> Measurement:
    return Measurement(time, drive, 1e-7 * drive, between=between, **more)


def simulator(
    model: Model, given: Measurement, values: Mapping[str, float], **more: Any
) -> Simulator:
    # No whole number of sub-steps a sample: a differential quotient must not meet one more.
    substeps = Substeps(STEP / 40.5, 1e9)
    return Simulator(model, given, values, substeps=substeps, **more)


def close(one: FloatArray, other: FloatArray, share: float) -> None:
    np.testing.assert_allclose(one, other, rtol=0, atol=share * np.ptp(other))


# --- between the samples --------------------------------------------------------------------


def test_a_rate_independent_loop_closes_the_same_held_or_linear() -> None:
    rng = np.random.default_rng(0)
    drive = np.concatenate([[0.0], rng.uniform(-50, 80, 40)])
    time = np.arange(41) * STEP
    values = Values.nominal(QUASI_STATIC).with_({"bouc_wen.beta": 0.04, "bouc_wen.gamma": 0.01})
    late = np.where(np.arange(41) > 20, time + 5.0, time)

    def reading(at: FloatArray, between: Between) -> FloatArray:
        cut = Substeps(STEP, 0.5)
        return Simulator(QUASI_STATIC, record(at, drive, between), values, substeps=cut).reading(
            values
        )

    straight = reading(time, Between.LINEAR)
    close(reading(time, Between.HELD), straight, 1e-9)
    # A stretch of rest in between changes nothing: the drive is held, and the loop with it.
    close(reading(late, Between.HELD), straight, 1e-9)


def test_a_held_drive_stands_still_between_its_steps() -> None:
    time = np.arange(9) * STEP
    drive = np.array([0.0, 10.0, 10.0, -20.0, 0.0, 0.0, 5.0, 0.0, 1.0])
    axis = corners(record(time, drive, Between.HELD), ())
    inside = np.linspace(0.0, 0.998, 200)
    for k in range(8):
        np.testing.assert_array_equal(
            np.interp(time[k] + inside * STEP, axis.time, axis.value), drive[k]
        )
    np.testing.assert_array_equal(np.interp(time, axis.time, axis.value), drive)


def test_a_time_axis_is_cut_once_a_record_and_gone_with_it() -> None:
    time = np.linspace(0.0, 1.0, 50)
    used = record(time, multisine(time))
    values = Values.nominal(MECHANICS)
    first, other = (simulator(model, used, values) for model in (QUASI_STATIC, MECHANICS))
    assert first.segment(values) is other.segment(values)
    seen = weakref.ref(corners(used, ()))
    assert seen() is corners(used, ())
    del used, first, other
    gc.collect()
    assert seen() is None


def test_the_segments_of_a_held_drive_cut_flats_coarsely_and_steps_finely() -> None:
    time = np.arange(50) * STEP
    drive = np.where(np.arange(50) // 5 % 2 == 1, 60.0, 0.0)
    values = Values.nominal(QUASI_STATIC).with_({"bouc_wen.beta": 0.08})
    run = Simulator(QUASI_STATIC, record(time, drive, Between.HELD), values)
    segment = run.segment(values)
    cut = run.accuracy.substeps.of(segment)
    steps = segment.slope != 0.0
    assert steps.sum() == 9
    # Looked at are flats, as the least and as the median slope, and a step.
    assert steps[list(segment.by_slope)].tolist() == [False, False, True]
    # None, a sample, and one that is parted into step and flat; rounded stamps have more.
    assert segment.even.lengths == 4 < segment.lengths
    assert cut[~steps].max() <= 2
    assert cut[steps].min() >= 4


@pytest.mark.parametrize("delay", [None, 0.7e-3])
def test_travel_is_that_of_the_measured_motion_whatever_the_delay(delay: float | None) -> None:
    """A delayed chain is cut elsewhere, but what a sensor shows it shows at that time."""
    time = np.arange(60) * STEP
    at_once = np.where(np.arange(60) < 30, 0.0, 1e-6)
    shown = record(time, np.linspace(0.0, 60.0, 60))
    shown = shown.with_(position=at_once, allow_saturated=True)
    segment = segments(corners(shown, ()), time, delay)
    middle = segment.time + 0.5 * segment.length
    moving = segment.travel > 0.0
    assert (np.abs(middle[moving] - 29.5 * STEP) < 1.5 * STEP).all()
    assert segment.travel.sum() == pytest.approx(3e-6)


def test_travel_goes_on_before_a_periodic_record() -> None:
    once = repeated(2, Between.LINEAR)
    assert once.period is not None
    drive = corners(once, ())
    assert drive.closed is not None
    led = led_in(drive, 2)
    assert (np.diff(led.way) >= 0.0).all()
    assert np.ptp(led.way[led.channel_time <= 0.0]) == pytest.approx(2.0 * drive.closed.way[-1])


def test_gaps_and_uneven_time_are_straight_lines_like_any_other() -> None:
    values = Values.nominal(MECHANICS)
    dense_time = np.arange(200) * STEP
    corner = np.array([0, 3, 4, 11, 50, 52, 90, 199])
    drive = np.interp(
        dense_time, dense_time[corner], [0.0, 30.0, -10.0, 5.0, 50.0, 20.0, 80.0, 0.0]
    )
    dense = simulator(MECHANICS, record(dense_time, drive), values).reading(values)
    sparse = record(dense_time[corner], drive[corner])
    close(simulator(MECHANICS, sparse, values).reading(values), dense[corner], 1e-9)
    # The clock's zero is nobody's business.
    later = record(dense_time[corner] + 1e4, drive[corner])
    close(simulator(MECHANICS, later, values).reading(values), dense[corner], 1e-6)


# --- band-limited ---------------------------------------------------------------------------

TONES = (10.0, 70.0, 130.0, 200.0)
RATE = 1e3
RESONANCE = {"piezo_gain.d": 1e-7, "second_order.omega": 2 * np.pi * 180, "second_order.zeta": 0.1}


def multisine(time: FloatArray) -> FloatArray:
    return np.asarray(sum(np.cos(2 * np.pi * f * time + f) for f in TONES)) * 10.0


def steady(time: FloatArray) -> FloatArray:
    """Gain and mechanics in the steady state of the multisine: every tone by itself."""
    omega, zeta = RESONANCE["second_order.omega"], RESONANCE["second_order.zeta"]
    total = np.zeros_like(time)
    for f in TONES:
        s = 2j * np.pi * f
        answer = omega**2 / (s**2 + 2 * zeta * omega * s + omega**2)
        total += np.real(answer * np.exp(1j * (2 * np.pi * f * time + f)))
    return 1e-7 * 10.0 * total


def test_a_band_limited_drive_is_the_multisine_and_not_a_polygon() -> None:
    time = np.arange(100) / RATE
    model = PiezoGain() + SecondOrder()
    errors = {}
    for between in (Between.BANDLIMITED, Between.LINEAR, Between.HELD):
        given = record(time, multisine(time), between, period=0.1)
        run = Simulator(
            model, given, RESONANCE, initial=Initial.PERIODIC, substeps=Substeps(1e-4, 1e9)
        )
        reading = run.reading(RESONANCE)
        errors[between] = np.abs(reading - steady(time)).max() / np.ptp(steady(time))
    assert errors[Between.BANDLIMITED] < 5e-4
    assert errors[Between.LINEAR] > 3e-2
    assert errors[Between.HELD] > 5e-2


def test_a_band_limited_drive_without_a_period_is_the_multisine_away_from_its_ends() -> None:
    time = np.arange(400) / RATE
    axis = corners(record(time, multisine(time), Between.BANDLIMITED), ())
    inside = (axis.time > 0.1) & (axis.time < 0.29)
    assert inside.sum() > 3000
    close(axis.value[inside], multisine(axis.time[inside]), 1e-3)
    np.testing.assert_allclose(np.interp(time, axis.time, axis.value), multisine(time), atol=1e-2)


def test_a_band_limited_drive_needs_even_sampling() -> None:
    time = np.arange(40) / RATE
    time[20:] += 0.5 / RATE
    with pytest.raises(InputError, match="even sampling"):
        corners(record(time, multisine(time), Between.BANDLIMITED), ())


# --- delay ----------------------------------------------------------------------------------

DELAYED = MECHANICS + Delay()
TIME = np.arange(60) * STEP
DRIVE = 20.0 + 50.0 * np.sin(2 * np.pi * 600 * TIME) * np.exp(-200 * TIME)


@pytest.mark.parametrize("delay", [0.0, 0.37 * STEP, STEP, 3 * STEP, 7.25 * STEP])
def test_a_delay_is_the_shifted_response(delay: float) -> None:
    values = Values.nominal(DELAYED).with_({"delay.T": delay})
    run = simulator(DELAYED, record(TIME, DRIVE), values)
    # The same drive, densely sampled, simulated without a delay and read earlier.
    per = 100
    dense = np.arange(59 * per + 1) * (STEP / per)
    whole = record(dense, np.interp(dense, TIME, DRIVE))
    undelayed = Simulator(MECHANICS, whole, values, substeps=Substeps(STEP / per, 1e9))
    response = undelayed.reading(values)
    shift = round(delay / STEP * per)
    index = np.arange(60) * per - shift
    expected = np.where(index >= 0, response[np.maximum(index, 0)], response[0])
    close(run.reading(values), expected, 1e-7)


def test_a_delay_longer_than_the_record_leaves_the_start() -> None:
    values = Values.nominal(DELAYED).with_({"delay.T": 1.0})
    reading = simulator(DELAYED, record(TIME, DRIVE), values).reading(values)
    np.testing.assert_allclose(reading, 1e-7 * DRIVE[0], rtol=1e-9)


@pytest.mark.parametrize("between", list(Between))
@pytest.mark.parametrize("delay", [0.0, 0.37 * STEP, STEP, 3 * STEP])
def test_the_derivative_by_the_delay_is_exact(delay: float, between: Between) -> None:
    """At whole steps, corners pass under the readings: the derivative is that of longer delays."""
    values = Values.nominal(DELAYED).with_({"delay.T": delay})
    # Held drives: read behind the steps, not on their ramps of a thousandth of a sample.
    late = 0.1 * STEP if between is Between.HELD else 0.0
    values = values.with_({"delay.T": delay + late})
    run = simulator(DELAYED, record(TIME, DRIVE, between), values, directions=("delay.T",))
    reading, slopes = run.with_sensitivities(values)
    h = 1e-5 * STEP

    def at(shift: float) -> FloatArray:
        return run.reading(values.with_({"delay.T": values["delay.T"] + shift}))

    difference = (4.0 * at(h) - at(2 * h) - 3.0 * reading) / (2 * h)
    assert np.abs(slopes).max() * STEP > 0.05 * np.ptp(reading)
    close(slopes[:, 0], difference, 1e-5)
    # Later means smaller in time: the chain rule with the motion of the reading itself.
    if delay == 0.37 * STEP and between is Between.LINEAR:
        velocity = run.response(values).states[:, run.system.state_names.index("second_order.w")]
        close(slopes[1:, 0], -velocity[1:], 1e-6)


def test_drift_goes_by_the_clock_of_the_reading_and_not_of_the_drive() -> None:
    model = DELAYED + Drift()
    values = Values.nominal(model).with_({"delay.T": 2.5 * STEP, "drift.rate": 1e-4})
    directions = ("delay.T", "drift.rate")
    run = simulator(model, record(TIME, DRIVE), values, directions=directions)
    still = simulator(DELAYED, record(TIME, DRIVE), values, directions=("delay.T",))
    reading, slopes = run.with_sensitivities(values)
    without, by_delay = still.with_sensitivities(values)
    close(reading - without, 1e-4 * TIME, 1e-6)
    close(slopes[:, 1], TIME, 1e-6)
    close(slopes[:, 0], by_delay[:, 0], 1e-9)


def test_a_corner_and_a_reading_at_one_instant_are_kept_apart_under_a_delay() -> None:
    axis = corners(record(TIME, DRIVE), ())
    at = np.asarray(TIME, dtype=np.float64)
    plain, delayed = segments(axis, at), segments(axis, at, 0.0)
    assert plain.length.size == 60
    assert delayed.length.size == 60 + 59
    assert plain.readings == delayed.readings == 60
    assert delayed.length.sum() == pytest.approx(TIME[-1])


# --- channels -------------------------------------------------------------------------------


@final
@dataclass(frozen=True)
class Warmth(Effect):
    """Strain of a body that follows the recorded temperature with a lag.

        tau w' = T - w,     s += k (w - 293.15) + rate_gain T'

    References: a user's own effect, 2026.
    """

    place = Place.STRAIN
    requires = ("channel:temperature",)
    w = State("K", "temperature of the body")
    k = Parameter("m/K", "expansion", nominal=0.0, bounds=(-1.0, 1.0), null=0.0)
    tau = Parameter("s", "lag", nominal=1e-3, bounds=(1e-6, 1e3))
    rate_gain = Parameter("m*s/K", "gain of the rate", nominal=0.0, bounds=(-1.0, 1.0))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement."""
        recorded = chain.channels["temperature"]
        return Equations(
            gives=p.k * (x.w - 293.15) + p.rate_gain * recorded.rate,
            moves={"w": (recorded.value - x.w) / p.tau},
            starts={"w": recorded.value},
        )


def test_a_recorded_channel_moves_on_straight_lines_and_its_rate_is_known() -> None:
    model = PiezoGain() + Warmth()
    values = Values(
        {"piezo_gain.d": 1e-7, "warmth.k": 1e-6, "warmth.tau": 2e-3, "warmth.rate_gain": 1e-9}
    )
    temperature = 293.15 + 100.0 * np.minimum(TIME, 30 * STEP)
    drive = np.where(np.arange(60) % 2 == 0, 0.0, 1.0)
    given = record(TIME, drive, channels={"temperature": temperature})
    run = simulator(model, given, values, directions=("warmth.tau", "warmth.k"))
    reading, slopes = run.with_sensitivities(values)

    def lagged(tau: float) -> FloatArray:
        """A lag behind a ramp that stops after 30 samples."""
        rest = np.maximum(0.0, TIME - 30 * STEP)
        until = np.minimum(TIME, 30 * STEP)
        behind = 100.0 * (until - tau * (1.0 - np.exp(-until / tau)))
        top = 100.0 * 30 * STEP
        return np.asarray(top + (behind - top) * np.exp(-rest / tau))

    rate = np.where(np.arange(60) <= 30, 100.0, 0.0)
    rate[0] = 0.0  # at the first sample nothing has moved yet
    expected = 1e-7 * drive + 1e-6 * lagged(2e-3) + 1e-9 * rate
    close(reading, expected, 1e-7)
    close(slopes[:, 1], lagged(2e-3), 1e-7)
    close(slopes[:, 0], 1e-6 * (lagged(2.0001e-3) - lagged(1.9999e-3)) / 2e-7, 1e-5)


def test_a_channel_is_read_at_the_time_of_the_reading_not_of_the_delayed_drive() -> None:
    model = PiezoGain() + Delay() + Warmth()
    values = Values(
        {"piezo_gain.d": 0.0, "delay.T": 4.5 * STEP, "warmth.k": 1e-6, "warmth.tau": 1e-6,
         "warmth.rate_gain": 0.0}
    )  # fmt: skip
    temperature = 293.15 + 5.0 * np.sin(2 * np.pi * 300 * TIME)
    given = record(TIME, DRIVE, channels={"temperature": temperature})
    run = Simulator(model, given, values, substeps=Substeps(1e-6, 1e9), directions=("delay.T",))
    reading, slopes = run.with_sensitivities(values)
    # The lag of 1 us behind the channel is all that differs.
    close(reading, 1e-6 * (temperature - 293.15), 1e-2)
    assert np.abs(slopes).max() * STEP < 1e-2 * np.ptp(reading)


def test_a_missing_channel_is_refused_by_name() -> None:
    model = PiezoGain() + Warmth()
    with pytest.raises(InputError, match="temperature"):
        simulator(model, record(TIME, DRIVE), Values.nominal(model))


# --- periodic steady state ------------------------------------------------------------------

PERIODIC = QUASI_STATIC + Creep(elements=1) + SecondOrder() + SensorLag()
PERIODIC_VALUES = Values.nominal(PERIODIC).with_(
    {
        "creep.c": 0.1, "creep.tau": 4e-3, "sensor_lag.share": 1.0, "sensor_lag.tau": 3e-4,
        "bouc_wen.beta": 0.05, "bouc_wen.gamma": 0.01, "second_order.omega": 4e3,
        "second_order.zeta": 0.1,
    }
)  # fmt: skip
SAMPLES = 20
PERIOD = SAMPLES * STEP


def repeated(periods: int, between: Between, cut: int = 0) -> Measurement:
    time = np.arange(periods * SAMPLES - cut) * STEP
    drive = (
        30.0 + 25.0 * np.sin(2 * np.pi * time / PERIOD) + 9.0 * np.cos(6 * np.pi * time / PERIOD)
    )
    return record(time, drive, between, period=PERIOD)


@pytest.mark.parametrize("between", list(Between))
def test_the_periodic_state_is_where_a_long_run_ends(between: Between) -> None:
    values = PERIODIC_VALUES
    long = simulator(PERIODIC, repeated(60, between), values).reading(values)
    # One period is enough to know it, also where the record ends before the period closes.
    for periods in (1, 3):
        given = repeated(periods, between)
        run = simulator(PERIODIC, given, values, initial=Initial.PERIODIC)
        close(run.reading(values), long[-periods * SAMPLES :], 2e-6)
    rested = simulator(PERIODIC, repeated(1, between), values).reading(values)
    assert np.abs(rested - long[-SAMPLES:]).max() > 0.02 * np.ptp(long)


@pytest.mark.parametrize("delay", [0.0, 0.43 * STEP, 3 * STEP, 33.3 * STEP])
def test_a_delayed_chain_was_periodic_before_the_record_began(delay: float) -> None:
    model = PERIODIC + Delay()
    values = PERIODIC_VALUES.with_({"delay.T": delay})
    long = simulator(model, repeated(60, Between.LINEAR), values).reading(values)
    run = simulator(
        model, repeated(2, Between.LINEAR), values, initial=Initial.PERIODIC,
        directions=("delay.T",),
    )  # fmt: skip
    reading, slopes = run.with_sensitivities(values)
    np.testing.assert_allclose(reading, run.reading(values), rtol=1e-12)
    close(reading, long[-2 * SAMPLES :], 2e-6)
    h = 1e-5 * STEP
    ahead, further = (run.reading(values.with_({"delay.T": delay + k * h})) for k in (1, 2))
    close(slopes[:, 0], (4.0 * ahead - further - 3.0 * reading) / (2 * h), 1e-4)


def test_the_derivative_of_the_periodic_reading_is_exact() -> None:
    directions = tuple(n for n, p in PERIODIC.parameters.items() if not p.fixed)
    values = PERIODIC_VALUES
    run = simulator(
        PERIODIC, repeated(2, Between.LINEAR), values, initial=Initial.PERIODIC,
        directions=directions,
    )  # fmt: skip
    reading, slopes = run.with_sensitivities(values)
    for column, name in enumerate(directions):
        size = abs(values[name]) or PERIODIC.parameters[name].scale
        up = run.reading(values.with_({name: values[name] + 1e-5 * size}))
        down = run.reading(values.with_({name: values[name] - 1e-5 * size}))
        close(slopes[:, column] * size, (up - down) / 2e-5, 1e-5)
        assert np.ptp(slopes[:, column]) * size > 1e-4 * np.ptp(reading), name


def test_a_memory_that_nothing_fades_keeps_the_start_nearest_to_rest() -> None:
    # beta = gamma = 0: h' = alpha v' has a periodic solution for every start.
    model = PiezoGain() + BoucWen()
    values = Values.nominal(model).with_({"bouc_wen.beta": 0.0, "bouc_wen.gamma": 0.0})
    given = repeated(1, Between.LINEAR)
    reading = simulator(model, given, values, initial=Initial.PERIODIC).reading(values)
    expected = 1e-7 * given.drive - values["bouc_wen.alpha"] * (given.drive - given.drive[0])
    close(reading, expected, 1e-9)


def test_without_a_period_there_is_no_periodic_state() -> None:
    values = PERIODIC_VALUES
    with pytest.raises(InputError, match="period"):
        simulator(PERIODIC, record(TIME, DRIVE), values, initial=Initial.PERIODIC)
    axis = corners(record(TIME, DRIVE), ())
    with pytest.raises(ValueError, match="no period"):
        cycle(axis, 1.0)
    with pytest.raises(ValueError, match="no period"):
        led_in(axis, 1)
