"""Is it the wrong hysteresis: a rival law wins where the truth is the rival, and only there."""

from __future__ import annotations

import numpy as np

import piezo_opt as po
from piezo_opt.diagnosis.held_out import hold_out
from piezo_opt.diagnosis.rivals import rivals
from piezo_opt.effects import BoucWen, Model, Offset, PiezoGain, PrandtlIshlinskii

_NOISE = 2e-9


def _record(model: Model, values: dict[str, float]) -> po.Measurement:
    """Minor loops of a triangle that shrinks and grows, read with white noise."""
    t = np.arange(1200) / 100.0
    corners = np.array([0, 60, 10, 50, 20, 45, 0, 30, 5, 55, 15, 40, 0], dtype=float)
    drive = np.interp(t, np.linspace(0.0, 12.0, corners.size), corners)
    blank = po.Measurement(t, drive, 1e-7 * drive)
    reading = po.simulate(model, blank, values).reading
    noise = _NOISE * np.random.default_rng(2).normal(size=t.size)
    return blank.with_(position=reading + noise)


def _tried(record: po.Measurement) -> dict[str, bool]:
    question = po.Identification(PiezoGain() + BoucWen() + Offset(), record)
    held = hold_out(question, None)
    fit = po.solve(held.question)
    found = rivals(fit, held, [BoucWen, PrandtlIshlinskii], threads=1)
    assert [r.name for r in found] == ["prandtl_ishlinskii"]
    return {r.name: r.better for r in found}


def test_play_operators_are_recognised() -> None:
    truth = PiezoGain() + PrandtlIshlinskii() + Offset()
    values = {"prandtl_ishlinskii.r": 24.0, "prandtl_ishlinskii.rho": 3e-8}
    assert _tried(_record(truth, values)) == {"prandtl_ishlinskii": True}


def test_a_bouc_wen_loop_keeps_its_law() -> None:
    truth = PiezoGain() + BoucWen() + Offset()
    assert _tried(_record(truth, {"bouc_wen.beta": 0.05})) == {"prandtl_ishlinskii": False}
