"""What a record says about its own sampling."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt import datasets
from piezo_opt.measurement import Between, Measurement
from tests.measurement.records import GOOD, sine


def test_a_gap_is_found_and_remarked() -> None:
    keep = np.r_[0:100, 150:400]
    record = sine(time=GOOD.time[keep], drive=GOOD.drive[keep], position=GOOD.position[keep])
    assert not record.uniform
    assert record.gaps == ((pytest.approx(0.99), pytest.approx(1.5)),)
    assert "1 gap in time" in record.remarks[0]


def test_uneven_steps_are_remarked() -> None:
    uneven = np.arange(400) / 100 + 0.2 * np.sin(np.arange(400) / 100)
    assert "Sampled unevenly" in sine(time=uneven).remarks[0]


def test_a_square_wave_of_four_samples_hides_the_resonance() -> None:
    remarks = datasets.load("thesis/vibration").remarks
    assert any("9 gaps" in remark for remark in remarks)
    assert any("nothing above 2 Hz can be identified" in remark for remark in remarks)


def test_a_fast_square_wave_with_many_samples_does_not() -> None:
    time = np.arange(1000) / 1000
    drive = np.where((time * 10) % 1 < 0.5, 0.0, 60.0)
    reading = 1e-7 * drive + 1e-9 * np.sin(7 * time)
    assert not Measurement(time, drive, reading, between=Between.HELD).remarks


def test_a_drive_near_nyquist_is_remarked_unless_band_limited() -> None:
    time = np.arange(400) / 100
    fast = np.sin(2 * np.pi * 41 * time)
    record = sine(drive=fast)
    assert any("aliasing" in remark for remark in record.remarks)
    assert record.with_(between=Between.BANDLIMITED).remarks == ()
