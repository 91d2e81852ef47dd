"""The best drive for parameters: known answers, and predictions that come true."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import BoucWen, DeadZone, Offset, PiezoGain, SecondOrder
from piezo_opt.errors import InputError
from piezo_opt.measurement import FloatArray
from piezo_opt.signals import Corners, Criterion, Mixed, Tones, best_for
from piezo_opt.signals.answer import Answer, draws
from piezo_opt.signals.families import Room
from piezo_opt.signals.information import deviations, merit, worth
from piezo_opt.signals.planning import slow_triangle
from piezo_opt.signals.timing import timed
from problems import hidden_effect, thesis_loop, thesis_vibration

NOISE = 20e-9


@pytest.fixture(scope="module")
def line() -> po.Fit:
    """A gain and an offset, fitted to a noisy sine."""
    time = np.arange(400) / 200.0
    drive = 40.0 - 40.0 * np.cos(2.0 * np.pi * time)
    noise = NOISE * np.random.default_rng(0).normal(size=time.size)
    record = po.Measurement(time, drive, 1e-7 * drive + 3e-7 + noise)
    return po.solve(po.Identification(PiezoGain() + Offset(), record))


TRUTH = {
    "piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 2e-2,
    "bouc_wen.gamma": -5e-3, "second_order.omega": 900.0, "second_order.zeta": 0.04,
    "offset.y0": 2e-7,
}  # fmt: skip
MODEL = PiezoGain() + BoucWen() + SecondOrder() + Offset()


@pytest.fixture(scope="module")
def loop() -> po.Fit:
    """Hysteresis and a resonance, fitted to a triangle and two steps."""
    time = np.arange(3000) / 2000.0
    corners = ([0, 0.4, 0.8, 1.0, 1.001, 1.2, 1.201, 1.5], [0, 100, 0, 0, 30, 30, 10, 10])
    drive = np.interp(time, *corners)
    record = po.Measurement(time, drive, drive, between=po.Between.HELD, allow_saturated=True)
    clean = po.simulate(MODEL, record, TRUTH).reading
    noise = NOISE * np.random.default_rng(1).normal(size=time.size)
    return po.solve(po.Identification(MODEL, record.with_(position=clean + noise)))


def test_deviations_of_a_straight_line(line: po.Fit) -> None:
    """sigma / sqrt(sum (u - mean u)^2), the oldest of known answers."""
    answer = Answer(line, 200.0)
    values = np.linspace(0.0, 50.0, 333) ** 1.3
    told = deviations(answer, values, ("piezo_gain.d",), NOISE)
    assert told is not None
    exact = NOISE / np.sqrt(np.sum((values - values.mean()) ** 2))
    assert told["piezo_gain.d"] == pytest.approx(exact, rel=1e-9)
    assert deviations(answer, np.full(50, 3.0), ("piezo_gain.d",), NOISE) is None


def test_best_drive_for_a_slope_is_both_ends(line: po.Fit) -> None:
    """Half of the time at either end: sigma / (range sqrt(N) / 2)."""
    told = best_for(line, ["piezo_gain.d"], noise=NOISE, evaluations=200, families=(Corners(2),))
    bound = NOISE / (80.0 * np.sqrt(400.0) / 2.0)
    assert bound <= told.expected["piezo_gain.d"] < 1.05 * bound
    # A triangle's variance is a third of that.
    assert told.gain == pytest.approx(np.sqrt(3.0), rel=0.05)


def test_what_is_predicted_comes_out(loop: po.Fit) -> None:
    """Deviations of forty fits to records of the advised drive, within 20 % of those foretold."""
    told = best_for(loop, noise=NOISE, evaluations=40)
    assert told.gain > 3.0
    record = Answer(loop, told.drive.rate).record(told.drive.values)
    # The frequency will be known to a hundred-thousandth: so must the plant be simulated.
    clean = po.simulate(MODEL, record, TRUTH, tolerance=1e-7).reading
    rng = np.random.default_rng(5)
    missed = []
    for _ in range(40):
        noisy = record.with_(position=clean + NOISE * rng.normal(size=clean.size))
        fit = po.solve(po.Identification(MODEL, noisy, values=TRUTH))
        missed.append([(fit.values[n] - TRUTH[n]) / told.expected[n] for n in told.parameters])
    assert np.sqrt(np.mean(np.square(missed))) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("problem", [hidden_effect, thesis_vibration])
def test_three_times_better_than_a_triangle_without_mechanics_too(problem: ModuleType) -> None:
    """Where a single slow stroke tells most of what there is."""
    told = best_for(po.solve(problem.question()))
    assert told.gain > 3.0


def test_three_times_better_than_a_triangle_on_the_thesis_loop() -> None:
    fit = po.solve(thesis_loop.question())
    told = best_for(fit, evaluations=120)
    assert told.gain > 3.0
    assert told.drive.low >= -1e-9
    assert told.drive.high <= 125.0 + 1e-9
    assert told.drive.duration == pytest.approx(51.0)
    assert "times better than from a triangle" in str(told)
    low, high = told.over_draws["bouc_wen.beta"]
    assert low <= told.expected["bouc_wen.beta"] <= high


def test_a_fit_without_parameters_has_no_best_drive(line: po.Fit) -> None:
    """An offset belongs to its record: a drive is for it only where it is named."""
    fit = po.solve(replace(line.question, fixed={"piezo_gain.d": 1e-7}))
    with pytest.raises(InputError, match="estimates nothing that all records share"):
        best_for(fit, noise=NOISE)
    told = best_for(fit, ["offset.y0"], noise=NOISE, evaluations=0)
    assert told.expected["offset.y0"] == pytest.approx(NOISE / np.sqrt(400.0), rel=1e-6)


def test_limits_and_seed(loop: po.Fit) -> None:
    asked = {
        "noise": NOISE, "slew": 3000.0, "evaluations": 12, "stroke": (-1e-6, 9e-6), "possible": 1,
    }  # fmt: skip
    told = best_for(loop, ["second_order.zeta"], **asked)  # type: ignore[arg-type]
    assert told.drive.slew <= 3000.0 * (1.0 + 1e-9)
    reading = Answer(loop, told.drive.rate).sharp(told.drive.values)
    assert reading.max() <= 9e-6 * 1.001
    again = best_for(loop, ["second_order.zeta"], **asked)  # type: ignore[arg-type]
    np.testing.assert_array_equal(again.drive.values, told.drive.values)


def test_draws_are_what_the_fit_thinks_possible(loop: po.Fit) -> None:
    answer = Answer(loop, 2000.0)
    many = draws(answer, 801, 0)
    assert many[0] == {}
    for name in ("bouc_wen.beta", "second_order.omega"):
        values = np.array([one[name] for one in many[1:]])
        assert values.mean() == pytest.approx(loop.values[name], rel=1e-9)
        # Clipped at two deviations, a normal distribution keeps 0.96 of its own.
        assert values.std() == pytest.approx(0.96 * loop.std[name], rel=0.1)
    together = np.array([[one["piezo_gain.d"], one["bouc_wen.alpha"]] for one in many[1:]])
    expected = loop.correlation[
        loop.names.index("piezo_gain.d"), loop.names.index("bouc_wen.alpha")
    ]
    assert np.corrcoef(together.T)[0, 1] == pytest.approx(expected, abs=0.15)


def test_draws_are_values_that_the_record_allows() -> None:
    """Width and share of a dead zone are known together, along a curve: straight steps leave it."""
    time = np.arange(800) / 200.0
    drive = 40.0 - 40.0 * np.cos(2.0 * np.pi * time)
    record, model = po.Measurement(time, drive, drive), PiezoGain() + Offset() + DeadZone()
    truth = {
        "piezo_gain.d": 1e-7, "offset.y0": 0.0, "dead_zone.share": 1.0, "dead_zone.width": 1.0,
    }  # fmt: skip
    clean = po.simulate(model, record, truth).reading
    noise = NOISE * np.random.default_rng(0).normal(size=time.size)
    record = record.with_(position=clean + noise)
    fit = po.solve(po.Identification(model, record), start=truth)
    for numbers in draws(Answer(fit, 200.0), 9, 0)[1:]:
        moved = po.simulate(model, record, {**fit.values, **numbers}).reading
        change = float(np.sum(np.square(moved - fit.readings[0]))) / fit.rms**2
        assert 0.0 < change < 4.0 * len(fit.names)


@pytest.mark.parametrize("family", [Corners(5), Tones(4), Mixed(Corners(3), Tones(3))])
def test_every_member_keeps_range_and_slew(family: Corners | Tones | Mixed) -> None:
    room = Room(-10.0, 90.0, 2.0, 500.0, slew=700.0)
    rng = np.random.default_rng(2)
    size = family.starts[0].size
    for x in (*family.starts, *rng.uniform(size=(60, size)), np.zeros(size), np.ones(size)):
        values = room.scaled(family.wave(x, room))
        assert values.shape == (1000,)
        assert values.min() >= -10.0 - 1e-9
        assert values.max() <= 90.0 + 1e-9
        assert np.abs(np.diff(values)).max() * 500.0 <= 700.0 * (1.0 + 1e-9)
        assert family.said(x, room)


def test_holds_and_frequencies_are_free() -> None:
    room = Room(0.0, 1.0, 1.0, 1000.0)
    x = np.array([1.0, 0.0, 0.0, 0.0, 0.9, 0.1])  # two corners by jumps, held 81 to 1
    values = Corners(2).wave(x, room)
    assert np.mean(values > 0.99) == pytest.approx(81 / 82, abs=0.005)
    tone = Tones(1).wave(np.array([0.5, 1.0, 0.0, 1.0, 0.5]), room)
    assert np.argmax(np.abs(np.fft.rfft(tone - tone.mean()))) == round(np.sqrt(200.0))


def test_refusals(line: po.Fit) -> None:
    for options, words in (
        ({"parameters": ["bouc_wen.beta"]}, "does not estimate 'bouc_wen.beta'"),
        ({"parameters": []}, "one parameter at least"),
        ({"noise": -1.0}, "positive length"),
        ({"slew": 0.0}, "positive one"),
        ({"highest": 150.0}, "at most half of 200 Hz"),
        ({"low": 5.0, "high": 5.0}, "low below high"),
        ({"stroke": (1.0, 0.0)}, "is empty"),
        ({"stroke": (1.0, 2.0)}, "cannot be simulated on any drive"),
    ):
        with pytest.raises(InputError, match=words):
            best_for(line, evaluations=5, **options)  # type: ignore[arg-type]


def test_time_goes_where_samples_tell_most(line: po.Fit) -> None:
    """Of a triangle, to its ends; as fast between them as the slew rate allows."""
    answer, wanted = Answer(line, 200.0), ("piezo_gain.d",)
    room = Room(0.0, 80.0, 2.0, 200.0, slew=1600.0)

    def look(values: FloatArray) -> tuple[float, FloatArray]:
        told = answer.derivatives(values)
        assert told is not None
        asked = told[1], wanted, Criterion.DETERMINANT
        return merit(answer, *asked), worth(answer, *asked)

    start = slow_triangle(room).values
    assert look(start)[1].mean() == pytest.approx(1.0, rel=1e-6)
    value, values = timed(start, room, look)
    assert value == pytest.approx(look(values)[0])
    assert np.abs(np.diff(values)).max() * 200.0 <= 1600.0 * (1.0 + 1e-9)
    # Half of the time at either end has three times the variance of a triangle; two ways of 80 V
    # at 1600 V/s take a twentieth of the time.
    assert np.var(start) / 1600.0 == pytest.approx(1.0 / 3.0, abs=0.01)
    assert 0.85 < np.var(values) / 1600.0 < 1.0


def test_triangle_to_compare_with(line: po.Fit) -> None:
    room = Room(0.0, 10.0, 1.0, 100.0)
    made = slow_triangle(room).values
    assert made.size == 100
    assert made.argmax() == 50
    del line
