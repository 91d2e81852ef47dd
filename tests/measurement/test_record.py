"""A record cannot be changed, travels, and is cut without losing what it knows."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from piezo_opt.errors import InputError
from tests.measurement.records import GOOD, sine, triangle


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


def test_detrended_removes_means_or_lines_of_counted_samples() -> None:
    record = sine(position=GOOD.position + 1e-6 + 3e-6 * GOOD.time, startup=1.0)
    means = record.detrended()
    assert abs(means.position[means.counted].mean()) < 1e-18
    assert abs(means.drive[means.counted].mean()) < 1e-12
    lines = record.detrended(order=1)
    assert abs(np.polyfit(lines.time[lines.counted], lines.position[lines.counted], 1)[0]) < 1e-18
    with pytest.raises(InputError, match="order"):
        record.detrended(order=2)
