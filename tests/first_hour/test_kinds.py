"""Small records of kinds that went wrong once, through the commands: the right answer and no other.

Where a search takes long on a whole record, a shorter one of the same kind is asked.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from piezo_opt.cli import app
from tests.first_hour.kinds import KINDS, LINEAR, MODES, RAIL, SLACK, put

PATIENCE = ("--max-time", "10 min")
"""A loaded machine changes no answer."""


def command(folder: Path, verb: str, name: str, *said: str) -> dict[str, Any]:
    """The JSON of a command on the record, and what it printed under ``printed``."""
    out = folder / "answer.json"
    record = put(folder, name)
    done = CliRunner().invoke(app, [verb, str(record), *said, "--json", str(out)])
    assert done.exit_code == 0, done.output
    return {**json.loads(out.read_text()), "printed": done.stdout}


def named(answer: dict[str, Any]) -> list[str]:
    """The effects that a diagnosis added under a name."""
    return [one["effect"] for one in answer["steps"]]


@pytest.mark.parametrize(
    ("name", "hertz"),
    [("sweep_linear", 180.0), ("sweep_loop", 180.0), ("sweep_long", 180.0)],
)
def test_the_default_model_finds_the_mechanics_of_a_sweep(
    tmp_path: Path, name: str, hertz: float
) -> None:
    answer = command(tmp_path, "fit", name)
    assert answer["rms"] < 1.05 * KINDS[name].noise
    found = answer["parameters"]["second_order.omega"]["value"] / (2 * np.pi)
    assert found == pytest.approx(hertz, rel=5e-3)


@pytest.mark.parametrize("name", ["staircase", "late_start"])
def test_a_drive_that_rests_for_long_is_fitted(tmp_path: Path, name: str) -> None:
    answer = command(tmp_path, "fit", name)
    assert answer["rms"] < 1.05 * KINDS[name].noise
    assert answer["fit_percent"] > 99.0


@pytest.mark.parametrize("name", ["short_staircase", "short_late_start"])
def test_and_nothing_is_missing(tmp_path: Path, name: str) -> None:
    answer = command(tmp_path, "diagnose", name, *PATIENCE)
    assert answer["verdict"] == "complete"
    assert named(answer) == []


@pytest.mark.parametrize("seed", range(11, 17))
def test_a_held_drive_leaves_the_base_model_nothing_to_explain(tmp_path: Path, seed: int) -> None:
    name = f"held_{seed}"
    said = ("--between", "held") if seed % 2 else ()  # else the record itself has to say it
    answer = command(tmp_path, "diagnose", name, *said, *PATIENCE)
    assert answer["verdict"] == "complete"
    assert named(answer) == []
    assert answer["rms_final"] < 1.05 * KINDS[name].noise


@pytest.mark.parametrize(
    ("name", "effect"),
    [("hardening", "cubic_stiffness"), ("quadratic_damping", "nonlinear_damping")],
)
def test_a_resonator_without_hysteresis_gets_one_name(
    tmp_path: Path, name: str, effect: str
) -> None:
    (tmp_path / "linear.toml").write_text(LINEAR)
    model = str(tmp_path / "linear.toml")
    answer = command(tmp_path, "diagnose", name, "--model", model, *PATIENCE)
    assert named(answer) == [effect]
    assert answer["verdict"] == "missing"
    assert answer["rms_final"] < 1.05 * KINDS[name].noise


@pytest.mark.parametrize(
    ("name", "effect"), [("late_limit", "saturation"), ("late_slew", "slew_limit")]
)
def test_what_happens_once_and_late_is_found(tmp_path: Path, name: str, effect: str) -> None:
    # Takes half a minute each: a limit that one event reaches is sought at many sizes.
    answer = command(tmp_path, "diagnose", name, *PATIENCE)
    assert named(answer) == [effect]
    assert answer["verdict"] == "missing"
    assert answer["rms_final"] < 1.05 * KINDS[name].noise


def test_a_small_play_of_the_drive_is_found_with_its_width(tmp_path: Path) -> None:
    answer = command(tmp_path, "diagnose", "short_small_play", *PATIENCE)
    assert named(answer) == ["dead_zone"]
    assert answer["rms_final"] < 1.05 * KINDS["short_small_play"].noise
    found = answer["final_model"]["parameters"]["dead_zone.slack"]["value"]
    assert found == pytest.approx(SLACK, rel=0.05)


def test_three_resonances_are_found_together(tmp_path: Path) -> None:
    answer = command(tmp_path, "diagnose", "short_three_modes", *PATIENCE)
    assert named(answer) == ["second_mode"]
    assert answer["rms_final"] < 1.05 * KINDS["short_three_modes"].noise
    values = {name: one["value"] for name, one in answer["final_model"]["parameters"].items()}
    omegas = [value for name, value in values.items() if name.split(".")[1].startswith("omega")]
    assert np.sort(omegas) / (2 * np.pi) == pytest.approx([f for f, _, _ in MODES], rel=5e-3)


def test_readings_at_the_rail_are_left_out(tmp_path: Path) -> None:
    answer = command(tmp_path, "fit", "dropouts")
    assert f"{sum(count for _, count in RAIL)} readings at a level (40 um" in answer["printed"]
    for first, count in RAIL:
        assert f"{first + 1} to {first + count}" in answer["printed"]
    # The resonance rings when the drive begins, which the default model cannot see.
    assert answer["rms"] < 1.1 * KINDS["dropouts"].noise


def test_a_butterfly_is_no_actuator_of_this_class(tmp_path: Path) -> None:
    refused = CliRunner().invoke(app, ["diagnose", str(put(tmp_path, "butterfly"))])
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert len(refused.stderr.splitlines()) == 1
    assert "as the butterfly of a ferroelectric does" in refused.stderr
    assert "No model here describes that." in refused.stderr


def test_repetitions_of_the_drive_measure_the_noise(tmp_path: Path) -> None:
    answer = command(tmp_path, "diagnose", "six_periods", "--effort", "quick", *PATIENCE)
    assert answer["noise_measured"]
    assert answer["noise_rms"] == pytest.approx(KINDS["six_periods"].noise, rel=0.05)
    assert "from what differs between 5 repetitions of the drive" in answer["printed"]
