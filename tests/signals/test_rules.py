"""Drives made by rule hold what their names say."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import PiezoGain
from piezo_opt.errors import InputError
from piezo_opt.signals import (
    Drive,
    DriveLimits,
    Lines,
    Phases,
    chirp,
    decaying_triangles,
    multisine,
    predicted,
    square,
    staircase,
    triangle,
    within,
)


def test_the_thesis_triangle() -> None:
    """0-125-0 V in 50 s, one sample a second: Table 3.1's voltages."""
    drive = triangle(0.0, 125.0, 0.02, rate=1.0)
    table = po.load("thesis/hysteresis")
    np.testing.assert_allclose(drive.time, table.time)
    np.testing.assert_allclose(drive.values, table.drive, atol=1e-9)
    assert drive.slew == pytest.approx(5.0)


def test_the_thesis_square() -> None:
    """500 ms low and 500 ms high; sampled at 4 Hz it is Appendix E's drive."""
    drive = square(0.063, 63.05, 1.0, rate=4.0, periods=100)
    table = po.load("thesis/vibration")
    at = np.round(4.0 * table.time).astype(int)
    np.testing.assert_allclose(drive.values[at], table.drive)


def test_duty_is_the_share_of_samples() -> None:
    for duty in (0.1, 0.25, 0.5, 0.73):
        drive = square(-1.0, 3.0, 2.0, rate=1000.0, duty=duty, periods=5)
        assert np.mean(drive.values == 3.0) == pytest.approx(duty, abs=0.002)
        rises = np.count_nonzero(np.diff(drive.values) > 0)
        assert rises == 5


def test_staircase_holds() -> None:
    drive = staircase([0.0, 5.0, 2.0], 0.1, rate=100.0)
    np.testing.assert_array_equal(drive.values, np.repeat([0.0, 5.0, 2.0], 10))


def test_decaying_triangles_have_one_speed_and_falling_tops() -> None:
    drive = decaying_triangles(10.0, 110.0, 1.0, rate=1000.0, count=4, minor=2)
    speed = np.abs(np.diff(drive.values)) * 1000.0
    assert speed.max() == pytest.approx(200.0)
    assert np.median(speed) == pytest.approx(200.0)
    inner = drive.values[1:-1]
    tops = inner[(inner > drive.values[:-2]) & (inner >= drive.values[2:])]
    bottoms = inner[(inner < drive.values[:-2]) & (inner <= drive.values[2:])]
    # A top and two minor ones a triangle; a bottom and two minor ones between.
    assert tops.size == 12
    assert np.all(np.diff(tops[::3]) < 0.0)
    np.testing.assert_allclose(tops[::3], [110.0, 85.0, 60.0, 35.0], atol=0.2)
    assert bottoms.size == 11


@pytest.mark.parametrize("logarithmic", [True, False])
def test_chirp_goes_from_start_to_stop(logarithmic: bool) -> None:
    drive = chirp(0.0, 2.0, 5.0, 50.0, 4.0, rate=5000.0, logarithmic=logarithmic)
    assert drive.values[0] == pytest.approx(0.0)
    crossings = np.flatnonzero(np.diff(np.sign(drive.values - 1.0)))
    local = 2500.0 / np.diff(crossings)
    middle = 0.5 * (crossings[1:] + crossings[:-1]) / 5000.0
    share = middle / 4.0
    expected = 5.0 * 10.0**share if logarithmic else 5.0 + 45.0 * share
    np.testing.assert_allclose(local, expected, rtol=0.03)


def test_multisine_has_its_lines_and_no_others() -> None:
    for lines in Lines:
        drive = multisine(-5.0, 15.0, 2.0, 60.0, 2.0, rate=500.0, lines=lines, seed=3, periods=2)
        assert drive.low == pytest.approx(-5.0)
        assert drive.high == pytest.approx(15.0)
        one = drive.values[:1000]
        np.testing.assert_allclose(drive.values[1000:], one)
        amplitude = 2.0 * np.abs(np.fft.rfft(one - one.mean())) / 1000
        harmonics = np.round(2.0 * np.array(drive.excited)).astype(int)
        level = amplitude[harmonics]
        np.testing.assert_allclose(level, level[0], rtol=1e-9)
        rest = np.delete(amplitude, harmonics)
        assert rest.max() < 1e-9 * level[0]
        assert {*np.round(2.0 * np.array(drive.silent)).astype(int)} | {*harmonics} == {
            *range(4, 121)
        }
        if lines in (Lines.ODD, Lines.ODD_DETECTION):
            assert np.all(harmonics % 2 == 1)
        if lines is Lines.ODD_DETECTION:
            odd = np.arange(5, 121, 2)
            triples = odd[: odd.size - odd.size % 3].reshape(-1, 3)
            assert all(np.isin(three, harmonics).sum() == 2 for three in triples)


