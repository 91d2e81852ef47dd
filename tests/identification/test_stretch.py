"""A part of a long record keeps its events: steps, late starts, the resonance of a sweep."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import Offset, PiezoGain, SecondOrder
from piezo_opt.identification.stretch import busiest
from piezo_opt.measurement import FloatArray
from tests.identification.truth import MOVING, TRUTH, record

NOISE = 5e-9
RATE = 2000.0
RESONANT = {**TRUTH, "second_order.omega": 2 * np.pi * 180.0, "second_order.zeta": 0.03}


def staircase() -> tuple[FloatArray, FloatArray]:
    """Treads of 2 s, 20 V each, from 0."""
    time = np.arange(8000) / 1000.0
    return time, 20.0 * np.floor(time / 2.0)


def late() -> tuple[FloatArray, FloatArray]:
    """Rest for longer than what is looked at of a long record, then a sine."""
    time = np.arange(26_000) / RATE
    return time, np.where(time < 10.5, 0.0, 30.0 - 30.0 * np.cos(2 * np.pi * 4 * (time - 10.5)))


def sweep(samples: int = 4000) -> tuple[FloatArray, FloatArray]:
    """1 to 400 Hz in 2 s: the drive is fastest where nothing resonates any more."""
    time = np.arange(samples) / RATE
    span = samples / RATE
    return time, 40.0 * np.sin(2 * np.pi * (time + 399.0 / (2.0 * span) * time**2))


def test_a_step_is_in_the_middle_of_its_stretch() -> None:
    time, drive = staircase()
    noise = NOISE * np.random.default_rng(0).normal(size=time.size)
    part = busiest(po.Measurement(time, drive, 1e-7 * drive + noise), 1000)
    assert len(part) == 1000
    jump = int(np.argmax(np.abs(np.diff(part.drive))))
    assert np.ptp(part.drive) == 20.0
    assert 300 < jump < 700


def test_the_resonance_of_a_sweep_is_in_its_stretch() -> None:
    time, drive = sweep()
    whole = record(MOVING, RESONANT, time, drive, noise=NOISE)
    part = busiest(whole, 1000)
    resonant = 2.0 * 179.0 / 399.0  # where 1 + 399 t / 2 is 180
    assert part.time[0] < resonant < part.time[-1]


def test_where_the_drive_rests_the_drive_says_which_stretch() -> None:
    time, drive = late()
    wandering = 1e-7 * drive + np.where(time < 10.0, 1e-5 * np.sin(2 * np.pi * 40 * time), 0.0)
    assert np.ptp(busiest(po.Measurement(time, drive, wandering), 2000).drive) == pytest.approx(60)


def test_short_records_and_steady_states_are_whole() -> None:
    time, drive = sweep()
    whole = po.Measurement(time, drive, 1e-7 * drive)
    assert busiest(whole, 4000) is whole
    steady = whole.with_(period=2.0)
    assert busiest(steady, 1000) is steady


@pytest.mark.parametrize("drive", [staircase, late])
def test_a_drive_that_rests_for_long_is_fitted(drive: object) -> None:
    time, volts = drive()  # type: ignore[operator]
    seen = record(MOVING, RESONANT, time, volts, noise=NOISE)
    model, _ = po.default_model(seen)
    fit = po.solve(po.Identification(model, seen))
    assert fit.rms == pytest.approx(NOISE, rel=0.05)


@pytest.mark.parametrize("model", [PiezoGain() + SecondOrder() + Offset(), MOVING])
def test_a_sweep_over_a_resonance_has_mechanics(model: po.Model) -> None:
    truth = {k: v for k, v in RESONANT.items() if k in model.parameters}
    seen = record(model, truth, *sweep(), noise=NOISE)
    default, remarks = po.default_model(seen)
    assert (default.names, remarks) == (MOVING.names, ())
    fit = po.solve(po.Identification(default, seen))
    assert fit.values["second_order.omega"] == pytest.approx(2 * np.pi * 180.0, rel=5e-3)
    assert fit.rms == pytest.approx(NOISE, rel=0.05)
