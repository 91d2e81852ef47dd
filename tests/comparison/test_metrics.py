"""The measures against numbers computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_opt import datasets
from piezo_opt.comparison.metrics import (
    aic,
    bic,
    fit_percent,
    fpe,
    iae,
    largest,
    measure,
    mse,
    rms,
    uncontrolled_iae,
)
from piezo_opt.comparison.misfit import Misfit
from piezo_opt.errors import InputError
from piezo_opt.measurement import Measurement

ERROR = np.array([3.0, -4.0, 0.0, 0.0])


def test_squares() -> None:
    assert mse(ERROR) == pytest.approx(25.0 / 4.0)
    assert rms(ERROR) == pytest.approx(2.5)
    assert largest(ERROR) == 4.0


def test_fit_percent() -> None:
    measured = np.array([0.0, 0.0, 10.0, 10.0])  # |y - mean| = sqrt(4 * 25) = 10
    assert fit_percent(measured, ERROR) == pytest.approx(50.0)
    assert fit_percent(measured, np.zeros(4)) == 100.0
    assert fit_percent(measured, measured - 5.0) == pytest.approx(0.0)
    assert np.isnan(fit_percent(np.ones(4), ERROR))


def test_integral_on_uneven_time() -> None:
    # Trapezoids: (3 + 4) / 2 * 1 + (4 + 0) / 2 * 2 + 0
    assert iae(np.array([0.0, 1.0, 3.0, 4.0]), ERROR) == pytest.approx(3.5 + 4.0)


def test_criteria() -> None:
    error = np.full(20, 2.0)
    assert fpe(error, 4) == pytest.approx(4.0 * 1.2 / 0.8)
    assert fpe(error, 20) == np.inf
    deviance = 20 * (np.log(2 * np.pi * 4.0) + 1.0)
    assert aic(error, 4) == pytest.approx(deviance + 8.0)
    assert bic(error, 4) == pytest.approx(deviance + 4.0 * np.log(20.0))


def test_gaussian_deviance_is_minus_twice_the_likelihood() -> None:
    error = np.random.default_rng(0).normal(size=200) * 1e-8
    size = np.sqrt(np.mean(error**2))
    density = np.exp(-0.5 * (error / size) ** 2) / (size * np.sqrt(2 * np.pi))
    assert aic(error, 0) == pytest.approx(-2.0 * np.sum(np.log(density)))


def test_the_thesis_loop_is_off_its_line_by_67_um_s() -> None:
    record = datasets.load("thesis/hysteresis")
    assert uncontrolled_iae(record) * 1e6 == pytest.approx(67.0, abs=0.05)


def test_start_up_does_not_count_and_records_add_up() -> None:
    time = np.arange(10.0)
    drive = np.sin(time)
    reading = np.where(time < 5.0, 100.0 + drive, drive)
    record = Measurement(time=time, drive=drive, position=reading, startup=5.0)
    misfit = Misfit(record, drive + 1.0)
    one = measure([misfit], 2, held_out=False)
    assert (one.samples, one.rms, one.largest) == (5, pytest.approx(1.0), pytest.approx(1.0))
    assert one.iae == pytest.approx(4.0)
    both = measure([misfit, misfit], 2, held_out=True)
    assert (both.samples, both.iae) == (10, pytest.approx(8.0))
    assert both.fit_percent == pytest.approx(one.fit_percent)
    assert (both.fpe, both.aic, both.bic) == (None, None, None)


def test_a_misfit_refuses_what_belongs_to_another_record() -> None:
    record = datasets.load("thesis/hysteresis")
    with pytest.raises(InputError, match="simulate on this very record"):
        Misfit(record, np.zeros(3))
    with pytest.raises(InputError, match="not finite"):
        Misfit(record, np.full(len(record), np.nan))
