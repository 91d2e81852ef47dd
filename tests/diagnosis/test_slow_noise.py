"""Slow noise is told from what a model leaves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from piezo_opt.diagnosis.slow_noise import correlation
from piezo_opt.measurement import FloatArray

SAMPLES = 8000


def slow(rho: float, seed: int, samples: int = SAMPLES) -> FloatArray:
    """First-order noise of unit variance."""
    driven = np.random.default_rng(seed).normal(size=samples + 500)
    made = signal.lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], driven)
    return np.asarray(made[500:])


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.6, 0.9])
def test_first_order_noise_is_known(rho: float) -> None:
    found = [correlation(slow(rho, seed)) for seed in range(40)]
    known = [c for c in found if c is not None]
    assert len(known) >= 38
    np.testing.assert_allclose(known, rho, atol=0.05)


def test_rounded_noise_is_noise() -> None:
    """What rounding adds is white, and lowers the correlation."""
    found = [correlation(np.round(slow(0.6, seed)) * 1e-9, rounded=True) for seed in range(20)]
    known = [c for c in found if c is not None]
    assert len(known) >= 18
    assert np.mean(known) == pytest.approx(0.6 / (1.0 + 1.0 / 12.0), abs=0.03)


def test_noise_slower_than_it_may_be_is_not() -> None:
    assert all(correlation(slow(0.98, seed)) is None for seed in range(20))


@pytest.mark.parametrize("rho", [0.0, 0.8])
@pytest.mark.parametrize(
    "left",
    [
        # A line, a loop's corners, a hum that swells, pulses after steps, a relaxation after each.
        0.6 * np.sin(0.05 * np.arange(SAMPLES)),
        signal.sawtooth(0.01 * np.arange(SAMPLES), 0.5),
        signal.chirp(np.arange(SAMPLES), 0.0, SAMPLES, 0.05),
        np.where(np.arange(SAMPLES) % 800 < 4, 10.0, 0.0),
        3.0 * np.exp(-(np.arange(SAMPLES) % 1600) / 200.0),
    ],
    ids=["sine", "triangle", "chirp", "pulses", "relaxation"],
)
def test_what_follows_a_drive_is_not_noise(rho: float, left: FloatArray) -> None:
    assert all(correlation(slow(rho, seed) + left) is None for seed in range(10))


def test_what_switches_between_levels_is_not_noise() -> None:
    """A telegraph signal has the spectrum of first-order noise, too."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        level = np.cumprod(np.where(random.random(SAMPLES) < 0.1, -1.0, 1.0))
        switching = 3.0 * level + random.normal(size=SAMPLES)
        assert correlation(switching) is None
        assert correlation(switching, rounded=True) is None


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_levels_and_shots_have_the_spectrum_of_slow_noise_and_are_none(rho: float) -> None:
    """A pure telegraph signal, and pulses now and then that die away: exactly first order."""
    for seed in range(10):
        random = np.random.default_rng(seed)
        flips = np.cumsum(random.random(SAMPLES) < (1.0 - rho) / 2.0)
        shots = np.where(random.random(SAMPLES) < 0.02, random.normal(size=SAMPLES), 0.0)
        assert correlation(np.where(flips % 2, 1.0, -1.0)) is None
        assert correlation(np.asarray(signal.lfilter([1.0], [1.0, -rho], shots))) is None


def test_white_noise_below_slow_noise_is_of_rounding_only() -> None:
    both = slow(0.9, 1) + 0.5 * slow(0.0, 2)
    assert correlation(both) is None
    assert correlation(both, rounded=True) is not None


def test_a_short_record_tells_nothing() -> None:
    assert correlation(slow(0.6, 0, 999)) is None
    assert correlation(slow(0.6, 0, 1000)) is not None


def test_a_constant_is_no_noise() -> None:
    assert correlation(np.full(SAMPLES, 1e-9)) is None
    assert correlation(np.zeros(SAMPLES)) is None


def test_the_unit_does_not_matter() -> None:
    noise = slow(0.7, 3)
    assert correlation(1e-9 * noise) == pytest.approx(correlation(noise), rel=1e-9)
