"""The cost of a fit, counted in simulations; and the table that measures it in time."""

from __future__ import annotations

from dataclasses import replace

import pytest

import piezo_opt as po
from piezo_opt.benchmark.fit_speed import measure_fit
from problems import synthetic_recovery


def test_a_fit_spends_fewer_than_sixty_simulations_with_sensitivities() -> None:
    spent = po.solve(synthetic_recovery.question()).evaluations
    # A plain simulation costs less than half of one with sensitivities.
    assert spent.with_sensitivities + 0.5 * spent.simulations < 60.0


def test_the_table_compares_with_one_simulation() -> None:
    question = synthetic_recovery.question()
    record = question.campaign.records[0]
    short = replace(question, records=record.slice(None, float(record.time[1000])))
    costs = measure_fit(short, 2, reference=False)
    assert costs.samples == 1000
    one, *others = costs.rows
    assert one.ratio == pytest.approx(1.0)
    for row in others:
        assert row.ratio == pytest.approx(row.milliseconds / one.milliseconds)
        assert row.ratio > 10.0
