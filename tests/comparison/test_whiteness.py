"""The residual test: how often it cries wolf, and that it sees what is there."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.whiteness import whiteness
from piezo_opt.measurement import FloatArray, Measurement

TIME = np.arange(1000.0)
DRIVE = np.random.default_rng(5).normal(size=TIME.size)


def misfit(error: FloatArray) -> Misfit:
    record = Measurement(time=TIME, drive=DRIVE, position=DRIVE + error, allow_saturated=True)
    return Misfit(record, DRIVE)


def test_false_alarms() -> None:
    rng = np.random.default_rng(0)
    found = [whiteness(misfit(rng.normal(size=TIME.size))) for _ in range(400)]
    p_values = np.array([one.p_value for one in found])
    # Uniform p-values: 5 % below 0.05; three standard deviations of 400 draws are 3.3 %.
    assert np.mean(p_values < 0.05) == pytest.approx(0.05, abs=0.033)
    assert np.mean([not one.white for one in found]) < 0.05
    assert np.mean([one.autocorrelation_outside for one in found]) < 0.003
    assert np.mean([one.cross_correlation_outside for one in found]) < 0.003


def test_a_first_order_process_is_not_white() -> None:
    noise = np.random.default_rng(1).normal(size=TIME.size)
    error = np.zeros(TIME.size)
    for k in range(1, TIME.size):
        error[k] = 0.5 * error[k - 1] + noise[k]
    found = whiteness(misfit(error))
    assert not found.white
    assert found.p_value < 1e-6
    centre = found.lags.size // 2
    assert found.autocorrelation[centre] == pytest.approx(1.0)
    assert found.autocorrelation[centre + 1] == pytest.approx(0.5, abs=0.07)
    assert found.autocorrelation == pytest.approx(found.autocorrelation[::-1])
    assert found.sentence.startswith("What is left is not white")


def test_a_delay_shows_at_its_own_lag() -> None:
    error = 0.3 * np.roll(DRIVE, 4) + np.random.default_rng(2).normal(size=TIME.size)
    found = whiteness(misfit(error))
    assert found.lags[np.argmax(found.cross_correlation)] == 4.0
    assert found.cross_correlation_outside == pytest.approx(1 / 41)
    assert found.white
    assert "it correlates with the drive at 1 of 41 lags" in found.sentence


def test_the_band_and_the_lags_of_the_thesis() -> None:
    found = whiteness(misfit(np.random.default_rng(3).normal(size=TIME.size)))
    assert found.lags.tolist() == list(range(-20, 21))
    assert found.band == pytest.approx(3.2905 / np.sqrt(1000.0), rel=1e-4)
