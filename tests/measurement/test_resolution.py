"""The step in which a reading comes is found, and only where there is one."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt import datasets
from tests.measurement.records import GOOD, sine


def test_of_the_thesis_records() -> None:
    assert datasets.load("thesis/hysteresis").resolution == pytest.approx(0.1725e-6, rel=3e-3)
    assert datasets.load("thesis/vibration").resolution == pytest.approx(0.1233e-6, rel=3e-3)


@pytest.mark.parametrize("step", [2e-6, 1e-7, 3e-8])
@pytest.mark.parametrize("offset", [0.0, 1.234567e-4])
def test_of_a_rounded_reading(step: float, offset: float) -> None:
    noise = np.random.default_rng(1).normal(size=2000) * 1e-8
    time = np.arange(2000) / 100
    reading = 1e-5 * np.sin(2 * np.pi * time / 3 - 0.2) + noise
    record = sine(
        count=2000,
        drive=np.sin(2 * np.pi * time / 3),
        position=np.round(reading / step) * step + offset,
    )
    assert record.resolution == pytest.approx(step, rel=1e-6)


def test_smooth_noisy_and_computed_readings_have_none() -> None:
    noise = np.random.default_rng(2).normal(size=400)
    assert sine(position=GOOD.position + 1e-8 * noise).resolution is None
    assert sine(position=noise).resolution is None
    assert datasets.load("thesis/fe").resolution is None
