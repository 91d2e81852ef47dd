"""``piezo-opt bench faults``: controllers in a loop in which everything goes wrong."""

from __future__ import annotations

from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.telling import telling


def faults(
    steps: Annotated[
        int, Option(min=1, metavar="N", help="Samples of all controllers together.")
    ] = 1_000_000,
    seed: Annotated[int, Option(min=0, help="Of faults and noise.")] = 0,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Broken sensors, impossible references and limits: no drive that is none, no limit passed.

    \b
    Example:
      piezo-opt bench faults --steps 100000
    """
    from piezo_opt.benchmark.faults import endure

    outputs.check({"--json": json}, overwrite=overwrite)
    with telling("Faults") as tell:
        found = endure(steps, seed, progress=tell)
    echo(str(found))
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
