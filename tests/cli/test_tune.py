"""``piezo-opt tune``: from the JSON of a fit to a design, its picture and its JSON."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import piezo_opt as po
from piezo_opt.cli import app
from piezo_opt.control import identified
from piezo_opt.effects import BoucWen, PiezoGain, SecondOrder

MODEL = PiezoGain() + BoucWen() + SecondOrder()
VALUES = {
    "piezo_gain.d": 1.5e-7, "bouc_wen.alpha": 5e-8, "bouc_wen.beta": 0.03, "bouc_wen.gamma": -5e-3,
    "second_order.omega": 1256.0, "second_order.zeta": 0.03,
}  # fmt: skip


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["tune", *(str(one) for one in arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The JSON of a fit and the fit itself, of a record of 0.5 s with 5 nm of noise."""
    made = tmp_path_factory.mktemp("tune")
    time = 5e-4 * np.arange(1000)
    drive = 30.0 - 25.0 * np.cos(40.0 * time) + 4.0 * np.sign(np.sin(71.0 * time))
    blank = po.Measurement(time, drive, 1e-7 * drive, allow_saturated=True)
    noise = 5e-9 * np.random.default_rng(0).normal(size=time.size)
    position = po.simulate(MODEL, blank, VALUES).reading + noise
    record = po.Measurement(time, drive, position, name="stage", allow_saturated=True)
    po.write(record, made / "record.csv")
    fit = po.solve(po.Identification(MODEL, record))
    fit.write_json(made / "fit.json")
    po.save_fit(fit, made / "fit.h5")
    return made


@pytest.mark.parametrize(
    ("kind", "options", "said"),
    [
        ("pid", ("--scenarios", "3", "--criterion", "ise"), "of 1000 others"),
        ("lqr", ("--delay", "1", "--shape", "step"), "1 of delay"),
        ("mpc", ("--horizon", "10", "--periods", "1"), "horizon 10 periods (5 ms)"),
        ("shaper", ("--spread", "0.03"), "Take "),
        ("feedforward", ("--slew", "4 kV/s"), "the model errs by"),
    ],
)
def test_each_designs_says_draws_and_writes(
    kind: str, options: tuple[str, ...], said: str, folder: Path, tmp_path: Path
) -> None:
    out, picture = tmp_path / "tuned.json", tmp_path / "tuned.png"
    done = run(kind, folder / "fit.json", *options, "--json", out, "--picture", picture)
    assert done.exit_code == 0, done.output
    assert said in done.stdout
    data = json.loads(out.read_text())
    if kind != "feedforward":
        assert data["schema"] == f"piezo_opt/tune_{kind}/1"
        assert data["controller"]["kind"] == kind
    assert picture.read_bytes()[:4] == b"\x89PNG"
    # The actuator that it is for leaves from the same file, with its sampling and its doubts.
    own, theirs = identified(out), identified(folder / "fit.json")
    assert own.numbers == pytest.approx(theirs.numbers, rel=1e-12)
    assert (own.period, own.drive, own.noise) == (theirs.period, theirs.drive, theirs.noise)
    assert own.covariance == pytest.approx(theirs.covariance, rel=1e-12)
    code = CliRunner().invoke(app, ["export", "c", str(out), "--out", str(tmp_path / "plant")])
    assert code.exit_code == 0, code.output
    assert (tmp_path / "plant" / "actuator.c").exists()
    law = ["export", "controller", str(out), "--period", "500 us", "--out", str(tmp_path / "law")]
    code = CliRunner().invoke(app, law)
    if kind == "feedforward":
        assert code.exit_code == 2
        assert "is a drive and no controller" in code.stderr
    else:
        assert code.exit_code == 0, code.output
    again = run(kind, folder / "fit.json", "--json", out)
    assert again.exit_code == 2
    assert "exists already" in again.stderr


def test_the_json_of_a_fit_and_the_fit_itself_give_the_same_gains(
    folder: Path, tmp_path: Path
) -> None:
    gains = []
    for name in ("fit.json", "fit.h5"):
        out = tmp_path / f"{name}.json"
        assert run("pid", folder / name, "--noise", "1 nm", "--json", out).exit_code == 0
        gains.append(json.loads(out.read_text())["controller"])
    assert gains[0].pop("kind") == gains[1].pop("kind")
    assert gains[0] == pytest.approx(gains[1], rel=1e-6)


def test_a_record_is_followed(folder: Path) -> None:
    done = run("pid", folder / "fit.json", "--reference", folder / "record.csv")
    assert done.exit_code == 0, done.output
    assert "the position of stage, from rest, 999 samples" in done.stdout


def test_a_feedforward_can_be_played(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "drive.csv"
    done = run("feedforward", folder / "fit.json", "--out", out, "--json", tmp_path / "f.json")
    assert done.exit_code == 0, done.output
    data = json.loads((tmp_path / "f.json").read_text())
    played = np.loadtxt(out, delimiter=",", skiprows=2)
    assert played[:, 1] == pytest.approx(np.array(data["drive"]), abs=1e-6)
    assert np.abs(np.diff(played[:, 0]) - 5e-4).max() < 1e-9


@pytest.mark.parametrize(
    ("kind", "options", "words"),
    [
        ("pid", ("--high", "50 um"), "widen the limits"),
        ("pid", ("--high", "-1 um"), "lower end comes first"),
        ("pid", ("--frequency", "900 Hz"), "four samples"),
        ("pid", ("--range", "9 V", "1 V"), "is below the upper one"),
        ("lqr", ("--period", "0 s"), "time between two samples"),
        ("mpc", ("--delay", "10", "--horizon", "5"), "as long as the horizon"),
        ("shaper", ("--allowed", "2"), "give shares"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    kind: str, options: tuple[str, ...], words: str, folder: Path
) -> None:
    done = run(kind, folder / "fit.json", *options)
    assert done.exit_code == 2, done.output
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
