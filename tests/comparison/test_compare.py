"""Fits side by side: on their own record and on one that none has seen."""

from __future__ import annotations

import json

import numpy as np
import pytest

from piezo_opt import datasets, demo
from piezo_opt.comparison import compare
from piezo_opt.comparison.labels import labels
from piezo_opt.effects.catalogue import effect
from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit, solve


@pytest.fixture(scope="module")
def plain() -> Fit:
    return solve(demo.question())


@pytest.fixture(scope="module")
def richer(plain: Fit) -> Fit:
    model = plain.model + effect("asymmetry")
    return solve(demo.question().with_model(model), start=plain)


def test_the_thesis_loop(plain: Fit) -> None:
    entry = compare(plain).entries[0]
    assert entry.metrics.rms * 1e6 == pytest.approx(0.1690, abs=1e-4)
    assert entry.metrics.fit_percent == pytest.approx(96.0, abs=0.05)
    assert (entry.metrics.samples, entry.metrics.unknowns) == (51, 4)
    assert entry.metrics.rms == pytest.approx(plain.rms)
    assert entry.metrics.fit_percent == pytest.approx(plain.fit_percent)
    assert entry.sentences[0] == "The largest error is -714.9 nm, at 50 s and 0 V, unloading."


def test_two_models_side_by_side(plain: Fit, richer: Fit) -> None:
    both = compare(plain, richer)
    assert [entry.label for entry in both.entries] == [
        "piezo_gain + bouc_wen + second_order",
        "+ asymmetry",
    ]
    assert both.best() is both.entries[1]
    text = str(both)
    assert "Error on the record hysteresis" in text
    assert "169 nm" in text
    assert "+ asymmetry" in text
    assert not both.held_out


def test_on_a_held_out_part(plain: Fit) -> None:
    train, test = datasets.load("thesis/hysteresis").split("35 s")
    fit = solve(demo.question().with_records(train))
    held = compare(fit, on=test)
    entry = held.entries[0]
    assert held.held_out
    assert entry.metrics.samples == 16
    assert entry.metrics.bic is None
    expected = (test.position - fit.predict(test))[test.counted]
    assert entry.metrics.rms == pytest.approx(float(np.sqrt(np.mean(expected**2))))
    assert "held-out record hysteresis" in str(held)
    assert "BIC" not in str(held)
    # Sixteen samples cannot show that an error is white.
    assert held.to_dict()["entries"][0]["records"]["hysteresis"]["white"] is None
    # The record that was fitted is no test, whoever passes it.
    assert not compare(plain, on=plain.records).held_out


def test_plain_data(plain: Fit, richer: Fit) -> None:
    data = json.loads(json.dumps(compare(plain, richer).to_dict(), allow_nan=False))
    assert data["schema"] == "piezo_opt/comparison/1"
    first = data["entries"][0]
    assert first["rms"] == pytest.approx(1.69e-7, rel=1e-3)
    assert first["records"]["hysteresis"]["white"] is False
    assert first["model"]["effects"][0]["effect"] == "piezo_gain"


def test_labels() -> None:
    base = Model.of(effect("piezo_gain"), effect("bouc_wen"))
    assert labels([base]) == ("piezo_gain + bouc_wen",)
    assert labels([base, base]) == ("piezo_gain + bouc_wen (#1)", "piezo_gain + bouc_wen (#2)")
    creep, drift = base + effect("creep"), base + effect("drift")
    assert labels([creep, drift]) == ("+ creep", "+ drift")


def test_refusals(plain: Fit) -> None:
    with pytest.raises(InputError, match="at least one fit"):
        compare()
    with pytest.raises(InputError, match="2 names for 1 fits"):
        compare(plain, names=("a", "b"))
