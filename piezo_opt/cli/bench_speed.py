"""``piezo-opt bench speed``: nanoseconds a sample, beside programs that do nothing else."""

from __future__ import annotations

from typing import Annotated

import typer

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.telling import telling


def speed(
    samples: Annotated[int, typer.Option(min=100, metavar="N", help="Of the record.")] = 8000,
    repetitions: Annotated[
        int, typer.Option(min=1, metavar="N", help="Runs of each, in turns; the fastest counts.")
    ] = 15,
    library: Annotated[
        bool, typer.Option(help="Build the library of all effects anew, in an empty folder.")
    ] = True,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Simulate five models, and compare with C compiled for each of them and written by hand.

    Takes about a minute, most of it in the compiler that the models are judged by.

    \b
    Examples:
      piezo-opt bench speed
      piezo-opt bench speed --no-library --json speed.json
    """
    from piezo_opt.benchmark.speed import measure

    outputs.check({"--json": json}, overwrite=overwrite)
    with telling("Speed") as tell:
        found = measure(samples, repetitions, library=library, progress=tell)
    typer.echo(str(found))
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
