"""Whole periods, and the noise that differs between them."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.errors import InputError
from piezo_opt.measurement.periods import repetition
from tests.measurement.records import sine


def test_noise_is_what_differs_between_periods() -> None:
    noise = np.random.default_rng(3).normal(scale=2e-8, size=4000)
    clean = sine(count=4000)
    record = clean.with_(position=clean.position + noise, period=1.0)
    assert record.periods == 40
    assert record.repeated_periods().shape == (40, 100)
    # 3900 degrees of freedom: standard error 1.1 %.
    assert record.noise_from_periods() == pytest.approx(2e-8, rel=0.04)


def test_two_periods_do_not_make_the_noise_look_smaller() -> None:
    noise = np.random.default_rng(4).normal(scale=2e-8, size=20000)
    clean = sine(count=20000, rate=10000.0)
    record = clean.with_(position=clean.position + noise, period=1.0)
    assert record.noise_from_periods() == pytest.approx(2e-8, rel=0.03)


def test_the_start_up_is_left_out() -> None:
    record = sine(count=450, startup=1.25, period=1.0)
    assert record.periods == 3
    np.testing.assert_array_equal(record.repeated_periods()[0], record.position[125:225])


def test_without_a_period_there_are_none() -> None:
    assert sine().periods == 0
    with pytest.raises(InputError, match="has no period"):
        sine().repeated_periods()
    with pytest.raises(InputError, match="at least two"):
        sine(count=150, period=1.0).noise_from_periods()


def test_a_drive_that_plays_the_same_again_is_found() -> None:
    generator = np.random.default_rng(4)
    once = np.convolve(generator.normal(size=700), np.ones(30) / 30.0, mode="same")
    again = np.tile(once, 4)[:2500]
    assert repetition(again) == 700
    # Written with the digits of a converter it is the same drive.
    grain = np.ptp(again) / 2**12
    assert repetition(np.round(again / grain) * grain) == 700
    # Something else in the last repetition: it does not play the same again.
    other = again.copy()
    other[2200:2300] += np.ptp(again)
    assert repetition(other) is None
    # Slow is not the same: neither a ramp, nor half a wave, nor a chirp.
    t = np.linspace(0.0, 1.0, 4000)
    assert repetition(t) is None
    assert repetition(np.sin(np.pi * t)) is None
    assert repetition(np.sin(2.0 * np.pi * (2.0 * t + 20.0 * t**2))) is None
    assert repetition(np.ones(100)) is None
