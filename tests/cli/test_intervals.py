"""``piezo-opt fit --intervals``: what it prints, writes and keeps."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import piezo_opt as po
from piezo_opt import datasets
from piezo_opt.cli import app

LOOP = str(datasets.path("thesis/hysteresis.csv"))


def test_a_profile_is_printed_and_written(tmp_path: Path) -> None:
    out = tmp_path / "fit.json"
    result = CliRunner().invoke(app, ["fit", LOOP, "--intervals", "profile", "--json", str(out)])
    assert result.exit_code == 0, result.output
    assert "Profile likelihood of 5 unknowns." in result.stdout
    told = json.loads(out.read_text())["intervals"]
    assert told["schema"] == "piezo_opt/profile/1"
    model, _ = po.default_model(po.load("thesis/hysteresis"))
    fit = po.solve(po.Identification(model, po.load("thesis/hysteresis")))
    alpha = told["parameters"]["bouc_wen.alpha"]
    low, high = po.profile_likelihood(fit, ["bouc_wen.alpha"]).interval("bouc_wen.alpha")
    assert (alpha["low"], alpha["high"]) == pytest.approx((low, high), rel=1e-6)


def test_a_bootstrap_goes_on_from_its_log(tmp_path: Path) -> None:
    log, out = tmp_path / "run.h5", tmp_path / "fit.json"
    asked = ["fit", LOOP, "--intervals", "bootstrap", "--replicates", "30", "--log", str(log)]
    first = CliRunner().invoke(app, asked)
    assert first.exit_code == 0, first.output
    assert "Bootstrap: 30 replicates" in first.stdout
    assert (tmp_path / "run.intervals.h5").exists()
    more = CliRunner().invoke(app, [*asked[:5], "40", *asked[6:], "--json", str(out), "--quiet"])
    assert more.exit_code == 0, more.output
    assert json.loads(out.read_text())["intervals"]["replicates"] == 40
    other = CliRunner().invoke(app, [*asked, "--seed", "1"])
    assert other.exit_code == 2
    assert "belongs to another question" in other.stderr