def test_even_distortion_answers_on_even_lines_only() -> None:
    """What odd multisines are for: a square of the drive shows where nothing was played."""
    drive = multisine(-1.0, 1.0, 1.0, 40.0, 1.0, rate=400.0, lines=Lines.ODD, seed=1)
    swing = drive.values - drive.values.mean()
    squared = np.abs(np.fft.rfft(swing**2))
    assert squared[1::2].max() < 1e-9 * squared[2::2].max()


def test_seed_and_phases() -> None:
    def made(seed: int, phases: Phases) -> Drive:
        return multisine(0.0, 1.0, 1.0, 100.0, 1.0, rate=1000.0, phases=phases, seed=seed)

    random = made(1, Phases.RANDOM)
    np.testing.assert_array_equal(random.values, made(1, Phases.RANDOM).values)
    assert np.abs(random.values - made(2, Phases.RANDOM).values).max() > 0.1
    # Schroeder (1970): nearly flat, where random phases pile up.
    crests = [made(seed, Phases.RANDOM).crest for seed in range(20)]
    assert made(0, Phases.SCHROEDER).crest < 1.8 < min(crests)


def test_limits_are_kept() -> None:
    ringing = multisine(-20.0, 120.0, 1.0, 50.0, 1.0, rate=1000.0, seed=2)
    limited = within(ringing, DriveLimits(low=0.0, high=100.0, slew=5000.0))
    assert limited.low >= 0.0
    assert limited.high <= 100.0
    assert limited.slew <= 5000.0 * (1 + 1e-9)
    assert "amplitude limit" in limited.description
    assert "slew limit" in limited.description
    # Scaled, not clipped: the shape is the same.
    assert np.corrcoef(limited.values, ringing.values)[0, 1] == pytest.approx(1.0)
    steps = square(0.0, 100.0, 1.0, rate=1000.0)
    ramped = within(steps, DriveLimits(slew=1000.0))
    assert ramped.slew == pytest.approx(1000.0)
    assert (ramped.low, ramped.high) == (0.0, 100.0)
    assert within(steps, DriveLimits(low=-1.0, high=101.0)) is steps


def test_stroke_limit_asks_a_fit() -> None:
    time = np.arange(500) / 500.0
    drive = 50.0 - 50.0 * np.cos(2.0 * np.pi * 3.0 * time)
    model = po.Model.of(PiezoGain())
    fit = po.solve(po.Identification(model, po.Measurement(time, drive, 1e-7 * drive)))
    wanted = triangle(0.0, 100.0, 1.0, rate=500.0)
    kept = within(wanted, DriveLimits(longest=4e-6), fit)
    assert predicted(fit, kept).max() == pytest.approx(4e-6, rel=1e-6)
    assert kept.high == pytest.approx(40.0, rel=1e-6)
    with pytest.raises(InputError, match="needs a fit"):
        within(wanted, DriveLimits(longest=4e-6))
    with pytest.raises(InputError, match="even at rest"):
        within(wanted, DriveLimits(shortest=1e-6), fit)


def test_one_after_another_and_again() -> None:
    one, two = triangle(0.0, 1.0, 1.0, rate=100.0), square(0.0, 1.0, 1.0, rate=100.0)
    both = one.then(two)
    np.testing.assert_array_equal(both.values, np.concatenate([one.values, two.values]))
    assert two.repeated(3).values.size == 300
    with pytest.raises(InputError, match="at one rate"):
        one.then(square(0.0, 1.0, 1.0, rate=200.0))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: triangle(1.0, 0.0, 1.0, rate=10.0), "give low below high"),
        (lambda: triangle(0.0, 1.0, -1.0, rate=10.0), "positive frequency"),
        (lambda: square(0.0, 1.0, 1.0, rate=100.0, duty=1.0), "share between 0 and 1"),
        (lambda: square(0.0, 1.0, 50.0, rate=100.0, duty=0.1), "raise the rate"),
        (lambda: staircase([1.0], 1.0, rate=10.0), "two levels at least"),
        (lambda: staircase([1.0, 2.0], 0.01, rate=10.0), "shorter than a sample"),
        (lambda: decaying_triangles(0.0, 1.0, 1.0, rate=10.0, count=0), "one triangle at least"),
        (lambda: chirp(0.0, 1.0, 1.0, 60.0, 1.0, rate=100.0), "above half of 100 Hz"),
        (lambda: multisine(0.0, 1.0, 1.0, 9.0, 0.333, rate=100.0), "whole number"),
        (lambda: multisine(0.0, 1.0, 1.2, 1.8, 1.0, rate=100.0), "play a longer period"),
        (lambda: triangle(0.0, 1.0, 1e-6, rate=1e6), "a file holds"),
        (lambda: DriveLimits(low=1.0, high=0.0), "low below high"),
    ],
)
def test_refusals(make: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()  # type: ignore[operator]
