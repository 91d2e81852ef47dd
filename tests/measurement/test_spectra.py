"""Spectra against the signal-processing library, which the package does without at its start."""

import numpy as np
import pytest
from scipy import ndimage, signal

from piezo_opt.measurement.spectra import (
    densities,
    density,
    frequencies,
    running_median,
    without_line,
)

RNG = np.random.default_rng(3)
ONE, OTHER = RNG.normal(size=(2, 1001)).cumsum(axis=1)


@pytest.mark.parametrize("length", [64, 65, 1000, 1001])
def test_densities_are_those_of_the_library(length: int) -> None:
    f, cross = signal.csd(ONE, OTHER, fs=250.0, nperseg=length)
    np.testing.assert_allclose(frequencies(length, 250.0), f, rtol=1e-14)
    first, ours, second = densities(ONE, OTHER, rate=250.0, length=length)
    np.testing.assert_allclose(ours, cross, rtol=1e-9, atol=1e-12 * np.abs(cross).max())
    for values, by_pair in ((ONE, first), (OTHER, second)):
        _, power = signal.welch(values, fs=250.0, nperseg=length)
        np.testing.assert_allclose(by_pair, power, rtol=1e-9, atol=1e-12 * power.max())
        alone = density(values, rate=250.0, length=length)
        np.testing.assert_allclose(alone, by_pair, rtol=1e-14)


def test_a_line_is_taken_out() -> None:
    np.testing.assert_allclose(without_line(ONE), signal.detrend(ONE), atol=1e-10)
    np.testing.assert_array_equal(without_line(np.array([7.0])), [0.0])


@pytest.mark.parametrize("wide", [1, 5, 31])
def test_a_running_median_is_that_of_the_library(wide: int) -> None:
    known = ndimage.median_filter(ONE, size=wide, mode="nearest")
    np.testing.assert_array_equal(running_median(ONE, wide), known)
