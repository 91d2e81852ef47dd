"""``piezo-opt fem``: what it prints and writes, and how it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from piezo_opt.cli import app
from piezo_opt.finite_elements import block, static
from piezo_opt.physics import PZT_5A
from piezo_opt.readers import read


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["fem", *(str(one) for one in arguments)])


SMALL = ("block", "--material", "pzt-5a", "--elements", "3,3,2", "--modes", "6")


def test_block_writes_what_it_found(tmp_path: Path) -> None:
    files = {
        option: tmp_path / f"{option}.{suffix}"
        for option, suffix in (
            ("vtk", "vtk"), ("record", "csv"), ("picture", "png"), ("shapes", "png"),
            ("response", "png"), ("json", "json"),
        )
    }  # fmt: skip
    options = [part for option, file in files.items() for part in (f"--{option}", file)]
    done = run(*SMALL, *options)
    assert done.exit_code == 0, done.output
    assert "18 elements, 48 nodes, base clamped" in done.stdout
    told = json.loads(files["json"].read_text())
    assert told["schema"] == "piezo_opt/fem-block/1"
    body = block(PZT_5A, 5e-3, 5e-3, 4e-3, elements=(3, 3, 2))
    assert told["top"] == pytest.approx(static(body, 150.0).tip, rel=1e-9)
    assert len(told["frequencies"]) == 6
    assert read(files["record"]).position[-1] == pytest.approx(told["top"], rel=1e-6)
    for option in ("picture", "shapes", "response"):
        assert files[option].read_bytes()[:4] == b"\x89PNG"
    again = run(*SMALL, "--json", files["json"])
    assert again.exit_code == 2
    assert "exists already" in again.stderr


def test_refusals() -> None:
    for arguments, words in (
        (("block", "--elements", "3,3"), "give three whole numbers"),
        (("block", "--material", "steel"), "no material 'steel'"),
        (("block", "--width", "5"), "has no unit"),
        ((*SMALL[:-1], "5000"), "5000 modes"),
    ):
        done = run(*arguments)
        assert done.exit_code == 2
        assert words in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
