"""Another clock: nothing aliases, a held drive holds, a band-limited period is exact."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, Measurement
from tests.measurement.records import sine, triangle


def test_upwards_on_straight_lines() -> None:
    record = triangle().resample(step="25 ms")
    assert len(record) == 401
    np.testing.assert_allclose(record.drive, 100 * (1 - np.abs(record.time / 5 - 1)), atol=1e-9)


def test_a_held_drive_stays_held() -> None:
    time = np.arange(20) / 10.0
    drive = np.where(time < 1.0, 0.0, 5.0)
    record = Measurement(time, drive, 1e-6 * time, between=Between.HELD)
    fine = record.resample(rate="100 Hz")
    assert fine.between is Between.HELD
    assert set(np.unique(fine.drive)) == {0.0, 5.0}
    assert fine.drive[99] == 0.0
    assert fine.drive[100] == 5.0


def test_downwards_keeps_what_the_new_rate_carries_and_removes_what_aliases() -> None:
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


def test_a_trend_survives_to_its_ends() -> None:
    low = triangle(drive=np.linspace(0, 10, 201)).resample(rate="4 Hz")
    np.testing.assert_allclose(low.drive, low.time, atol=0.02)


def test_a_band_limited_period_is_exact() -> None:
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


def test_an_uneven_record_is_interpolated() -> None:
    time = np.array([0, 1, 2, 3, 5, 6, 7, 8, 9, 10.0])
    record = Measurement(time, time**2, 2 * time + 1)
    even = record.resample(step=0.5)
    assert even.uniform
    np.testing.assert_allclose(even.position, 2 * even.time + 1, rtol=1e-12)


def test_bad_steps_say_so() -> None:
    for choice in ({}, {"rate": 1.0, "step": 1.0}):
        with pytest.raises(InputError, match="either rate or step"):
            sine().resample(**choice)
    for choice in ({"rate": 0.0}, {"step": "2 s"}, {"step": -1.0}):
        with pytest.raises(InputError, match="choose a shorter step"):
            sine().resample(**choice)
