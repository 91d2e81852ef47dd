"""``piezo-opt signal``: each kind makes its drive, and says what it is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from piezo_opt.cli import app
from piezo_opt.measurement import Measurement
from piezo_opt.readers import write


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["signal", *(str(one) for one in arguments)])


@pytest.mark.parametrize(
    ("kind", "options", "said"),
    [
        ("triangle", ("--frequency", "2 Hz", "--periods", "3"), "triangle 0..100 V, 2 Hz"),
        ("square", ("--duty", "0.25"), "25 % high"),
        ("staircase", ("--levels", "0,50 V", "--hold", "0.5 s"), "staircase 0, 50 V, 500 ms each"),
        ("decaying", ("--count", "3", "--slew", "100 V/s"), "50 % for the slew limit"),
        ("chirp", ("--duration", "1 s", "--linear"), "1 to 100 Hz, linear"),
        ("multisine", ("--lines", "odd", "--schroeder"), "50 odd lines"),
    ],
)
def test_kinds(kind: str, options: tuple[str, ...], said: str, tmp_path: Path) -> None:
    out = tmp_path / "drive.csv"
    done = run(kind, *options, "--out", out, "--picture", tmp_path / "drive.png")
    assert done.exit_code == 0, done.output
    assert said in done.stdout
    read = np.loadtxt(out, delimiter=",", skiprows=2)
    assert read[:, 1].max() <= 100.0
    assert (tmp_path / "drive.png").read_bytes()[:4] == b"\x89PNG"
    again = run(kind, *options, "--out", out)
    assert again.exit_code == 2
    assert "exists already" in again.stderr


def test_sketch_and_refusals(tmp_path: Path) -> None:
    assert run("square", "--high", "5 V", "--arduino", tmp_path / "s.ino").exit_code == 0
    for arguments, words in (
        (("triangle", "--low", "5 kg"), "is not a quantity in V"),
        (("triangle", "--stroke", "5 um"), "give two positions"),
        (("triangle", "--stroke", "0 um..5 um"), "needs a fit"),
        (("staircase", "--levels", "a,b"), "give numbers and a unit"),
    ):
        done = run(*arguments)
        assert done.exit_code == 2
        assert words in done.stderr


LAG = 'effects = ["piezo_gain", "amplifier_lag"]\n'
DELAY = 'effects = ["piezo_gain", "delay"]\n'


@pytest.fixture
def loop(tmp_path: Path) -> Path:
    time = np.arange(400) / 400.0
    drive = 50.0 - 50.0 * np.cos(4.0 * np.pi * time)
    late = 50.0 - 50.0 * np.cos(4.0 * np.pi * (time - 0.01))
    noise = 2e-8 * np.random.default_rng(0).normal(size=time.size)
    file = tmp_path / "loop.csv"
    write(Measurement(time, drive, 1e-7 * late + noise), file)
    return file


def test_the_json_of_a_fit_predicts_the_stroke(tmp_path: Path) -> None:
    (tmp_path / "gain.toml").write_text(
        'effects = ["piezo_gain"]\nvalues = {"piezo_gain.d" = 1e-7}\n'
    )
    out = tmp_path / "kept.csv"
    limits = ("--fit", tmp_path / "gain.toml", "--stroke", "0 um..5 um", "--out", out)
    done = run("triangle", "--high", "100 V", *limits)
    assert done.exit_code == 0, done.output
    assert "scaled to 50 % for the stroke limit" in done.stdout
    assert np.loadtxt(out, delimiter=",", skiprows=2)[:, 1].max() == pytest.approx(50.0, rel=1e-6)
    done = run("triangle", "--stroke", "0 um..5 um")
    assert done.exit_code == 2
    assert "--fit FIT.json" in done.stderr


def test_best_and_between(loop: Path, tmp_path: Path) -> None:
    for name, text in (("lag", LAG), ("delay", DELAY)):
        (tmp_path / f"{name}.toml").write_text(text)
    out, told = tmp_path / "next.csv", tmp_path / "next.json"
    few = ("--evaluations", "6", "--slew", "5 kV/s", "--noise", "20 nm", "--json", told)
    done = run("best", loop, "--model", tmp_path / "delay.toml", "--for", "delay.T",
               "--out", out, *few)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "delay.T will be known" in done.stdout
    assert json.loads(told.read_text())["schema"] == "piezo_opt/best-drive/1"
    assert np.loadtxt(out, delimiter=",", skiprows=2).shape == (400, 2)
    models = ("--model", tmp_path / "lag.toml", "--model", tmp_path / "delay.toml")
    done = run("between", loop, *models, *few, "--overwrite")
    assert done.exit_code == 0, done.output
    assert "sigmas" in done.stdout
    assert json.loads(told.read_text())["models"] == ["lag", "delay"]
    done = run("between", loop, *models[:2])
    assert done.exit_code == 2
    assert "two model files" in done.stderr
