"""``piezo-opt bench control``: what controllers cost, and what tuning finds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.telling import telling


def control(
    samples: Annotated[int, Option(min=20, metavar="N", help="Of the real-time iteration.")] = 3000,
    starts: Annotated[
        int, Option(min=1, metavar="N", help="Of a PID, for gradients and for a simplex.")
    ] = 20,
    draws: Annotated[
        int, Option(min=20, metavar="N", help="Fresh actuators for robust PIDs.")
    ] = 2000,
    picture: Annotated[
        Path | None, Option(metavar="OUT.png", help="All of it: .png or .svg.")
    ] = None,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Predictive control beside solvers, a PID beside a simplex, robust PIDs on fresh actuators.

    About three minutes of processor time, most of it in the solvers that are compared.

    \b
    Examples:
      piezo-opt bench control
      piezo-opt bench control --samples 300 --starts 2 --picture control.png
    """
    from piezo_opt.benchmark.controllers import control_bench
    from piezo_opt.report.control_bench import benched

    outputs.check({"--json": json, "--picture": picture}, overwrite=overwrite)
    with telling("Control") as tell:
        found = control_bench(samples, starts, draws, progress=tell)
    echo(str(found))
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
    if picture is not None:
        outputs.write_picture(picture, lambda: benched(found), overwrite=overwrite)
