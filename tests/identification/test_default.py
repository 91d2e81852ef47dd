"""The default model has mechanics exactly where a record can see them, and says why else."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import SecondOrder
from piezo_opt.identification import default
from piezo_opt.identification.default import excitation
from piezo_opt.measurement import FloatArray
from tests.identification.truth import MOVING, STILL, TRUTH, record


def stepped(rate: float, samples: int = 800) -> tuple[FloatArray, FloatArray]:
    time = np.arange(samples) / rate
    at = np.array([0, 0.2, 0.201, 0.4, 0.401, 0.6, 0.601, 0.8, 0.801, 1.0]) * time[-1]
    return time, np.interp(time, at, [0, 20, 60, 60, 10, 10, 50, 20, 0, 0])


def shaken(hertz: float, zeta: float, rate: float, drive: FloatArray | None = None,
           noise: float = 5e-9) -> po.Measurement:  # fmt: skip
    time, steps = stepped(rate)
    truth = {**TRUTH, "second_order.omega": 2 * np.pi * hertz, "second_order.zeta": zeta}
    return record(MOVING, truth, time, steps if drive is None else drive, noise=noise)


def test_a_resonance_that_rings_is_kept() -> None:
    seen = shaken(300.0, 0.03, 5000.0)
    model, remarks = po.default_model(seen)
    assert [n for n, _ in model] == ["piezo_gain", "bouc_wen", "second_order", "offset"]
    assert remarks == ()
    fit = po.solve(po.Identification(model, seen))
    assert fit.values["second_order.omega"] == pytest.approx(2 * np.pi * 300.0, rel=5e-3)


def still(record: po.Measurement) -> str:
    model, remarks = po.default_model(record)
    assert [n for n, _ in model] == ["piezo_gain", "bouc_wen", "offset"]
    (remark,) = remarks
    assert "quasi-static" in remark
    assert "sample at ten times its frequency and excite it" in remark
    assert f"{record.rate:.4g} samples/s" in remark
    return remark


def test_slow_sampling_hides_it() -> None:
    time = np.arange(400) / 20.0
    drive = 30.0 - 30.0 * np.cos(2 * np.pi * 0.3 * time) * np.exp(-time / 20)
    truth = {**TRUTH, "second_order.omega": 2 * np.pi * 300.0, "second_order.zeta": 0.03}
    still(record(MOVING, truth, time, drive, noise=5e-9))


@pytest.mark.parametrize(("phase", "why"), [(-np.pi / 2, ""), (0.0, "no power near the best")])
def test_a_pure_sine_hides_it(phase: float, why: str) -> None:
    # At phase 0 it sets in with a speed: the best resonance is then the ringing of the onset.
    drive = 30.0 + 30.0 * np.sin(2 * np.pi * 12.5 * np.arange(800) / 5000.0 + phase)
    assert why in still(shaken(300.0, 0.03, 5000.0, drive))


@pytest.mark.parametrize(("share", "seen"), [(7e-10, True), (2e-10, False)])
def test_the_bar_stands_between_a_sine_and_the_harmonics_of_a_triangle(
    share: float, seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A chirp that ends below its resonance had shown that it halves the residual, by 8e-10."""
    monkeypatch.setattr(default, "excitation", lambda *_: share)
    model, _ = po.default_model(shaken(300.0, 0.03, 5000.0))
    assert ("second_order" in model) is seen


def test_a_resonance_beyond_what_the_sampling_holds_is_not_kept() -> None:
    assert "fewer than 2.5 samples a cycle" in still(shaken(2150.0, 0.01, 5000.0))


def test_what_is_overdamped_has_no_resonance() -> None:
    remark = still(shaken(60.0, 2.0, 5000.0))
    assert "overdamped" in remark


def test_an_actuator_without_mechanics_gets_none() -> None:
    time, drive = stepped(5000.0)
    remark = still(record(STILL, TRUTH, time, drive, noise=5e-9))
    assert "do not lower the residual" in remark


def test_the_share_of_a_band_in_a_drive() -> None:
    time = np.arange(4000) / 4000.0
    one, two = np.sin(2 * np.pi * 100 * time), np.sin(2 * np.pi * 300 * time)
    both = po.Measurement(time, 3.0 * one + two, time)
    assert excitation(both, 2 * np.pi * 300.0) == pytest.approx(0.1, rel=1e-3)
    assert excitation(both, 2 * np.pi * 100.0) == pytest.approx(0.9, rel=1e-3)
    assert excitation(po.Measurement(time, one, time), 2 * np.pi * 900.0) < 1e-10


def test_a_campaign_is_judged_by_its_first_record() -> None:
    seen = shaken(300.0, 0.03, 5000.0)
    time, drive = stepped(5000.0)
    blind = record(STILL, TRUTH, time, drive, noise=5e-9).rename("blind")
    assert SecondOrder in {type(e) for _, e in po.default_model([seen, blind])[0]}
    assert SecondOrder not in {type(e) for _, e in po.default_model([blind, seen])[0]}


def test_a_harmonic_shakes_more_than_the_noise_of_a_sine() -> None:
    """The hundredth harmonic of a triangle, against the noise of a recorded sine."""
    time = np.arange(8000) / 4000.0
    triangle = po.Measurement(
        time, 60.0 * np.abs((8.0 * time + 1.0) % 2.0 - 1.0), 1e-7 * time, allow_saturated=True
    )
    wave = 30.0 * np.sin(2.0 * np.pi * 4.0 * time)
    noise = 3e-3 * np.random.default_rng(0).normal(size=time.size)
    sine = po.Measurement(time, wave + noise, 1e-7 * wave)
    omega = 2.0 * np.pi * 400.0
    assert 1e-9 < excitation(sine, omega) < 1e-8
    assert 1e-7 < excitation(triangle, omega) < 1e-6
