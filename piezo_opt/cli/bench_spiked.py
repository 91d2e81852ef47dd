"""``piezo-opt bench spiked``: known effects added to measured records."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Argument, Option, echo
from piezo_opt.cli.limiting import limit_of
from piezo_opt.cli.telling import telling
from piezo_opt.readers import read


def spiked(
    records: Annotated[list[Path], Argument(metavar="RECORD...", help="Measured records.")],
    effects: Annotated[
        str | None, Option(metavar="A,B", help="What is added; all that can be unless given.")
    ] = None,
    size: Annotated[
        float,
        Option(metavar="X", help="Of what is added, over what the diagnosis leaves without."),
    ] = 5.0,
    json: o.Json = None,
    max_time: o.MaxTime = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Add a known effect to a measured record, and see whether it is named.

    --max-time is for each diagnosis. Ctrl-C gives the table of what was done.

    \b
    Examples:
      piezo-opt bench spiked data/flexure-stage/record.h5
      piezo-opt bench spiked stage.csv --effects drift,mains_pickup --size 3 --json spiked.json
    """
    from piezo_opt.benchmark.spiked import spiked as measured

    outputs.check({"--json": json}, overwrite=overwrite, inputs=records)
    seconds = limit_of(max_time).seconds
    asked = None if effects is None else [one.strip() for one in effects.split(",")]
    with telling("Bench") as tell:
        found = measured(
            [read(path) for path in records], asked, size=size, max_time=seconds, progress=tell
        )
    echo(str(found))
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
