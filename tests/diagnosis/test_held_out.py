"""What judges is simulated once a fit, and gives the same answer to every rule that asks."""

from __future__ import annotations

import gc
from dataclasses import replace

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.diagnosis import held_out as module
from piezo_opt.diagnosis.held_out import elsewhere, error_on, hold_out
from tests.diagnosis.plants import STILL, measured, rich

TIME = np.arange(1200) / 1e3


def test_a_fit_is_judged_once_and_forgotten_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    record = measured(STILL, TIME, rich(TIME))
    held = hold_out(po.Identification(STILL, record), None)
    fit = po.solve(held.question)
    asked: list[po.Fit] = []

    def counted(one: po.Fit, on: po.Measurement | None) -> module.FloatArray | None:
        asked.append(one)
        return error_on(one, on)

    monkeypatch.setattr(module, "error_on", counted)
    first, again = elsewhere(fit, held), elsewhere(fit, held)
    assert len(asked) == 1
    assert first is again
    np.testing.assert_array_equal(first, error_on(fit, held.record))
    # Another fit is another answer, also with the same values, and so is another record.
    other = replace(fit)
    elsewhere(other, held)
    elsewhere(fit, replace(held))
    assert [one is fit for one in asked] == [True, False, True]
    assert len(held._errors) == 2
    asked.clear()
    del other
    gc.collect()
    assert len(held._errors) == 1
