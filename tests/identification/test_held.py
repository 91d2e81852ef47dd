"""A held multisine over a resonance: the loop is small beside it, and must be found."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.identification.starting import another_start
from piezo_opt.identification.stuck import noise_of
from tests.identification.truth import MOVING, record

module = import_module("piezo_opt.identification.solve")
NOISE = 2e-9
TRUTH = {
    "piezo_gain.d": 1e-7, "bouc_wen.alpha": 4e-8, "bouc_wen.beta": 0.03, "bouc_wen.gamma": 0.02,
    "second_order.omega": 2.0 * np.pi * 150.0, "second_order.zeta": 0.05,
}  # fmt: skip


def multisine(seed: int, samples: int = 1500) -> po.Measurement:
    """Ten lines from 3 to 173 Hz of random phases about 50 V, held between samples of 1 kHz."""
    time = np.arange(samples) / 1000.0
    lines = np.array([3, 7, 13, 29, 47, 71, 97, 131, 149, 173])
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, lines.size)
    drive = 50.0 + 4.0 * np.sin(2.0 * np.pi * np.outer(time, lines) + phases).sum(axis=1)
    return record(MOVING, TRUTH, time, drive, noise=NOISE, seed=seed, between=po.Between.HELD)


@pytest.mark.parametrize("seed", [0, 1, 7, 8, 9, 20])
def test_the_loop_is_found_beside_the_resonance(seed: int) -> None:
    fit = po.solve(po.Identification(MOVING, multisine(seed)))
    assert fit.rms == pytest.approx(NOISE, rel=0.1)
    assert fit.at_bound == ()
    assert fit.values["bouc_wen.alpha"] == pytest.approx(4e-8, rel=0.02)
    assert fit.values["second_order.omega"] == pytest.approx(2.0 * np.pi * 150.0, rel=1e-3)
    assert "times the noise" not in fit.outcome.sentence


def test_a_fit_without_its_loop_is_told_to_explain_nothing() -> None:
    """Stuck by its start: told, and left for another one where nobody gave a start."""
    record = multisine(7)
    stuck = {**TRUTH, "bouc_wen.alpha": 0.0, "bouc_wen.gamma": -1.0}
    kept = po.solve(po.Identification(MOVING, record), start=stuck)
    assert kept.rms > 50.0 * NOISE
    assert noise_of(kept) == pytest.approx(NOISE, rel=0.2)
    assert "explains nothing of the reading" in kept.outcome.sentence
    values = po.Values({**po.Values.nominal(MOVING), **kept.values})
    found = another_start(
        po.Identification(MOVING, record), values, record.position - kept.readings[0]
    )
    assert found is not None
    assert found["bouc_wen.alpha"] == pytest.approx(4e-8, rel=0.3)


def test_a_better_start_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    stuck = po.Values({**TRUTH, "bouc_wen.alpha": 0.0, "bouc_wen.gamma": -1.0, "offset.y0": 0.0})
    monkeypatch.setattr(module, "starting_values", lambda *_: stuck)
    question = po.Identification(MOVING, multisine(7))
    fit = po.solve(question)
    assert fit.rms == pytest.approx(NOISE, rel=0.1)
    assert "A first start had ended at" in fit.outcome.sentence
    monkeypatch.setattr(module, "another_start", lambda *_: None)
    assert po.solve(question).rms > 50.0 * NOISE
