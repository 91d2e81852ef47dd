"""The command and the pictures of black-box linear models."""

from __future__ import annotations

import json
from pathlib import Path

import control
import numpy as np
import pytest
from click.testing import CliRunner, Result

import piezo_opt as po
from piezo_opt.cli import app
from tests.linear_models.plants import held, second_order, steps
from tests.linear_models.test_frequency import realisation


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["linear", *[str(one) for one in arguments]])


@pytest.fixture
def record(tmp_path: Path) -> Path:
    file = tmp_path / "steps.csv"
    po.write(held(second_order(), steps(1, 400), 2e-8), file)
    return file


def test_one_order(record: Path, tmp_path: Path) -> None:
    done = run(record, "--poles", 2, "--zeros", 1, "--json", tmp_path / "fit.json",
               "--report", tmp_path / "fit.html")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "2 poles, 1 zero; the drive is taken as held" in done.stdout
    told = json.loads((tmp_path / "fit.json").read_text())
    assert told["schema"] == "piezo_opt.linear_model/1"
    assert np.abs(complex(*told["poles"][0])) == pytest.approx(2 * np.pi * 20.0, rel=5e-3)
    page = (tmp_path / "fit.html").read_text()
    for title in ("Poles and zeros", "Frequency response", "Answer to a step", "Error with itself"):
        assert title in page


def test_a_search_is_judged_on_the_rest(record: Path, tmp_path: Path) -> None:
    done = run(record, "--poles", "1-2", "--split", "0.5 s", "--report", tmp_path / "s.html")
    assert done.exit_code == 0, done.output
    assert "test fit %" in done.stdout
    assert "Orders" in (tmp_path / "s.html").read_text()


def test_a_frequency_response(tmp_path: Path) -> None:
    file = tmp_path / "multisine.csv"
    po.write(realisation(1, noise=1e-9, square=0.01), file)
    done = run(file, "--response", "--json", tmp_path / "r.json", "--report", tmp_path / "r.html")
    assert done.exit_code == 0, done.output
    assert "even" in done.stdout
    assert json.loads((tmp_path / "r.json").read_text())["periods"] == 4
    assert "Where the drive is silent" in (tmp_path / "r.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--poles", "two"), "a number or a range"),
        (("--poles", "3-1"), "goes up"),
        (("--poles", "0"), "at least one pole"),
        (("--poles", "2", "--zeros", "4"), "give 0 to 2"),
        (("--response",), "neither has a period"),
        (("--start", "periodic"), "FREE or at REST"),
        (("--poles", "2", "--zeros", "0", "--reduce", "3"), "give 1 to 2"),
        (("--response", "--reduce", "1"), "has no poles"),
    ],
)
def test_bad_input_is_one_sentence(record: Path, arguments: tuple[str, ...], words: str) -> None:
    done = run(record, *arguments)
    assert done.exit_code == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert words in done.stderr


def test_fewer_poles_and_what_that_costs(record: Path, tmp_path: Path) -> None:
    done = run(record, "--poles", 3, "--zeros", 1, "--reduce", 2, "--json", tmp_path / "r.json")
    assert done.exit_code == 0, done.output
    assert "Reduced to 2 of 3 poles" in done.stdout
    told = json.loads((tmp_path / "r.json").read_text())
    reduced = told["reduced"]
    assert len(reduced["A"]) == 2
    assert reduced["bound"] == pytest.approx(2.0 * reduced["singular_values"][2])
    assert reduced["step"]["final"] == pytest.approx(told["dc_gain"], rel=1e-6)


def test_an_unstable_model_is_not_reduced(tmp_path: Path) -> None:
    drive = steps(1, 400)
    growing = held(control.tf([1e-7], [1.0, -2.0]), drive)
    po.write(growing, tmp_path / "growing.csv")
    done = run(tmp_path / "growing.csv", "--poles", 1, "--zeros", 0, "--unstable", "--reduce", 1)
    assert done.exit_code == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert "an unstable system cannot be balanced" in done.stderr


def test_the_front_door() -> None:
    fit = po.fit_transfer(held(second_order(), steps(2, 300)), 2)
    assert isinstance(fit, po.TransferFit)
