"""What no drive can pass: proven answers, and drives that come near it."""

from __future__ import annotations

import numpy as np
import pytest

import piezo_opt as po
from piezo_opt.effects import BoucWen, Offset, PiezoGain
from piezo_opt.errors import InputError
from piezo_opt.signals import Criterion, best_for, ceiling

NOISE = 20e-9
BOTH = ("piezo_gain.d", "offset.y0")


def fitted(model: po.Model, truth: dict[str, float]) -> po.Fit:
    time = np.arange(600) / 200.0
    drive = 40.0 - 40.0 * np.cos(2.0 * np.pi * time)
    drive[400:] *= 0.5
    record = po.Measurement(time, drive, 1e-7 * drive)
    clean = po.simulate(model, record, truth).reading
    noise = NOISE * np.random.default_rng(0).normal(size=time.size)
    question = po.Identification(model, record.with_(position=clean + noise), start=po.Start.REST)
    return po.solve(question)


@pytest.fixture(scope="module")
def line() -> po.Fit:
    return fitted(PiezoGain() + Offset(), {"piezo_gain.d": 1e-7, "offset.y0": 3e-7})


def test_a_line_is_known_at_most_root_three_times_better(line: po.Fit) -> None:
    """Half of the time at either end has the largest variance that a range allows."""
    for criterion in Criterion:
        alone = ceiling(line, ["piezo_gain.d"], criterion=criterion)
        assert alone.at_most == pytest.approx(np.sqrt(3.0), rel=0.02)
    assert alone.mixture <= alone.at_most
    # Of slope and offset together, a share w at the far end makes the variances 1 / (w (1 - w))
    # and 1 / (1 - w) of their least: (1 - w)^2 w is largest at a third, 4 / 27. The triangle's
    # are 12 and 4. Of the determinant, w (1 - w), it is half: 1 / 4, the triangle's 1 / 12.
    both = ceiling(line, BOTH, criterion=Criterion.DEVIATIONS)
    assert both.at_most == pytest.approx((12.0 * 4.0 * 4.0 / 27.0) ** 0.25, rel=0.02)
    region = ceiling(line, BOTH, criterion=Criterion.DETERMINANT)
    assert region.at_most == pytest.approx((12.0 / 4.0) ** 0.25, rel=0.02)


def test_no_drive_that_is_found_passes_it_on_a_loop() -> None:
    truth = {"piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 2e-2,
             "bouc_wen.gamma": -5e-3}  # fmt: skip
    loop = fitted(PiezoGain() + BoucWen(), truth)
    for criterion in Criterion:
        most = ceiling(loop, criterion=criterion, evaluations=100)
        told = best_for(loop, criterion=criterion, evaluations=60, possible=1)
        gain = told.gain if criterion is Criterion.DEVIATIONS else told.joint_gain
        assert 0.6 * most.at_most < gain <= most.at_most
    assert "whatever is played" in str(most)


def test_each_criterion_wins_by_its_own_measure(line: po.Fit) -> None:
    apart, together = (
        best_for(line, BOTH, criterion=one, evaluations=150, possible=1)
        for one in (Criterion.DEVIATIONS, Criterion.DETERMINANT)
    )
    # A third of the time at the far end, or half of it.
    assert np.mean(apart.drive.values > 40.0) == pytest.approx(1.0 / 3.0, abs=0.03)
    assert np.mean(together.drive.values > 40.0) == pytest.approx(0.5, abs=0.03)
    assert apart.gain > together.gain
    assert together.joint_gain > apart.joint_gain


def test_what_a_triangle_does_not_show_has_no_ceiling(line: po.Fit) -> None:
    with pytest.raises(InputError, match="does not estimate"):
        ceiling(line, ["bouc_wen.beta"])
