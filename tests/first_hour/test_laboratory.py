"""`piezo-opt fit` on records as laboratories leave them: the plain record's values, or a sentence.

What a remedy that is offered gives is part of the table.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from piezo_opt.cli import app
from tests.first_hour.laboratory import NOISE, make

PLAIN = {"piezo_gain.d": 2.0e-7, "bouc_wen.alpha": 6.0e-8, "bouc_wen.beta": 0.02}
"""What is in the record."""
READ: dict[str, str] = {
    "plain.csv": "",
    "parentheses.csv": "",
    "unit_row.csv": "The units are those of row 2.",
    "preamble.csv": "2 lines above the table were skipped.",
    "trailing_comma.csv": "",
    "start_increment.csv": "made from 'Increment': 0.001 s",
    "decimal_comma.csv": "Decimals are written with a comma.",
    "utf16.csv": "",
    "latin1.csv": "",
    "crlf.csv": "",
    "iso_time.csv": "Column 'time' holds clock times; they are counted from the first.",
    "labview.lvm": "those of the file's LabVIEW headers",
    "packed.h5": "'displacement' was unpacked with scale_factor",
    "overload.csv": "4 readings are far beyond all others",
    "dropout.csv": "12 readings at a level (0 m)",
    "jitter.csv": "The clock jitters by 2",
    "range_a.csv": "",
}
"""Read as it is, and a word of the remark that says what was concluded."""
ASKED: dict[str, tuple[str, tuple[str, ...]]] = {
    "simulink.mat": (
        "columns 'voltage' and 'displacement' have no unit",
        ("--drive", "voltage [V]", "--position", "displacement [um]"),
    ),
    "tofile.mat": (
        "no column is the drive",
        ("--drive", "2 [V]", "--position", "3 [um]"),
    ),
    "no_time.csv": ("give the sampling rate, --rate '1 kHz'", ("--rate", "1 kHz")),
    "set_point.csv": (
        "the drive times 2e-07 m/V to the last digit: a set point or a computed value",
        ("--position", "measured"),
    ),
    "restart.csv": (
        "row 1502, column 'time [s]': the time 0 is before that of row 1501 (1.499): the clock "
        "begins anew there, so these are 2 records: take all with --record 'all'",
        ("--record", "all"),
    ),
    "glued.csv": ("jumps by 4.1", ("--mend", "jump")),
    "wrapped.csv": ("a counter or a phase that wraps", ("--mend", "wrapped")),
    "slow_drive.csv": (
        "the drive was logged at 100 Hz, not at 1 kHz",
        ("--mend", "slow_drive"),
    ),
    "block_twice.csv": ("to the last digit, at samples 1501 to 1756", ("--mend", "block_twice")),
    "metres.csv": ("which no piezo does: its unit is wrong", ("--mend", "unit")),
    "rounded_time.csv": (
        "the clock is printed with too few digits; give the rate, --rate '1 kHz'",
        ("--rate", "1 kHz"),
    ),
}
"""Refused in one sentence, and the remedy that it offers."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("laboratory")
    make(where)
    return where


def fit(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["fit", *arguments])


def plain_values(folder: Path, name: str, *said: str) -> str:
    """What the command prints of a record that is no other than the plain one."""
    out = folder / "fit.json"
    done = fit(str(folder / name), *said, "--json", str(out), "--overwrite")
    assert done.exit_code == 0, done.output
    data = json.loads(out.read_text())
    # 250 Hz of resonance are in it, of which a quasi-static model leaves a nanometre or two.
    assert NOISE * 0.9e-6 < data["rms"] < NOISE * 1.8e-6, name
    for parameter, value in PLAIN.items():
        assert data["parameters"][parameter]["value"] == pytest.approx(value, rel=0.02), name
    return done.stdout


@pytest.mark.parametrize("name", READ)
def test_read_as_it_is(folder: Path, name: str) -> None:
    assert READ[name] in plain_values(folder, name)


@pytest.mark.parametrize("name", ASKED)
def test_told_apart_in_one_sentence_with_a_remedy_that_helps(folder: Path, name: str) -> None:
    sentence, remedy = ASKED[name]
    refused = fit(str(folder / name))
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert len(refused.stderr.splitlines()) == 1
    assert sentence in refused.stderr
    assert remedy[0] in refused.stderr
    plain_values(folder, name, *remedy)


def test_records_that_disagree_by_a_factor(folder: Path) -> None:
    refused = fit(str(folder / "range_a.csv"), str(folder / "range_b.csv"))
    assert refused.exit_code == 2
    assert "range_b moves 10 times as far as range_a" in refused.stderr
    taken = fit(
        str(folder / "range_a.csv"), str(folder / "range_b.csv"), "--accept", "disagreement"
    )
    assert taken.exit_code == 0


def test_each_of_them_has_its_row(folder: Path) -> None:
    names = {file.name for file in folder.iterdir() if file.suffix != ".json"}
    assert names == {*READ, *ASKED, "range_b.csv"}
