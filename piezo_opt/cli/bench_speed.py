"""``piezo-opt bench speed``: nanoseconds a sample, beside programs that do nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.telling import telling
from piezo_opt.errors import InputError


def speed(
    samples: Annotated[int, typer.Option(min=100, metavar="N", help="Of the record.")] = 8000,
    repetitions: Annotated[
        int, typer.Option(min=1, metavar="N", help="Runs of each, in turns; the fastest counts.")
    ] = 15,
    library: Annotated[
        bool, typer.Option(help="Build the library of all effects anew, in an empty folder.")
    ] = True,
    alternatives: Annotated[
        bool, typer.Option(help="Also what a user would take instead, at equal accuracy.")
    ] = True,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="OUT.png", help="Error against time of every way: .png or .svg."),
    ] = None,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Simulate five models, and compare with C compiled for each of them and written by hand.

    Takes about a minute, most of it in the compiler that the models are judged by.

    \b
    Examples:
      piezo-opt bench speed
      piezo-opt bench speed --no-library --json speed.json --picture work_precision.png
    """
    from piezo_opt.benchmark.alternatives import alternatives as others
    from piezo_opt.benchmark.speed import measure
    from piezo_opt.readers.files import replacing
    from piezo_opt.report.speed_figures import work_precision

    outputs.check({"--json": json, "--picture": picture}, overwrite=overwrite)
    if picture is not None and not alternatives:
        raise InputError("--picture: shows the alternatives: leave --no-alternatives out")
    with telling("Speed") as tell:
        found = measure(samples, repetitions, library=library, progress=tell)
        beside = others(samples, repetitions, tell) if alternatives else None
    typer.echo(str(found))
    if beside is not None:
        typer.echo(f"\n{beside}")
    if json is not None:
        more = {} if beside is None else {"alternatives": beside.to_dict()}
        outputs.write_json(json, {**found.to_dict(), **more}, overwrite=overwrite)
    if picture is not None and beside is not None:
        with replacing(picture, overwrite=overwrite) as temporary:
            work_precision(beside).savefig(
                temporary, dpi=150, format=picture.suffix.lstrip(".").lower() or "png"
            )
