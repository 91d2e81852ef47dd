"""How time grows, and what the best scheme gains as a resonance rises."""

from __future__ import annotations

import json

import numpy as np
import pytest

from piezo_opt.benchmark import equal_accuracy as module
from piezo_opt.benchmark.equal_accuracy import equal_accuracy, fewest
from piezo_opt.benchmark.scaling import measure_scaling
from piezo_opt.simulation.compiler import find_compiler
from piezo_opt.simulation.library import MACHINE

pytestmark = pytest.mark.skipif(
    find_compiler() is None or not MACHINE, reason="compares compiled code: no cc"
)


def test_what_is_exact_does_not_follow_every_swing() -> None:
    """The claim is 5 from a resonance at five times the sampling rate on, and none far below it."""
    found = equal_accuracy(1000, 5, ratios=(0.04, 16.0))
    slow, fast = found.paces
    assert slow.substeps == (1, 1, 1)
    assert slow.ratio < 1.5
    assert fast.substeps[0] == 1
    # omega h = 2.8 at most, or Runge-Kutta is unstable; a brief record shows that late.
    assert fast.substeps[2] >= 0.8 * 2.0 * np.pi * 16.0 / 2.8
    assert fast.substeps[1] == pytest.approx(fast.substeps[2], abs=2)
    assert fast.ratio > 4.0
    assert f"{fast.ratio:.1f}" in str(found)
    assert json.loads(json.dumps(found.to_dict()))[1]["ratio"] == fast.ratio


def test_the_fewest_sub_steps_are_found() -> None:
    asked: list[int] = []

    def way(n: int) -> object:
        asked.append(n)
        return lambda: np.array([0.0, 1.0 + (0.0 if n >= 11 else 2.0 * module.EQUAL)])

    assert fewest(way, np.array([0.0, 1.0])) == 11  # type: ignore[arg-type]
    assert len(asked) <= 9


def test_time_grows_less_than_derivatives_and_sets() -> None:
    found = measure_scaling(2000, 7, (1, 64))
    assert [*found.directions] == [0, 1, 2, 4, 8, 13]
    assert 1.0 < found.directions[13] / found.directions[0] < 14.0
    assert found.sets[64] < found.sets[1]
    assert found.sets[64] < found.alone
    assert all(f"{ns:.1f}" in str(found) for ns in found.directions.values())
    assert json.loads(json.dumps(found.to_dict()))["directions"]["13"] == found.directions[13]
