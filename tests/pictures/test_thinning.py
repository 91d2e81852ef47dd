"""Thinned curves lose no peak and stay within what a screen shows."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from piezo_opt.pictures.thinning import (
    MOST_POINTS,
    envelope,
    lasting,
    outline,
    stretches,
    window,
)


@pytest.mark.parametrize("count", [4001, 7999, 8001, 123_457])
def test_an_envelope_keeps_every_extreme_of_its_stretches(count: int) -> None:
    rng = np.random.default_rng(count)
    time = np.cumsum(rng.uniform(0.5, 1.5, count))
    smooth, spiked = np.sin(time / 900.0), np.zeros(count)
    at = int(rng.integers(count))
    spiked[at] = -7.0
    clock, (one, two) = envelope(time, [smooth, spiked])
    assert clock.size == one.size == two.size <= MOST_POINTS
    assert clock.size > 0.6 * MOST_POINTS
    assert np.all(np.diff(clock) >= 0)
    assert (clock[0], clock[-1]) == (time[0], time[-1])
    assert (one.min(), one.max()) == (smooth.min(), smooth.max())
    width = -(-count // (MOST_POINTS // 2))
    assert abs(clock[two.argmin()] - time[at]) <= 1.5 * width
    assert two.min() == -7.0


def test_what_is_short_comes_as_it_is_and_what_is_missing_stays_missing() -> None:
    time = np.arange(4000.0)
    signal = time**2
    clock, (same,) = envelope(time, [signal])
    assert clock is time
    assert same is signal
    long = np.arange(40_000.0)
    half = np.where(long < 20_000, np.nan, long)
    _, (thin,) = envelope(long, [half])
    assert np.isnan(thin[:1999]).all()
    assert np.nanmin(thin) == 20_000
    assert np.nanmax(thin) == 39_999


def test_the_ends_of_a_stretch_come_in_their_order() -> None:
    time = np.arange(10_001.0)
    _, (rising, falling) = envelope(time, [time, -time])
    assert np.all(np.diff(rising) >= 0)
    assert np.all(np.diff(falling) <= 0)


def test_an_outline_of_a_loop_has_its_corners() -> None:
    turns = np.linspace(0.0, 60.0, 100_001)
    drive, position = np.sin(turns), np.cos(turns)
    kept = outline([drive, position])
    assert kept.size <= MOST_POINTS
    assert {0, 100_000} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)
    for signal in (drive, position):
        assert (signal[kept].min(), signal[kept].max()) == (signal.min(), signal.max())


def test_a_window_reaches_one_sample_beyond_its_ends() -> None:
    time = np.arange(10.0)
    assert window(time, 2.5, 6.5) == slice(2, 8)
    assert window(time, None, None) == slice(0, 10)
    assert window(time, -5.0, 50.0) == slice(0, 10)
    assert time[window(time, 3.2, 3.3)].tolist() == [3.0, 4.0]


def test_stretches_begin_and_end_half_a_step_beyond_their_samples() -> None:
    time = np.arange(10.0)
    inside = np.isin(time, [0, 1, 4, 8, 9])
    assert stretches(time, inside).tolist() == [[0.0, 1.5], [3.5, 4.5], [7.5, 9.0]]
    assert stretches(time, np.zeros(10, dtype=bool)).shape == (0, 2)


def test_many_stretches_are_taken_together_where_the_pauses_are_shortest() -> None:
    time = np.arange(4000.0)
    inside = (time.astype(int) % 4) < 2  # a thousand of them
    inside[1000:1100] = False  # the one long pause
    found = stretches(time, inside, most=5)
    assert found.shape == (5, 2)
    assert any(end < 1001 and begin > 1098 for (_, end), (begin, _) in pairwise(found.tolist()))
    assert (found[0, 0], found[-1, 1]) == (0.0, 3997.5)


def test_what_lasts_draws_every_stretch_of_a_tenth_as_all_samples_do() -> None:
    count = 300_000
    time = np.arange(count) / 1e4
    noise = np.random.default_rng(3).standard_normal(count)
    spiked = np.sin(3.0 * time)
    spiked[[7, 123_456, 299_990]] += [9.0, -9.0, 9.0]
    kept = lasting([noise, spiked])
    assert kept.size <= 20 * MOST_POINTS
    for part in (slice(0, count), slice(100_000, 131_000)):
        at = kept[slice(*np.searchsorted(kept, [part.start, part.stop]))]
        for one in (noise, spiked):
            _, (all_,) = envelope(time[part], [one[part]])
            _, (few,) = envelope(time[at], [one[at]])
            assert (few.min(), few.max()) == (all_.min(), all_.max())
        # Noise fills as much of the screen; that of a stretch's neighbour may be the larger one.
        _, (all_,) = envelope(time[part], [noise[part]])
        _, (few,) = envelope(time[at], [noise[at]])
        swings = [np.median(np.abs(one[1::2] - one[::2])) for one in (few, all_)]
        assert swings[0] > 0.9 * swings[1]
