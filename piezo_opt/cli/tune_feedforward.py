"""``piezo-opt tune feedforward``: the drive that makes a fitted actuator follow a reference."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Option
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.limiting import leave_early, limit_of, limited
from piezo_opt.cli.telling import telling
from piezo_opt.cli.tuning import Actuator, Loop, Reference, Result, asked, described, tune


@tune.command()
@grouped
def feedforward(
    fit: Actuator, reference: Reference, loop: Loop, result: Result,
    effort: Annotated[
        float, Option(metavar="1e-7", help="Weight of the drive's moves.")
    ] = 1e-7,
    out: Annotated[
        Path | None, Option(metavar="OUT.csv", help="The drive, to be played.")
    ] = None,
) -> None:  # fmt: skip
    """The drive that makes the actuator follow a reference without a sensor.

    Ctrl-C and --max-time give the best so far.

    \b
    Examples:
      piezo-opt tune feedforward fit.json --out drive.csv
      piezo-opt tune feedforward fit.json --reference wanted.csv --slew "5 kV/s" --out drive.csv
    """
    from piezo_opt.control import ClosedLoop, optimal_feedforward
    from piezo_opt.report.control import loops

    limit = limit_of(result.max_time)
    result.check(fit, reference.reference)
    outputs.check({"--out": out}, overwrite=result.overwrite, inputs=(fit, reference.reference))
    what = asked(fit, reference, loop)
    with telling("Feedforward") as tell, limited(limit):
        found = optimal_feedforward(
            what.actuator, what.reference, period=what.period, limits=what.limits, effort=effort,
            progress=tell,
        )  # fmt: skip
    run = ClosedLoop(found.time, found.reference, found.predicted, found.predicted, found.drive)
    result.deliver(
        f"For {what.told}:\n{found}", {**found.to_dict(), **described(what, fit)},
        lambda: loops([run], "Feedforward", what.limits),
    )  # fmt: skip
    if out is not None:
        found.to_drive().write(out, overwrite=result.overwrite)
    leave_early(found.interrupted, limit)
