"""Frequency responses of periodic records: gain, noise, even and odd distortion."""

from __future__ import annotations

import control
import numpy as np
import pytest

from piezo_opt.errors import InputError
from piezo_opt.linear_models import frequency_response
from piezo_opt.measurement import Between, Measurement

SAMPLES, RATE, PERIODS = 512, 1024.0, 4
ODD = [k for k in range(1, 100, 2) if k % 8 != 5]


def realisation(
    seed: int, *, noise: float = 0.0, square: float = 0.0, cube: float = 0.0
) -> Measurement:
    """Steady periods of an odd multisine with every fourth odd line left out.

    The plant is 100 nm/V behind a lag of 2 ms, with a static polynomial of the drive before it.
    """
    chance = np.random.default_rng(seed)
    spectrum = np.zeros(SAMPLES // 2 + 1, dtype=complex)
    spectrum[ODD] = np.exp(2j * np.pi * chance.random(len(ODD)))
    u = np.fft.irfft(spectrum) * SAMPLES / 2
    v = u + square * u**2 + cube * u**3
    lines = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    y = np.fft.irfft(np.fft.rfft(v) * 1e-7 / (1.0 + 2j * np.pi * lines * 2e-3), SAMPLES)
    y = np.tile(y, PERIODS) + noise * chance.standard_normal(SAMPLES * PERIODS)
    return Measurement(
        time=np.arange(SAMPLES * PERIODS) / RATE,
        drive=np.tile(u, PERIODS),
        position=y,
        name=f"r{seed}",
        period=SAMPLES / RATE,
        between=Between.BANDLIMITED,
    )


def truth(frequency: np.ndarray) -> np.ndarray:
    return 1e-7 / (1.0 + 2j * np.pi * frequency * 2e-3)


def test_a_linear_plant_is_found_and_nothing_else() -> None:
    found = frequency_response([realisation(s) for s in range(3)])
    assert found.frequency.size == len(ODD)
    assert np.abs(found.response / truth(found.frequency) - 1.0).max() < 1e-10
    assert found.separates
    assert max(found.level("even"), found.level("odd")) < 1e-12 * 1e-6
    assert isinstance(found.data, control.FrequencyResponseData)


def test_noise_is_measured_from_the_periods() -> None:
    found = frequency_response([realisation(s, noise=2e-8) for s in range(6)])
    error = found.response - truth(found.frequency)
    assert np.sqrt(np.mean(np.abs(error) ** 2)) == pytest.approx(
        np.sqrt(np.mean(found.noise**2)), rel=0.25
    )
    # Amplitudes of white noise of N samples: variance 4 sigma^2 / N.
    expected = 2e-8 * np.sqrt(4.0 / (SAMPLES * PERIODS * 6))
    assert found.level("floor") == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(("square", "cube"), [(0.01, 0.0), (0.0, 1e-3)])
def test_distortion_shows_at_its_parity(square: float, cube: float) -> None:
    several = [realisation(s, noise=1e-9, square=square, cube=cube) for s in range(6)]
    found = frequency_response(several)
    strong, weak = ("even", "odd") if square else ("odd", "even")
    assert found.level(strong) > 20.0 * found.level("floor")
    assert found.level(weak) < 3.0 * np.sqrt(6) * found.level("floor")
    if cube:  # odd distortion falls onto the excited lines and moves the gain from draw to draw
        assert np.median(found.distortion) > 3.0 * np.median(found.noise)


def test_a_repeated_drive_needs_no_declared_period() -> None:
    record = realisation(1)
    found = frequency_response(record.with_(period=None))
    assert found.periods == PERIODS - 1
    assert np.abs(found.response / truth(found.frequency) - 1.0).max() < 1e-10


def test_a_record_without_period_is_refused() -> None:
    chance = np.random.default_rng(0)
    record = Measurement(
        time=np.arange(300) * 1e-3, drive=chance.random(300), position=chance.random(300)
    )
    with pytest.raises(InputError, match="neither has a period"):
        frequency_response(record)
    with pytest.raises(InputError, match="same period"):
        frequency_response([realisation(1), realisation(2).with_(period=2 * SAMPLES / RATE)])
