"""What a record refuses, what it knows about its sampling, and how it is cut."""

import pickle
from typing import Any

import numpy as np
import pytest

from piezo_opt import datasets
from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, Campaign, Measurement


def sine(count: int = 400, rate: float = 100.0, **changes: Any) -> Measurement:
    """Sine of 1 Hz, 100 samples a period, gain 2e-7 m/V with a lag of 0.1 rad."""
    time = np.arange(count) / rate
    fields: dict[str, Any] = {
        "time": time,
        "drive": 50 * np.sin(2 * np.pi * time),
        "position": 1e-5 * np.sin(2 * np.pi * time - 0.1),
    }
    return Measurement(**(fields | changes))


def triangle(count: int = 201, **changes: Any) -> Measurement:
    time = np.linspace(0.0, 10.0, count)
    drive = 100 * (1 - np.abs(time / 5 - 1))
    fields: dict[str, Any] = {"time": time, "drive": drive, "position": 1e-7 * drive + 1e-6 * time}
    return Measurement(**(fields | changes))


def spoiled(values: np.ndarray, index: int, value: float) -> np.ndarray:
    copy = np.array(values)
    copy[index] = value
    return copy


GOOD = sine()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"time": [], "drive": [], "position": []}, "is empty"),
        ({"drive": GOOD.drive[:-1]}, "drive has 399 samples but time has 400"),
        ({"drive": spoiled(GOOD.drive, 7, np.nan)}, r"drive is nan at index 7 \(t = 0.07 s\)"),
        ({"position": spoiled(GOOD.position, 3, np.inf)}, "position is inf at index 3"),
        ({"time": spoiled(GOOD.time, 5, np.nan)}, "time is nan at index 5"),
        ({"time": spoiled(GOOD.time, 5, 0.04)}, "time repeats at index 5"),
        ({"time": spoiled(GOOD.time, 5, 0.01)}, "time goes back at index 5"),
        ({"time": GOOD.time + 1e12}, "drown|repeats"),
        ({"drive": np.full(400, 3.0)}, "drive is constant at 3"),
        ({"position": np.full(400, 3e-6)}, "reading is constant"),
        ({"position": GOOD.position * 1e200}, "check its unit"),
        ({"position": GOOD.position.reshape(2, 200)}, "shape"),
        ({"position": ["a"] * 400}, "not an array of numbers"),
        ({"channels": {"temperature": np.zeros(3)}}, "temperature has 3 samples"),
        ({"channels": {"temperature": spoiled(GOOD.time, 9, np.nan)}}, "temperature is nan"),
        ({"channels": {"drive": GOOD.drive}}, "cannot be called 'drive'"),
        ({"startup": -1.0}, "give 0 s or more"),
        ({"startup": np.nan}, "startup"),
        ({"startup": 4.0}, "covers the whole record"),
        ({"period": 0.0}, "positive"),
        ({"period": 5.0}, "does not fit the record of 4 s"),
        ({"period": 0.993}, "not a whole number"),
        ({"period": 0.7}, "does not repeat every 700 ms"),
        ({"drive_unit": "mV"}, "'mV' is none"),
        ({"position_unit": "nonsense"}, "unknown unit"),
    ],
)
def test_a_bad_record_is_refused_at_birth(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        sine(**changes)


def test_seven_samples_are_too_few_and_eight_are_enough() -> None:
    with pytest.raises(InputError, match="7 samples, too few"):
        sine(count=7)
    assert len(sine(count=8)) == 8


def test_arrays_cannot_be_written_and_are_copies() -> None:
    time = np.arange(400) / 100
    record = sine(time=time)
    time[0] = -1.0
    assert record.time[0] == 0.0
    for values in (record.time, record.drive, record.position):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
    with pytest.raises(TypeError):
        record.channels["x"] = time  # type: ignore[index]


def test_a_record_survives_the_way_to_another_process() -> None:
    record = sine(
        channels={"temperature": 293 + np.arange(400.0)},
        channel_units={"temperature": "K"},
        period=1.0,
    )
    copy = pickle.loads(pickle.dumps(record))
    np.testing.assert_array_equal(copy.channels["temperature"], record.channels["temperature"])
    assert dict(copy.channel_units) == {"temperature": "K"}
    assert copy.period == 1.0
    assert not copy.drive.flags.writeable


class TestSaturation:
    def test_a_clipped_reading_is_refused(self) -> None:
        with pytest.raises(InputError, match=r"stuck at 8e-06 m .* allow_saturated"):
            sine(position=np.minimum(GOOD.position, 8e-6))

    def test_a_reading_clipped_from_below_is_refused(self) -> None:
        with pytest.raises(InputError, match="stuck at -8e-06 m"):
            sine(position=np.maximum(GOOD.position, -8e-6))

    def test_it_can_be_accepted(self) -> None:
        record = sine(position=np.minimum(GOOD.position, 8e-6), allow_saturated=True)
        assert record.position.max() == 8e-6

    @pytest.mark.parametrize("levels", [4, 8, 20, 100])
    def test_a_coarse_reading_is_not_saturated(self, levels: int) -> None:
        step = np.ptp(triangle().position) / levels
        triangle(position=np.round(triangle().position / step) * step)

    def test_a_held_drive_is_not_saturated(self) -> None:
        time = np.arange(200) / 10
        drive = np.where(time % 10 < 5, 0.0, 60.0)
        Measurement(time, drive, 1e-7 * drive, between=Between.HELD)

    def test_the_thesis_records_are_not_saturated(self) -> None:
        for name in datasets.names():
            assert len(datasets.load(name)) >= 41


class TestSampling:
    def test_of_an_even_record(self) -> None:
        record = sine()
        assert record.uniform
        assert record.step == pytest.approx(0.01, rel=1e-12)
        assert record.rate == pytest.approx(100.0, rel=1e-12)
        assert record.duration == pytest.approx(3.99)
        assert record.gaps == ()
        assert record.remarks == ()

    def test_times_printed_with_few_digits_are_even(self) -> None:
        record = sine(time=np.round(np.arange(400) / 6400, 6))
        assert record.uniform
        assert record.rate == pytest.approx(6400, rel=1e-4)

    def test_a_gap_is_found_and_remarked(self) -> None:
        keep = np.r_[0:100, 150:400]
        record = sine(time=GOOD.time[keep], drive=GOOD.drive[keep], position=GOOD.position[keep])
        assert not record.uniform
        assert record.gaps == ((pytest.approx(0.99), pytest.approx(1.5)),)
        assert "1 gap in time" in record.remarks[0]

    def test_uneven_steps_are_remarked(self) -> None:
        jitter = np.arange(400) / 100 + 0.002 * np.sin(np.arange(400))
        assert "Sampled unevenly" in sine(time=jitter).remarks[0]

    def test_counted_starts_with_the_start_up(self) -> None:
        record = sine(startup=1.0)
        assert np.flatnonzero(record.counted)[0] == 100
        assert record.counted.sum() == 300

    def test_a_square_wave_of_four_samples_hides_the_resonance(self) -> None:
        remarks = datasets.load("thesis/vibration").remarks
        assert any("9 gaps" in remark for remark in remarks)
        assert any("nothing above 2 Hz can be identified" in remark for remark in remarks)

    def test_a_fast_square_wave_with_many_samples_does_not(self) -> None:
        time = np.arange(1000) / 1000
        drive = np.where((time * 10) % 1 < 0.5, 0.0, 60.0)
        reading = 1e-7 * drive + 1e-9 * np.sin(7 * time)
        assert not Measurement(time, drive, reading, between=Between.HELD).remarks

    def test_a_drive_near_nyquist_is_remarked_unless_band_limited(self) -> None:
        time = np.arange(400) / 100
        fast = np.sin(2 * np.pi * 41 * time)
        record = sine(drive=fast)
        assert any("aliasing" in remark for remark in record.remarks)
        assert record.with_(between=Between.BANDLIMITED).remarks == ()


class TestResolution:
    def test_of_the_thesis_records(self) -> None:
        assert datasets.load("thesis/hysteresis").resolution == pytest.approx(0.1725e-6, rel=3e-3)
        assert datasets.load("thesis/vibration").resolution == pytest.approx(0.1233e-6, rel=3e-3)

    @pytest.mark.parametrize("step", [2e-6, 1e-7, 3e-8])
    @pytest.mark.parametrize("offset", [0.0, 1.234567e-4])
    def test_of_a_rounded_reading(self, step: float, offset: float) -> None:
        noise = np.random.default_rng(1).normal(size=2000) * 1e-8
        time = np.arange(2000) / 100
        reading = 1e-5 * np.sin(2 * np.pi * time / 3 - 0.2) + noise
        record = sine(
            count=2000,
            drive=np.sin(2 * np.pi * time / 3),
            position=np.round(reading / step) * step + offset,
        )
        assert record.resolution == pytest.approx(step, rel=1e-6)

    def test_smooth_noisy_and_computed_readings_have_none(self) -> None:
        noise = np.random.default_rng(2).normal(size=400)
        assert sine(position=GOOD.position + 1e-8 * noise).resolution is None
        assert sine(position=noise).resolution is None
        assert datasets.load("thesis/fe").resolution is None


class TestCutting:
    def test_split_holds_out_the_end_but_simulates_through_it(self) -> None:
        train, test = triangle().split(at="8 s")
        assert train.time[-1] == pytest.approx(7.95)
        assert len(test) == 201
        assert test.time[test.counted][0] == pytest.approx(8.0)
        # Every sample is counted exactly once.
        assert train.counted.sum() + test.counted.sum() == 201

    @pytest.mark.parametrize("at", ["11 s", "0.1 s", -3.0])
    def test_split_outside_says_so(self, at: float | str) -> None:
        with pytest.raises(InputError, match=r"split|samples between"):
            triangle().split(at=at)

    def test_split_inside_the_start_up_says_so(self) -> None:
        with pytest.raises(InputError, match=r"covers|inside the start-up"):
            triangle(startup=5.0).split(at="4 s")

    def test_slice_is_half_open_and_keeps_what_is_left_of_the_start_up(self) -> None:
        part = sine(startup=1.0, period=1.0).slice("0.5 s", "2.5 s")
        assert part.time[0] == pytest.approx(0.5)
        assert part.time[-1] == pytest.approx(2.49)
        assert part.startup == pytest.approx(0.5)
        assert part.period == 1.0
        assert part.slice("1 s", "1.5 s").period is None
        assert sine(startup=1.0).slice(2.0).startup == 0.0

    def test_slice_of_nothing_says_so(self) -> None:
        with pytest.raises(InputError, match="only 0 samples"):
            sine().slice("7 s")

    def test_with_names_an_unknown_field(self) -> None:
        assert sine().rename("loop").name == "loop"
        assert sine().with_(startup=0.5).startup == 0.5
        with pytest.raises(InputError, match="no voltage"):
            sine().with_(voltage=GOOD.drive)


class TestResample:
    def test_upwards_on_straight_lines(self) -> None:
        record = triangle().resample(step="25 ms")
        assert len(record) == 401
        np.testing.assert_allclose(record.drive, 100 * (1 - np.abs(record.time / 5 - 1)), atol=1e-9)

    def test_a_held_drive_stays_held(self) -> None:
        time = np.arange(20) / 10.0
        drive = np.where(time < 1.0, 0.0, 5.0)
        record = Measurement(time, drive, 1e-6 * time, between=Between.HELD)
        fine = record.resample(rate="100 Hz")
        assert fine.between is Between.HELD
        assert set(np.unique(fine.drive)) == {0.0, 5.0}
        assert fine.drive[99] == 0.0
        assert fine.drive[100] == 5.0

    def test_downwards_keeps_what_the_new_rate_carries_and_removes_what_aliases(self) -> None:
        time = np.arange(4000) / 1000
        slow = np.sin(2 * np.pi * 3 * time)
        fast = np.sin(2 * np.pi * 95 * time) + np.sin(2 * np.pi * 56 * time)
        record = sine(time=time, drive=slow + 1.0, position=slow + fast, count=4000)
        low = record.resample(rate="100 Hz")
        inner = slice(40, -40)
        expected = np.sin(2 * np.pi * 3 * low.time)
        # Plain decimation would fold 95 Hz to 5 Hz and 56 Hz to 44 Hz with amplitude 1.
        assert np.max(np.abs(low.position - expected)[inner]) < 2e-3
        assert np.max(np.abs(low.drive - 1.0 - expected)[inner]) < 2e-3

    def test_a_trend_survives_to_its_ends(self) -> None:
        low = triangle(drive=np.linspace(0, 10, 201)).resample(rate="4 Hz")
        np.testing.assert_allclose(low.drive, low.time, atol=0.02)

    def test_a_band_limited_period_is_exact(self) -> None:
        time = np.arange(200) / 100
        tones = (3, 17, 41)

        def wave(t: np.ndarray) -> np.ndarray:
            return np.sum([np.sin(2 * np.pi * f * t + f) for f in tones], axis=0)

        record = Measurement(
            time, wave(time), wave(time - 0.01), period=1.0, between=Between.BANDLIMITED
        )
        fine = record.resample(rate="400 Hz")
        np.testing.assert_allclose(fine.drive, wave(fine.time), atol=1e-12)
        np.testing.assert_allclose(fine.position, wave(fine.time - 0.01), atol=1e-12)

    def test_an_uneven_record_is_interpolated(self) -> None:
        time = np.array([0, 1, 2, 3, 5, 6, 7, 8, 9, 10.0])
        record = Measurement(time, time**2, 2 * time + 1)
        even = record.resample(step=0.5)
        assert even.uniform
        np.testing.assert_allclose(even.position, 2 * even.time + 1, rtol=1e-12)

    def test_bad_steps_say_so(self) -> None:
        for choice in ({}, {"rate": 1.0, "step": 1.0}):
            with pytest.raises(InputError, match="either rate or step"):
                sine().resample(**choice)
        for choice in ({"rate": 0.0}, {"step": "2 s"}, {"step": -1.0}):
            with pytest.raises(InputError, match="choose a shorter step"):
                sine().resample(**choice)


class TestPeriods:
    def test_noise_is_what_differs_between_periods(self) -> None:
        noise = np.random.default_rng(3).normal(scale=2e-8, size=4000)
        clean = sine(count=4000)
        record = clean.with_(position=clean.position + noise, period=1.0)
        assert record.periods == 40
        assert record.repeated_periods().shape == (40, 100)
        # 3900 degrees of freedom: standard error 1.1 %.
        assert record.noise_from_periods() == pytest.approx(2e-8, rel=0.04)

    def test_two_periods_do_not_make_the_noise_look_smaller(self) -> None:
        noise = np.random.default_rng(4).normal(scale=2e-8, size=20000)
        clean = sine(count=20000, rate=10000.0)
        record = clean.with_(position=clean.position + noise, period=1.0)
        assert record.noise_from_periods() == pytest.approx(2e-8, rel=0.03)

    def test_the_start_up_is_left_out(self) -> None:
        record = sine(count=450, startup=1.25, period=1.0)
        assert record.periods == 3
        np.testing.assert_array_equal(record.repeated_periods()[0], record.position[125:225])

    def test_without_a_period_there_are_none(self) -> None:
        assert sine().periods == 0
        with pytest.raises(InputError, match="has no period"):
            sine().repeated_periods()
        with pytest.raises(InputError, match="at least two"):
            sine(count=150, period=1.0).noise_from_periods()


def test_detrended_removes_means_or_lines_of_counted_samples() -> None:
    record = sine(position=GOOD.position + 1e-6 + 3e-6 * GOOD.time, startup=1.0)
    means = record.detrended()
    assert abs(means.position[means.counted].mean()) < 1e-18
    assert abs(means.drive[means.counted].mean()) < 1e-12
    lines = record.detrended(order=1)
    assert abs(np.polyfit(lines.time[lines.counted], lines.position[lines.counted], 1)[0]) < 1e-18
    with pytest.raises(InputError, match="order"):
        record.detrended(order=2)


def test_a_campaign_has_unique_names_and_common_units() -> None:
    one, two = sine(name="one"), sine(name="two")
    campaign = Campaign.of([one, two])
    assert campaign.names == ("one", "two")
    assert campaign["two"] is two
    assert Campaign.of(campaign) is campaign
    assert Campaign.of(one).records == (one,)
    assert list(campaign) == [one, two]
    for records, says in (
        ([], "at least one"),
        ([one, one], "called 'one'"),
        ([one, two.with_(drive_unit="N")], "drive_unit N"),
    ):
        with pytest.raises(InputError, match=says):
            Campaign.of(records)
    with pytest.raises(InputError, match="no record 'three': there are one, two"):
        campaign["three"]
