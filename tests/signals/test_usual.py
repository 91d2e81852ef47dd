"""The usual drives: what each is, within the range, the time and the slew rate."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.errors import InputError
from piezo_opt.signals import Drive, sine, usual
from piezo_opt.signals.families import Room


def still(drive: Drive) -> float:
    """Seconds without movement."""
    return float(np.count_nonzero(np.diff(drive.values) == 0.0)) / drive.rate


def dominant(drive: Drive) -> float:
    spectrum = np.abs(np.fft.rfft(drive.values - drive.values.mean()))
    return float(np.argmax(spectrum)) / drive.duration


def test_a_sine() -> None:
    drive = sine(0.0, 60.0, 5.0, 4.0, rate=1000.0)
    assert drive.description == "sine 0..60 V, 5 Hz, 4 s"
    assert drive.values.size == 4000
    assert dominant(drive) == 5.0
    assert (drive.values[0], drive.low, drive.high) == (0.0, 0.0, pytest.approx(60.0))
    with pytest.raises(InputError, match="above half of 1000 Hz"):
        sine(0.0, 1.0, 600.0, 1.0, rate=1000.0)


def test_each_kind_is_there_and_keeps_to_the_room() -> None:
    room = Room(-10.0, 50.0, 8.0, 1000.0, unit="N")
    drives = usual(room, resonance=60.0)
    kinds = [drive.description.split()[0] for drive in drives]
    assert kinds == ["sine", "sine", "2", "square", "staircase", "sine", "chirp", "multisine"]
    assert len({d.name for d in drives}) == 8
    for drive in drives:
        assert drive.unit == "N"
        assert drive.values.size == 8000
        assert drive.low >= -10.0 - 1e-9
        assert drive.high <= 50.0 + 1e-9
        assert np.ptp(drive.values) > 29.0
    slow, half, triangles, step, stairs, fast, _, many = drives
    assert dominant(slow) == dominant(half) == 0.5
    assert dominant(fast) == 20.0
    assert still(triangles) == pytest.approx(4.0, abs=0.01)
    assert still(step) == pytest.approx(8.0, abs=0.01)
    assert np.flatnonzero(np.diff(step.values)).tolist() == [799]
    assert np.unique(stairs.values).size == 5
    assert many.excited[0] == pytest.approx(0.125)
    assert many.excited[-1] <= 166.7
    octaves = np.log2(np.array(many.excited)[-12:] / np.array(many.excited)[-13:-1])
    np.testing.assert_allclose(octaves, octaves[0], rtol=0.1)


def test_a_slew_rate_makes_ramps_of_jumps_and_slows_what_is_fast() -> None:
    for drive in usual(Room(0.0, 100.0, 4.0, 500.0, slew=2000.0)):
        assert drive.slew <= 2000.0 * (1.0 + 1e-9)
        assert drive.high > 1.0


@pytest.mark.parametrize("samples", [11, 12, 51, 333])
def test_short_records_get_what_fits(samples: int) -> None:
    for drive in usual(Room(0.0, 1.0, samples / 10.0, 10.0)):
        assert abs(drive.values.size - samples) <= 4
