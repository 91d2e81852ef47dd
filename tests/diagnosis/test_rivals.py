"""Is it the wrong hysteresis: a rival law wins where the truth is the rival, and only there."""

from __future__ import annotations

import piezo_opt as po
from piezo_opt.diagnosis.held_out import hold_out
from piezo_opt.diagnosis.rivals import Rival, in_words, rivals
from piezo_opt.effects import BoucWen, Offset, PiezoGain, PrandtlIshlinskii
from tests.diagnosis.plants import minor_loops

_NOISE = 2e-9


def _tried(record: po.Measurement) -> dict[str, bool]:
    question = po.Identification(PiezoGain() + BoucWen() + Offset(), record)
    held = hold_out(question, None)
    fit = po.solve(held.question)
    found = rivals(fit, fit, held, [BoucWen, PrandtlIshlinskii], threads=1)
    assert [r.name for r in found] == ["prandtl_ishlinskii"]
    return {r.name: r.better for r in found}


def test_play_operators_are_recognised() -> None:
    record = minor_loops(PrandtlIshlinskii(), {"r": 24.0, "rho": 3e-8}, _NOISE)
    assert _tried(record) == {"prandtl_ishlinskii": True}


def test_a_bouc_wen_loop_keeps_its_law() -> None:
    record = minor_loops(BoucWen(), {"beta": 0.05}, _NOISE)
    assert _tried(record) == {"prandtl_ishlinskii": False}


def test_words_name_what_is_better_or_say_that_nothing_is() -> None:
    dahl, play, slip = (
        Rival(name, 1e-8, None, gain, gain > 10.0)
        for name, gain in (("dahl", -4.0), ("prandtl_ishlinskii", 50.0), ("maxwell_slip", 1.0))
    )
    assert in_words(()) == ()
    assert in_words((dahl, play, slip)) == (
        "prandtl_ishlinskii fits better than the model's own law (rms 10 nm).",
    )
    assert in_words((dahl, slip)) == (
        "None of dahl and maxwell_slip fits better than the model's own law.",
    )
    assert in_words((dahl,)) == ("dahl is no better than the model's own law (rms 10 nm).",)
