"""Everything goes wrong, a little: the small version of a million samples."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from piezo_opt.benchmark.faults import EPISODE, FAULTS, LIMITS, PERIOD, STAGE, VALUES, endure
from piezo_opt.cli import app
from piezo_opt.control import InverseCompensation, Limits, Observer, tune_lqr


def test_no_drive_is_none_no_limit_is_passed_and_all_come_back() -> None:
    found = endure(1, seed=3)
    assert [row.controller for row in found.rows] == ["PID", "LQR", "inverse", "MPC"]
    for row in found.rows:
        assert row.steps == (len(FAULTS) + 1) * EPISODE
        assert row.faulty == len(FAULTS) * EPISODE // 4
        assert row.not_finite == 0
        assert row.beyond <= 1e-9
        # What it has seen is forgotten: as good as if nothing had been, within the fault's creep.
        assert row.worst < 2.5 * row.undisturbed


def test_the_command_writes_what_it_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    law = InverseCompensation.of_values(STAGE, VALUES)
    monkeypatch.setattr("piezo_opt.benchmark.faults.controllers", lambda: {"inverse": law})
    out = tmp_path / "faults.json"
    done = CliRunner().invoke(app, ["bench", "faults", "--steps", "1", "--json", str(out)])
    assert done.exit_code == 0, done.output
    assert "inverse" in done.stdout
    assert json.loads(out.read_text())["schema"] == "piezo_opt/faults/1"


def test_the_range_goes_before_the_slew_rate() -> None:
    limits = Limits(10.0, 20.0, 1e3)
    assert limits.around(15.0, 1e-3) == (14.0, 16.0)
    assert limits.around(10.5, 1e-3) == (10.0, 11.5)
    assert limits.around(0.0, 1e-3) == (10.0, 10.0)
    assert limits.around(99.0, 1e-3) == (20.0, 20.0)


def test_an_estimate_that_is_wrong_is_given_up() -> None:
    """Ten readings beyond the gate, and the eleventh is taken: a filter does not stay blind."""
    observer = Observer(STAGE, VALUES, period=PERIOD, noise=5e-9, gate=1e-6)
    estimate, used = observer.begin(0.0, uncertainty=0.0), []
    for _ in range(40):
        estimate = observer.after(estimate, 0.0, 5e-6)
        used.append(estimate.used)
    assert used.index(True) == 10
    assert all(used[10:])
    assert estimate.states[-1] == pytest.approx(5e-6, rel=0.01)
    # A sensor that says nothing is no reason.
    estimate = observer.begin(0.0)
    for _ in range(40):
        estimate = observer.after(estimate, 0.0, float("nan"))
    assert estimate.off == 0


def test_a_design_that_would_swing_for_ever_is_made_softer_and_says_so() -> None:
    time = PERIOD * np.arange(300)
    saw = 5e-6 * (1.0 - np.abs(2.0 * ((10.0 * time) % 1.0) - 1.0))
    made = [
        tune_lqr(STAGE, saw, period=PERIOD, values=VALUES, limits=LIMITS, noise=5e-9, peak=peak)
        for peak in (1.6, 2.0)
    ]
    assert [one.calm for one in made] == [True, True]
    assert [one.swinging is not None for one in made] == [False, True]
    assert max(one.margins.peak for one in made) <= 2.0 * (1.0 + 1e-3)
    assert "Made softer than the closest" in str(made[1])
    assert "Made softer" not in str(made[0])
