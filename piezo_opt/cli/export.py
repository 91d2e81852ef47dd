"""``piezo-opt export``: a fitted model leaves as code."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezo_opt.cli import options as o
from piezo_opt.cli.inputs import Reading
from piezo_opt.units import quantity

export = typer.Typer(
    name="export",
    help="Take a fitted model away as code that needs nothing of this package.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@export.callback()
def _front() -> None:
    """Take a fitted model away as code that needs nothing of this package."""


Holder: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="FIT.json", help="JSON of a fit, diagnosis or comparison, or a model file.",
        show_default=False,
    ),
]  # fmt: skip
Out: TypeAlias = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="Folder to make.", show_default=False)
]
Replayed: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="RECORD", help="Record for the check; best one that the fit has not seen."
    ),
]
Step: TypeAlias = Annotated[
    str | None,
    typer.Option(metavar="'1 ms'", help="Time between two calls; by default the record's."),
]
Name: TypeAlias = Annotated[
    str, typer.Option(metavar="WORD", help="Prefix of every symbol, name of the files.")
]
Substeps: TypeAlias = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Sub-steps of every call; by default chosen."),
]
Range: TypeAlias = Annotated[
    tuple[str, str] | None,
    typer.Option(metavar="LOW HIGH", help="Range of the drive for a check without a record."),
]
Single: TypeAlias = Annotated[
    bool, typer.Option("--float", help="Numbers of four bytes and nothing wider.")
]


def volts(pair: tuple[str, str] | None) -> tuple[float, float] | None:
    """A range of the drive in volts."""
    return None if pair is None else (quantity(pair[0], "V"), quantity(pair[1], "V"))


@export.command()
def c(
    source: Holder,
    out: Out,
    single: Single = False,
    replay: Replayed = None,
    step: Step = None,
    name: Name = "actuator",
    substeps: Substeps = None,
    drive_range: Range = None,
    board: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Run it on atmega328p or cortex-m4f as well, with --float."
        ),
    ] = None,
    time: o.Time = None,
    drive: o.Drive = None,
    position: o.Position = None,
    record: o.RecordName = None,
) -> None:
    """Write C99 that needs nothing but libm: a header, a source, a program to try it with.

    The code is compiled and replayed before the folder appears: it must read what the library
    reads, to rounding in double and to 1e-5 of the stroke in float.

    \b
    Examples:
      piezo-opt export c fit.json --out actuator --replay other.csv
      piezo-opt export c fit.json --out firmware --float --step "1 ms" --board cortex-m4f
    """
    from piezo_opt.export import export_c

    reading = Reading(time, drive, position, record)
    found = export_c(
        source,
        out,
        step=step,
        precision="float" if single else "double",
        replay=None if replay is None else reading.single(replay),
        name=name,
        substeps=substeps,
        drive=volts(drive_range),
        boards=tuple(board or ()),
    )
    typer.echo(str(found))
