"""The drive that tells models apart: what is predicted comes out, and groups are resolved."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import AmplifierLag, BoucWen, Delay, Offset, PiezoGain
from piezo_opt.errors import InputError
from piezo_opt.signals import best_between
from piezo_opt.signals.answer import Answer, draws
from piezo_opt.signals.between import DriveBetween

NOISE, RATE = 50e-9, 1000.0
BASE = PiezoGain() + BoucWen() + Offset()
MODELS = {"amplifier_lag": BASE + AmplifierLag(), "delay": BASE + Delay()}


@pytest.fixture(scope="module")
def fits() -> dict[str, po.Fit]:
    """A lag and a delay, fitted alike to one sine, on which they are the same."""
    time = np.arange(1000) / RATE
    drive = 50.0 - 50.0 * np.cos(2.0 * np.pi * 2.0 * time)
    record = po.Measurement(time, drive, drive)
    truth = {
        "piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 2e-2,
        "bouc_wen.gamma": -5e-3, "amplifier_lag.share": 1.0, "amplifier_lag.tau": 2e-3,
    }  # fmt: skip
    clean = po.simulate(MODELS["amplifier_lag"], record, truth).reading
    noise = NOISE * np.random.default_rng(0).normal(size=time.size)
    record = record.with_(position=clean + noise)
    return {n: po.solve(po.Identification(m, record)) for n, m in MODELS.items()}


@pytest.fixture(scope="module")
def advised(fits: dict[str, po.Fit]) -> DriveBetween:
    return best_between(fits, evaluations=40, slew=2000.0)


def test_drive_is_far_better_than_a_triangle(
    fits: dict[str, po.Fit], advised: DriveBetween
) -> None:
    assert fits["delay"].rms == pytest.approx(fits["amplifier_lag"].rms, rel=2e-3)
    assert advised.sigmas > max(5.0, 3.0 * advised.of_triangle)
    assert advised.drive.slew <= 2000.0 * (1.0 + 1e-9)
    assert "separates" in advised.sentence
    assert advised.to_dict()["models"] == ["amplifier_lag", "delay"]


def test_predicted_distance_is_the_misfit_of_the_wrong_model(
    fits: dict[str, po.Fit], advised: DriveBetween
) -> None:
    """With noise, twenty records: the wrong model's misfit exceeds the right one's by d^2."""
    true, other = advised.closest
    answer = Answer(fits[true], RATE)
    clean = answer.sharp(advised.drive.values)
    old = fits[true].records[0]
    rng, gained = np.random.default_rng(8), []
    for _ in range(20):
        reading = clean + NOISE * rng.normal(size=clean.size)
        new = answer.record(advised.drive.values, reading).rename("new")
        left = [
            float(np.sum(np.square(po.solve(po.Identification(MODELS[n], (old, new))).residuals)))
            for n in (other, true)
        ]
        gained.append((left[0] - left[1]) / NOISE**2)
    assert np.sqrt(np.mean(gained)) == pytest.approx(advised.sigmas, rel=0.2)


def test_group_is_resolved(fits: dict[str, po.Fit], advised: DriveBetween) -> None:
    """Plants that the fits think possible, played with the advised drive: the truth fits best."""
    old = fits["delay"].records[0]
    rng = np.random.default_rng(3)
    right = 0
    for true in fits:
        answer = Answer(fits[true], RATE)
        for numbers in draws(answer, 6, 11):
            clean = answer.sharp(advised.drive.values, numbers)
            reading = clean + NOISE * rng.normal(size=clean.size)
            new = answer.record(advised.drive.values, reading).rename("new")
            left = {
                name: po.solve(po.Identification(model, (old, new))).rms
                for name, model in MODELS.items()
            }
            right += min(left, key=lambda name: left[name]) == true
    assert right == 12


def test_identical_models_are_not_told_apart(fits: dict[str, po.Fit]) -> None:
    told = best_between([fits["delay"], fits["delay"]], evaluations=4, possible=1)
    assert told.sigmas < 1.0
    assert "Play it longer" in told.sentence
    assert told.models == ("nothing more", "nothing more (2)")


def test_one_model_is_refused(fits: dict[str, po.Fit]) -> None:
    with pytest.raises(InputError, match="give two fits"):
        best_between([fits["delay"]])
