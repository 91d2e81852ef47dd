"""What a record refuses at birth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from piezo_opt import datasets
from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, Measurement
from tests.measurement.records import GOOD, sine, spoiled, triangle


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
        ({"position": np.ma.masked_greater(GOOD.position, 5e-6)}, "masked values.*left_out=mask"),
        ({"drive": GOOD.drive + 0j}, "drive is of the kind complex128"),
        ({"time": np.arange(400).astype("datetime64[ms]")}, "datetime64.*seconds"),
        ({"between": "spline"}, "between is 'spline': give Between.LINEAR"),
        ({"position_unit": 7}, "a unit is 7"),
        ({"channels": [GOOD.drive]}, "go by name"),
        ({"period": "1 V"}, "not a quantity in s"),
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
