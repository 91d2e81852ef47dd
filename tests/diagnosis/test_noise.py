"""The noise floor is right within the range it states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import piezo_opt as po
from piezo_opt.diagnosis.evidence import WORTH
from piezo_opt.diagnosis.following import play
from piezo_opt.diagnosis.noise import NoiseFloor, is_noise, noise_floor
from piezo_opt.effects import Offset, PiezoGain
from piezo_opt.measurement import FloatArray
from tests.diagnosis.plants import NOISE, STILL, clock, fitted, measured, rich, triangle

LINE = PiezoGain() + Offset()


@pytest.fixture(scope="module")
def clean() -> po.Fit:
    """A straight line, whose fit leaves nothing but noise."""
    return fitted(LINE, measured(LINE, clock(), rich(clock())))


def floor_of(clean: po.Fit, noise: FloatArray, step: float = 0.0, **changes: object) -> NoiseFloor:
    """The floor of the same fit on a record with this noise (N,), rounded to ``step`` [m]."""
    (record,) = clean.records
    reading = clean.readings[0] + noise
    if step:
        reading = step * np.round(reading / step)
    question = replace(clean.question, records=record.with_(position=reading, **changes))
    return noise_floor(replace(clean, question=question))


def white(seed: int, samples: int = 2000) -> FloatArray:
    return np.asarray(NOISE * np.random.default_rng(seed).normal(size=samples))


def test_white_noise_is_found_within_the_stated_range(clean: po.Fit) -> None:
    floors = [floor_of(clean, white(seed)) for seed in range(100)]
    assert np.mean([f.rms for f in floors]) == pytest.approx(NOISE, rel=0.02)
    inside = [f.low <= NOISE <= f.high for f in floors]
    assert np.mean(inside) >= 0.9
    assert np.mean([f.high / f.low for f in floors]) < 1.35
    assert not any(f.measured for f in floors)


def test_what_the_model_leaves_is_not_taken_for_noise(clean: po.Fit) -> None:
    """A misfit ten times the noise, as slow as the drive, hardly moves the floor."""
    misfit = 10.0 * NOISE * np.sin(2.0 * np.pi * clock())
    found = [floor_of(clean, white(seed) + misfit) for seed in range(60)]
    assert all("slower noise would come on top" in f.sentence for f in found)
    assert [f.rms for f in found] == pytest.approx([NOISE] * 60, rel=0.12)
    assert np.mean([f.low <= NOISE <= f.high for f in found]) >= 0.9


def slow(seed: int, samples: int = 2000) -> FloatArray:
    driven = np.random.default_rng(seed).normal(size=samples + 500)
    return np.asarray(NOISE * signal.lfilter([0.6], [1.0, -0.8], driven)[500:])


def test_slow_noise_is_found_within_the_stated_range(clean: po.Fit) -> None:
    floors = [floor_of(clean, slow(seed)) for seed in range(40)]
    known = [f for f in floors if "noise correlated from sample to sample by 0." in f.sentence]
    assert len(known) >= 34
    assert np.mean([f.rms for f in known]) == pytest.approx(NOISE, rel=0.03)
    assert np.mean([f.low <= NOISE <= f.high for f in known]) >= 0.9
    assert np.mean([f.high / f.low for f in known]) < 1.2


def test_the_floor_is_that_of_slow_noise_beside_what_follows_the_drive(clean: po.Fit) -> None:
    """A play of the drive as large as the noise: the error is above the floor by all of it."""
    (record,) = clean.records
    v = (record.drive - record.drive.mean()) / np.ptp(record.drive)
    followed = play(v, 0.15) - v
    left = NOISE * followed / followed.std()
    floors = [floor_of(clean, noise + left) for noise in map(slow, range(10))]
    known = [f for f in floors if "what does not follow the drive looks like noise" in f.sentence]
    assert len(known) >= 8
    assert np.mean([f.rms for f in known]) == pytest.approx(NOISE, rel=0.05)
    assert sum(f.low <= NOISE <= f.high for f in known) >= len(known) - 2


def test_what_hardly_follows_the_drive_does_not_hide_slow_noise(clean: po.Fit) -> None:
    """A fiftieth of its power: little beside it, much beside what the highest frequencies show."""
    (record,) = clean.records
    v = (record.drive - record.drive.mean()) / np.ptp(record.drive)
    followed = play(v, 0.15) - v
    left = 0.14 * NOISE * followed / followed.std()
    for noise in map(slow, range(10)):
        if "correlated from sample to sample" in floor_of(clean, noise).sentence:
            found = floor_of(clean, noise + left)
            assert "correlated from sample to sample" in found.sentence
            assert found.low <= NOISE <= found.high


def test_slow_noise_beside_a_misfit_is_a_lower_bound(clean: po.Fit) -> None:
    misfit = 2.0 * NOISE * np.sin(2.0 * np.pi * clock())
    found = floor_of(clean, slow(0) + misfit)
    # (1 - phi) / (1 + phi) of the power at the highest frequencies, a little more below.
    assert 0.3 * NOISE < found.rms < 0.5 * NOISE
    assert "slower noise would come on top" in found.sentence


def test_noise_slower_than_it_may_be_is_a_lower_bound(clean: po.Fit) -> None:
    """Correlated by 0.98 it would be as slow as what the model lacks."""
    for seed in range(10):
        driven = np.random.default_rng(seed).normal(size=2500)
        slower = NOISE * np.sqrt(1.0 - 0.98**2) * signal.lfilter([1.0], [1.0, -0.98], driven)[500:]
        assert "slower noise would come on top" in floor_of(clean, slower).sentence


def test_the_unit_does_not_matter(clean: po.Fit) -> None:
    """Squares of a residual in metres are small: where they are summed nothing may underflow."""
    small = floor_of(clean, 1e-6 * slow(3))
    assert small.rms == pytest.approx(1e-6 * floor_of(clean, slow(3)).rms, rel=1e-6)
    assert small.sentence.split("rms, ")[1] == floor_of(clean, slow(3)).sentence.split("rms, ")[1]


def test_rounding_is_the_floor_of_a_coarse_reading(clean: po.Fit) -> None:
    step = 1e-7
    found = floor_of(clean, white(0) * 1e-3, step)
    assert found.rms == pytest.approx(step / np.sqrt(12.0), rel=0.15)


def test_rounding_adds_to_noise(clean: po.Fit) -> None:
    step = 2.0 * NOISE
    found = floor_of(clean, white(0), step)
    both = np.sqrt(NOISE**2 + step**2 / 12.0)
    assert found.low <= both <= found.high
    assert found.rms == pytest.approx(both, rel=0.08)


def test_uneven_sampling() -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, 2000))
    fit = fitted(LINE, measured(LINE, time, rich(time - time[0]), seed=3))
    found = noise_floor(fit)
    assert found.rms == pytest.approx(NOISE, rel=0.12)
    assert found.low <= NOISE <= found.high


def test_a_short_record() -> None:
    time = clock(50)
    floors = [
        noise_floor(fitted(LINE, measured(LINE, time, rich(time), seed=s))) for s in range(30)
    ]
    assert np.mean([f.rms for f in floors]) == pytest.approx(NOISE, rel=0.2)
    assert np.mean([f.low <= NOISE <= f.high for f in floors]) >= 0.8


def test_periods_measure_the_noise() -> None:
    time = clock(4000)
    inside = []
    for seed in range(20):
        record = measured(LINE, time, triangle(time, 2.0), seed=seed).with_(period=0.5)
        found = noise_floor(fitted(LINE, record))
        assert found.measured
        assert found.rms == pytest.approx(record.noise_from_periods(), rel=1e-12)
        inside.append(found.low <= NOISE <= found.high)
    assert found.rms == pytest.approx(NOISE, rel=0.05)
    assert np.mean(inside) >= 0.85


def test_repetitions_of_the_drive_measure_the_noise_beside_any_misfit() -> None:
    """Nobody said that the drive repeats, the start is no steady state, and the model misses."""
    once = rich(clock())[:500]
    drive = np.tile(once, 4)
    time = clock(drive.size)
    record = measured(LINE, time, drive)
    (line,) = fitted(LINE, record).readings
    misfit = 20.0 * NOISE * np.tanh((drive - drive.mean()) / drive.std())
    misfit[:300] += 50.0 * NOISE
    found = []
    for seed in range(40):
        noisy = record.with_(position=line + misfit + white(seed, drive.size))
        floor = noise_floor(fitted(LINE, noisy))
        assert floor.measured
        assert "3 repetitions" in floor.sentence
        found.append(floor)
    assert np.mean([f.rms for f in found]) == pytest.approx(NOISE, rel=0.01)
    assert np.mean([f.low <= NOISE <= f.high for f in found]) >= 0.85


def test_periods_measure_slow_noise_too() -> None:
    """What the highest frequencies cannot see, repetitions do."""
    time = clock(4000)
    driven = np.random.default_rng(0).normal(size=4500)
    slow = signal.lfilter([1.0], [1.0, -0.8], driven)[500:]
    slow = NOISE * slow / slow.std()
    record = measured(LINE, time, triangle(time, 2.0), noise=slow).with_(period=0.5)
    assert noise_floor(fitted(LINE, record)).rms == pytest.approx(NOISE, rel=0.1)


def test_several_records_are_pooled() -> None:
    time = clock()
    one = measured(LINE, time, rich(time), seed=1, name="one")
    other = measured(LINE, time, rich(time), noise=3.0 * NOISE, seed=2, name="other")
    fit = po.solve(po.Identification(LINE, (one, other)))
    assert noise_floor(fit).rms == pytest.approx(NOISE * np.sqrt(5.0), rel=0.05)


def test_a_line_near_half_the_rate_is_no_part_of_the_floor() -> None:
    time = clock(2000, 100.0)
    line = 10.0 * NOISE * np.sin(300.0 * time)
    white = NOISE * np.random.default_rng(8).normal(size=time.size)
    record = measured(STILL, time, rich(time), noise=white + line)
    fit = po.solve(po.Identification(STILL, record))
    assert noise_floor(fit).rms == pytest.approx(NOISE, rel=0.3)
    assert not is_noise(fit, WORTH)
