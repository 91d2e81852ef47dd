"""Readings that stand alone are named, and what a drive or a resonance does is not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from piezo_opt import datasets
from piezo_opt.measurement import FloatArray, Measurement


def spiked(record: Measurement, *where: int, size: float) -> Measurement:
    """The record with readings that are off by a share of its range."""
    reading = np.array(record.position)
    reading[list(where)] += size * np.ptp(reading)
    return record.with_(position=reading)


def noisy(drive: FloatArray, share: float = 1e-3) -> Measurement:
    """2000 readings of mechanics with a resonance at a tenth of the sampling rate, and noise."""
    time = np.arange(drive.size) / 1000.0
    omega = 2.0 * np.pi * 100.0
    b, a = signal.cont2discrete(([omega**2], [1.0, 0.1 * omega, omega**2]), 1e-3)[:2]
    moved = signal.lfilter(np.ravel(b), a, drive)
    noise = np.random.default_rng(0).normal(size=drive.size)
    return Measurement(time, drive, 1e-7 * (moved + share * np.ptp(moved) * noise))


SINE = noisy(np.sin(2.0 * np.pi * 3.0 * np.arange(2000) / 1000.0))
STEPS = noisy(np.repeat([0.0, 5.0, 2.0, 4.0], 500))
ONE_STEP = noisy(np.repeat([0.0, 5.0], 1000))
CHIRP = noisy(signal.chirp(np.arange(2000) / 1000.0, 1.0, 2.0, 200.0))


@pytest.mark.parametrize("size", [0.05, -0.3])
@pytest.mark.parametrize("where", [2, 700, 1997])
def test_a_reading_that_stands_alone_is_remarked(where: int, size: float) -> None:
    record = spiked(SINE, where, size=size)
    (said,) = record.doubts
    assert said.startswith("1 reading stands alone")
    assert f"at {where / 1000:g} s (sample {where + 1}, " in said
    assert "leave that row out" in said
    assert f"{said} --mend lone leaves them out." in record.remarks


def test_several_are_counted() -> None:
    (said,) = spiked(STEPS, 300, 720, 1430, size=0.4).doubts
    assert said.startswith("3 readings stand alone")
    assert "the first at 0.3 s (sample 301," in said
    assert "leave those rows out" in said


@pytest.mark.parametrize("record", [SINE, STEPS, ONE_STEP, CHIRP])
def test_steps_that_ring_peaks_and_noise_are_no_wrong_readings(record: Measurement) -> None:
    assert record.doubts == ()
    # Nor is a jump, or a reading that is off where the drive jumps.
    assert record.with_(position=record.position + 1e-7 * (record.time > 0.8)).doubts == ()


def test_pulses_that_come_again_stand_not_alone() -> None:
    """Twenty of them in 2000 are something that happens."""
    assert spiked(SINE, *range(50, 2000, 100), size=0.3).doubts == ()


def test_what_nobody_sees_in_a_plot_is_not_remarked() -> None:
    quiet = noisy(SINE.drive, share=1e-6)
    assert spiked(quiet, 750, size=0.008).doubts == ()
    assert spiked(quiet, 750, size=0.012).doubts != ()


def test_what_is_off_where_the_drive_jumps_may_be_its_answer() -> None:
    assert spiked(STEPS, 1001, size=0.4).doubts == ()
    assert spiked(STEPS, 1020, size=0.4).doubts != ()


@pytest.mark.parametrize("name", datasets.names())
def test_no_reading_of_the_records_that_come_along_is_doubted(name: str) -> None:
    record = datasets.load(name)
    assert record.doubts == ()
    assert record.split(at=float(record.time[len(record) // 2]))[0].doubts == ()
