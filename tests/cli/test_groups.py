"""Options that commands share are declared once, and reach every command."""

import inspect
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import pytest
from click.testing import CliRunner

from piezo_opt.cli import app
from piezo_opt.cli.compare import compare
from piezo_opt.cli.declare import Argument, Option, command, echo
from piezo_opt.cli.diagnose import diagnose
from piezo_opt.cli.fit import fit
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import Reading
from piezo_opt.cli.report import report
from piezo_opt.cli.simulate import simulate
from piezo_opt.errors import InputError
from piezo_opt.readers import read
from tests.readers.forms import HEADER, U, Y, put, rows


@dataclass(frozen=True)
class Size:
    width: Annotated[int, Option(help="Of the box.")] = 3
    depth: Annotated[int, Option(min=1)] = 4


NORMAL = Size()


def test_the_fields_of_a_group_are_options() -> None:
    @grouped
    def box(name: Annotated[str, Argument()], size: Size = NORMAL, lid: bool = False) -> None:
        """A box."""
        echo(f"{name} {size} {lid}")

    run, shown = CliRunner().invoke, command(box)
    assert run(shown, ["a"]).output == f"a {NORMAL} False\n"
    assert run(shown, ["a", "--depth", "7", "--lid"]).output == f"a {Size(3, 7)} True\n"
    assert run(shown, ["a", "--depth", "0"]).exit_code == 2


@pytest.mark.parametrize("command_", [fit, compare, diagnose, report, simulate])
def test_every_command_reads_in_the_same_way(command_: object) -> None:
    options = inspect.signature(command_).parameters  # type: ignore[arg-type]
    assert {one.name for one in fields(Reading)} <= set(options)
    # What the command offers is what the Python call takes.
    assert {one.name for one in fields(Reading)} <= set(inspect.signature(read).parameters)


def test_records_of_one_name_are_called_by_their_folders(tmp_path: Path) -> None:
    files = [tmp_path / day / "run.csv" for day in ("monday", "tuesday")]
    for file in files:
        file.parent.mkdir()
        put(file.parent, file.name, HEADER + "\n" + rows())
    assert Reading().records(files).names == ("monday/run", "tuesday/run")
    assert Reading().records(files[:1]).names == ("run",)
    with pytest.raises(InputError, match="leave one out where they are the same"):
        Reading().records([files[0], files[0]])


def test_a_record_without_a_clock_is_fitted_when_its_rate_is_said(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    lines = "".join(f"{u / 15:.9g},{y:.9g}\n" for u, y in zip(U, Y, strict=True))
    file.write_text("command [V],displacement [um]\n" + lines)
    run = CliRunner().invoke
    refused = run(app, ["fit", str(file)])
    assert refused.exit_code == 2
    assert "--rate" in refused.output
    said = ["--rate", "1 kHz", "--gain", "15", "--trim", "0.1 s:0.9 s", "--every", "2"]
    done = run(app, ["fit", str(file), *said])
    assert done.exit_code == 0, done.output
    for piece in ("even, at the 1000 Hz", "multiplied by 15", "101 to 900", "Every 2nd sample"):
        assert piece in done.output
