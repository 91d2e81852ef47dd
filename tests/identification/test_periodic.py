"""A residual that repeats with the position is told by its period; nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.identification.periodic import period
from piezo_opt.measurement import FloatArray

N = 6000
TIME = np.arange(N) / N
TRIANGLE = 9e-6 * np.abs(((6.0 * TIME + 0.3) % 2.0) - 1.0)
SINE = 4.5e-6 * (1.0 + np.sin(2.0 * np.pi * 3.0 * TIME))
HELD = 9e-6 * np.repeat(np.random.default_rng(4).uniform(size=12), N // 12)
FRINGE = 316.4e-9


def noise(seed: int, rho: float = 0.0) -> FloatArray:
    driven = np.random.default_rng(seed).normal(size=N)
    found = np.empty(N)
    at = 0.0
    for k in range(N):
        at = rho * at + np.sqrt(1.0 - rho**2) * driven[k]
        found[k] = at
    return found


@pytest.mark.parametrize("way", [TRIANGLE, SINE])
@pytest.mark.parametrize("size", [3.0, 0.5])
def test_fringes_are_told_by_their_period(way: FloatArray, size: float) -> None:
    """Also below the noise, and where a sine dwells at its ends."""
    fringes = size * np.sin(2.0 * np.pi * way / FRINGE + 0.7)
    assert period(way, fringes + noise(1)) == pytest.approx(FRINGE, rel=2e-3)


def test_two_sensors_errors_of_one_stroke_are_not_mistaken_for_each_other() -> None:
    for length in (80e-9, 1.5e-6):
        fringes = np.cos(2.0 * np.pi * TRIANGLE / length)
        assert period(TRIANGLE, fringes + noise(2)) == pytest.approx(length, rel=5e-3)


def test_fringes_are_told_where_a_stage_rests_most_of_the_time() -> None:
    way = np.interp(TIME % 0.25, [0.0, 0.05, 0.125, 0.175, 0.25], [0.0, 9e-6, 9e-6, 0.0, 0.0])
    fringes = 3.0 * np.sin(2.0 * np.pi * way / FRINGE + 0.7)
    assert period(way, fringes + noise(6)) == pytest.approx(FRINGE, rel=2e-3)


def test_fringes_are_told_where_a_stage_dwells_and_rings() -> None:
    """Few positions hold most samples, and copies of the line stand beside it."""
    left = HELD - np.repeat(np.r_[HELD[0], HELD[:-500:500]], N // 12)
    since = np.arange(N) % (N // 12)
    way = HELD - left * np.exp(-since / 60.0) * np.cos(0.7 * since)
    fringes = 3.0 * np.sin(2.0 * np.pi * way / FRINGE + 0.7)
    assert period(way, fringes + noise(5)) == pytest.approx(FRINGE, rel=2e-3)
    assert period(way, noise(5, 0.99)) is None


@pytest.mark.parametrize("way", [TRIANGLE, SINE, HELD])
@pytest.mark.parametrize("rho", [0.0, 0.9, 0.99])
def test_noise_repeats_with_nothing(way: FloatArray, rho: float) -> None:
    for seed in range(8):
        assert period(way, noise(seed, rho)) is None


@pytest.mark.parametrize("way", [TRIANGLE, SINE, HELD])
def test_what_bends_or_lags_does_not_repeat(way: FloatArray) -> None:
    share = way / np.ptp(way)
    rising = np.gradient(way) > 0.0
    creeping = np.convolve(share, np.exp(-np.arange(800) / 200.0) / 200.0)[:N] - share
    for left in (share**2, share**3, rising * share, creeping, np.sqrt(share), TIME):
        assert period(way, left - left.mean() + 0.05 * noise(3)) is None


def test_too_few_periods_or_samples_tell_nothing() -> None:
    bend = np.sin(2.0 * np.pi * TRIANGLE / 3e-6)
    assert period(TRIANGLE, bend) is None
    walk = np.cumsum(np.random.default_rng(1).normal(size=600))
    few = 9e-6 * (walk - walk.min()) / np.ptp(walk)
    assert period(few, np.sin(2.0 * np.pi * few / 1e-6)) == pytest.approx(1e-6, rel=5e-3)
    # Between most samples the position moves by more than half a period.
    steady = TRIANGLE[::100]
    assert period(steady, np.sin(2.0 * np.pi * steady / 3e-7)) is None
    assert period(np.zeros(N), noise(4)) is None
    assert period(np.zeros(1), np.zeros(1)) is None
