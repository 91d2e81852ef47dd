"""``piezo-opt bench advice``: whether advised drives resolve a group."""

from __future__ import annotations

from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.limiting import leave_early, limit_of, limited
from piezo_opt.cli.telling import telling


def advice(
    plants: Annotated[int, Option(min=2, metavar="N", help="Plants of each case.")] = 100,
    cases: Annotated[
        str | None, Option(metavar="A,B", help="Of lag, creep, stiffening, bent gain.")
    ] = None,
    max_time: o.MaxTime = None,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Groups that a diagnosis cannot tell apart, on the drives that it advises for them.

    Ctrl-C and --max-time give the cases that were finished.

    \b
    Example:
      piezo-opt bench advice --plants 20 --cases lag,creep
    """
    from dataclasses import asdict

    from piezo_opt.benchmark.advised import CASES, Resolved, resolved

    outputs.check({"--json": json}, overwrite=overwrite)
    chosen = tuple(CASES) if cases is None else tuple(c.strip() for c in cases.split(","))
    found: list[Resolved] = []
    limit, early = limit_of(max_time), False
    with telling("Plants") as tell, limited(limit):
        try:
            for one in resolved(plants, cases=chosen, progress=limit.checking(tell)):
                found.append(one)
                echo(str(one))
        except KeyboardInterrupt:
            if not found:
                raise
            early = True
    if early:
        echo(f"Ended early, after {len(found)} of {len(chosen)} cases.", err=True)
    if json is not None:
        outputs.write_json(
            json,
            {"schema": "piezo_opt/bench-advice/2", "cases": [asdict(one) for one in found]},
            overwrite=overwrite,
        )
    leave_early(early, limit)
