"""``piezo-opt bench advice``: whether advised drives resolve a group."""

from __future__ import annotations

from typing import Annotated

import typer

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.telling import telling


def advice(
    plants: Annotated[int, typer.Option(min=2, metavar="N", help="Plants on each drive.")] = 100,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """A lag and a delay that a record cannot tell apart, on the drives advised for them.

    \b
    Example:
      piezo-opt bench advice --plants 20
    """
    from dataclasses import asdict

    from piezo_opt.benchmark.advised import resolved

    outputs.check({"--json": json}, overwrite=overwrite)
    with telling("Plants") as tell:
        found = resolved(plants, progress=tell)
    for one in found:
        typer.echo(
            f"{one.advice}: {one.right} of {one.plants} plants resolved, {one.sigmas:.1f} sigmas "
            f"promised, by {one.drive}"
        )
    if json is not None:
        outputs.write_json(
            json,
            {"schema": "piezo_opt/bench-advice/1", "drives": [asdict(one) for one in found]},
            overwrite=overwrite,
        )
