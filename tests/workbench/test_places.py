"""Pictures of where a residual lives carry what the comparison found."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.where import where
from piezo_opt.errors import InputError
from piezo_opt.measurement import Measurement
from piezo_opt.workbench.places import MOST, picture, pictures


def misfit(count: int) -> Misfit:
    """A residual that is a tone of 40 nm at 50 Hz and white noise, of a triangle."""
    time = np.arange(count) / 1000.0
    drive = 50.0 * (1.0 - np.abs((time / 0.4) % 2.0 - 1.0))
    error = 4e-8 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 50.0 * time)
    error += 1e-9 * np.random.default_rng(1).standard_normal(count)
    record = Measurement(time, drive, 1e-7 * drive + error)
    return Misfit(record, 1e-7 * drive)


@pytest.mark.parametrize("count", [4000, 200_000])
def test_a_tone_stands_in_the_spectrum_whatever_is_thinned(count: int) -> None:
    found = where(misfit(count))
    shown = picture(pictures(found, "V"), "frequency")
    reading, left = shown.curves
    assert reading.values.shape == left.values.shape == shown.x.shape
    assert shown.x.size <= max(MOST, found.by_frequency.frequency.size if count < 5000 else MOST)
    assert np.all(np.diff(shown.x) > 0)
    top = int(np.argmax(left.values))
    assert shown.x[top] == pytest.approx(50.0, rel=0.02)
    assert left.values[top] > 20.0 * np.median(left.values)


def test_a_band_holds_the_mean_power_of_its_lines() -> None:
    found = where(misfit(200_000)).by_frequency
    shown = picture(pictures(where(misfit(200_000)), "V"), "frequency")
    edges = np.geomspace(found.frequency[1], found.frequency[-1], MOST + 1)
    last = found.frequency >= edges[-2]
    expected = np.sqrt(np.mean(found.error[last]))
    assert shown.curves[1].values[-1] == pytest.approx(expected, rel=1e-12)


def test_means_by_branch_are_those_of_the_comparison() -> None:
    found = where(misfit(4000))
    shown = picture(pictures(found, "V"), "branch")
    assert shown.curves[0].values is found.by_branch.loading_mean
    assert shown.curves[1].values is found.by_branch.unloading_mean
    edges = found.by_branch.edges
    assert shown.x[0] == 0.5 * (edges[0] + edges[1])


def test_a_view_that_is_not_there_is_refused() -> None:
    made = pictures(where(misfit(4000)), "V")
    with pytest.raises(InputError, match="no picture by 'colour': there is branch, amplitude"):
        picture(made, "colour")
