"""How a drive moved between samples is seen where a record can show it, and left open elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import BoucWen, Delay, Offset, PiezoGain, SecondOrder
from piezo_opt.identification import as_driven
from piezo_opt.measurement import Between, Measurement
from piezo_opt.modelfile import read_model
from piezo_opt.simulation import simulate

STEP = 1e-3
VALUES = {
    "piezo_gain.d": 1e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 0.02, "bouc_wen.gamma": 0.005,
    "second_order.omega": 2.0 * np.pi * 70.0, "second_order.zeta": 0.05, "offset.y0": 0.0,
}  # fmt: skip


def multisine(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    time = np.arange(4000) * STEP
    lines = np.arange(1.0, 80.0, 2.0)
    waves = np.cos(2.0 * np.pi * lines * time[:, None] + generator.uniform(0.0, 6.28, lines.size))
    drive = waves.sum(axis=1)
    return np.asarray(50.0 + 40.0 * drive / np.abs(drive).max())


def record(drive: np.ndarray, between: Between, delay: float = 0.0) -> Measurement:
    """What a plant that is driven so reads, with 2 nm of noise, as a file that does not say how."""
    model = PiezoGain() + BoucWen() + SecondOrder() + Offset()
    values = dict(VALUES)
    if delay:
        model, values = model + Delay(), {**values, "delay.T": delay}
    time = np.arange(drive.size) * STEP
    asked = Measurement(time, drive, 1e-7 * drive, between=between)
    reading = simulate(model, asked, values).reading
    noise = 2e-9 * np.random.default_rng(1).standard_normal(drive.size)
    return Measurement(time, drive, reading + noise, name="loop")


@pytest.mark.parametrize("seed", [0, 1])
def test_a_held_drive_is_seen(seed: int) -> None:
    seen = record(multisine(seed), Between.HELD)
    assert seen.between is Between.UNKNOWN
    campaign, (sentence,) = as_driven(seen)
    assert campaign.records[0].between is Between.HELD
    assert "loop: the drive is taken as held" in sentence
    assert "(500 us) late" in sentence


@pytest.mark.parametrize("delay", [0.0, 0.35 * STEP, 0.7 * STEP])
def test_a_delay_is_no_held_drive(delay: float) -> None:
    campaign, said = as_driven(record(multisine(2), Between.LINEAR, delay))
    assert campaign.records[0].between is Between.UNKNOWN
    assert said == ()


def test_what_a_slow_drive_cannot_show_stays_open() -> None:
    time = np.arange(4000) * STEP
    slow = 50.0 + 40.0 * np.sin(2.0 * np.pi * 0.5 * time)
    smooth = record(slow, Between.LINEAR)
    assert as_driven(smooth)[0].records[0].between is Between.UNKNOWN


def test_what_was_said_stays() -> None:
    seen = record(multisine(0), Between.HELD).with_(between=Between.LINEAR)
    campaign, said = as_driven(seen)
    assert campaign.records[0] is seen
    assert said == ()


def test_a_fit_takes_other_records_as_its_own(tmp_path: Path) -> None:
    held, _ = as_driven(record(multisine(0), Between.HELD))
    fit = po.solve(po.Identification(po.default_model(held)[0], held))
    assert fit.rms == pytest.approx(2e-9, rel=0.05)
    other = record(multisine(4), Between.HELD)
    left = other.position - fit.predict(other)
    assert float(np.sqrt(np.mean(left**2))) == pytest.approx(2e-9, rel=0.1)
    fit.write_json(tmp_path / "fit.json")
    question = read_model(tmp_path / "fit.json").question(other)
    assert question.campaign.records[0].between is Between.HELD
