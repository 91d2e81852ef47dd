"""``piezo-opt signal``: each kind makes its drive, and says what it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from piezo_opt.cli import app


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["signal", *(str(one) for one in arguments)])


@pytest.mark.parametrize(
    ("kind", "options", "said"),
    [
        ("triangle", ("--frequency", "2 Hz", "--periods", "3"), "triangle 0..100 V, 2 Hz"),
        ("square", ("--duty", "0.25"), "25 % high"),
        ("staircase", ("--levels", "0,50 V", "--hold", "0.5 s"), "staircase 0, 50 V, 0.5 s each"),
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
