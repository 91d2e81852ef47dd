"""The moving-horizon estimate: Kalman's on a linear model; lost readings, no noise, a loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_opt.control import ModelPlant, MovingHorizon, Observer
from piezo_opt.effects import Creep, PiezoGain, SecondOrder
from piezo_opt.errors import InputError
from tests.control.test_predictive import PERIOD, STAGE, VALUES

LINEAR = PiezoGain() + Creep(elements=1) + SecondOrder()
NUMBERS = {k: v for k, v in VALUES.items() if not k.startswith("bouc")}


def signals(samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Drives and readings of a linear plant that is not quite the model, some of them lost."""
    generator = np.random.default_rng(1)
    drives = np.cumsum(generator.normal(size=samples))
    readings = 1.5e-7 * drives + 1e-8 * generator.normal(size=samples)
    readings[[7, 8, 30]] = [np.nan, np.inf, np.nan]
    return drives, readings


@pytest.mark.parametrize("window", [1, 4, 25])
def test_on_a_linear_model_it_is_kalman_s_filter(window: int) -> None:
    noises = {"period": PERIOD, "noise": 1e-8, "drive_noise": 0.5, "drift": 2e-9}
    kalman = Observer(LINEAR, NUMBERS, **noises)
    moving = MovingHorizon(LINEAR, NUMBERS, window=window, **noises)  # type: ignore[arg-type]
    theirs, own = kalman.begin(0.0), moving.begin(0.0)
    for drive, reading in zip(*(one.tolist() for one in signals(45)), strict=True):
        theirs = kalman.after(theirs, drive, reading)
        own = moving.after(own, drive, reading)
        size = np.sqrt(np.diag(theirs.covariance))
        assert np.abs(own.estimate.states - theirs.states).max(initial=0.0) >= 0.0
        assert np.abs((own.estimate.states - theirs.states) / size).max() < 1e-8
        assert own.estimate.covariance == pytest.approx(
            theirs.covariance, rel=1e-6, abs=1e-8 * float(np.outer(size, size).min())
        )
        assert own.estimate.used == np.isfinite(reading)
    assert len(own.readings) == min(window, 45)


def test_a_reading_that_is_none_has_no_weight() -> None:
    """Lost readings and none at all are the same: the model goes on alone."""
    moving = MovingHorizon(STAGE, VALUES, period=PERIOD, noise=5e-9)
    plant, known = ModelPlant(STAGE, VALUES), moving.begin(0.0, uncertainty=0.0)
    plant.begin(0.0)
    for k in range(30):
        drive = 20.0 * float(np.sin(0.3 * k))
        place = plant.advance(drive, PERIOD)
        known = moving.after(known, drive, float("nan") if k % 2 else place)
    assert known.estimate.states[:-1] == pytest.approx(plant._x, abs=2e-9, rel=1e-3)


def test_without_any_noise_it_is_the_model() -> None:
    """Nothing may move: no program is left, and the answer is the simulation."""
    moving = MovingHorizon(STAGE, VALUES, period=PERIOD, noise=1e-9, drive_noise=0.0, drift=0.0)
    plant, known = ModelPlant(STAGE, VALUES), moving.begin(0.0, uncertainty=0.0)
    plant.begin(0.0)
    for k in range(25):
        drive = 30.0 * float(np.sin(0.2 * k))
        plant.advance(drive, PERIOD)
        known = moving.after(known, drive, 1e-6)
    assert known.estimate.states[:-1] == pytest.approx(plant._x, rel=1e-9)
    assert known.estimate.states[-1] == 0.0
    assert (known.estimate.covariance == 0.0).all()


def test_it_finds_the_state_of_a_loop() -> None:
    """Begun with one that is 0.5 um off; after five readings it is known to 3 nm, by both."""
    noises = {"period": PERIOD, "noise": 2e-9, "drive_noise": 0.01, "drift": 0.0}
    moving = MovingHorizon(STAGE, VALUES, window=20, **noises)  # type: ignore[arg-type]
    index = moving.observer.horizon.system.state_names.index("bouc_wen.h")
    plant, generator = ModelPlant(STAGE, VALUES), np.random.default_rng(0)
    plant.begin(0.0)
    begin = moving.observer.begin(0.0, uncertainty=0.0)
    wrong, spread = begin.states.copy(), begin.covariance.copy()
    wrong[index], spread[index, index] = 5e-7, 5e-7**2
    filtered = replace(begin, states=wrong, covariance=spread)
    known = moving.at(filtered)
    for k in range(30):
        drive = 40.0 * float(1.0 - np.cos(2.0 * np.pi * 20.0 * PERIOD * k))
        reading = plant.advance(drive, PERIOD) + 2e-9 * float(generator.normal())
        filtered = moving.observer.after(filtered, drive, reading)
        known = moving.after(known, drive, reading)
        off = known.estimate.states[index] - plant._x[index]
        if k >= 5:
            assert abs(off) < 3e-9
            assert abs(off - (filtered.states[index] - plant._x[index])) < 0.1e-9
    assert known.iterations >= 1


def test_bad_windows_are_refused() -> None:
    with pytest.raises(InputError, match="one reading and one linearisation"):
        MovingHorizon(STAGE, VALUES, period=PERIOD, noise=1e-9, window=0)
