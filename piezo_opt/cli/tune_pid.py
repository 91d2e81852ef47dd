"""``piezo-opt tune pid``: gains of a PID on a fitted actuator."""

from __future__ import annotations

from enum import Enum
from typing import Annotated, TypeAlias

import typer

from piezo_opt.cli.groups import grouped
from piezo_opt.cli.telling import telling
from piezo_opt.cli.tuning import Actuator, Loop, Reference, Result, asked, described, tune


class Goal(Enum):
    """What is made small."""

    IAE, ISE, ITAE = "iae", "ise", "itae"


Criterion: TypeAlias = Annotated[
    Goal, typer.Option(help="Integral of |e|, of e^2, or of t |e|, to be made small.")
]
Effort: TypeAlias = Annotated[
    float, typer.Option(min=0.0, metavar="W", help="Weight of the drive's moves.")
]
Overshoot: TypeAlias = Annotated[
    float | None, typer.Option(min=0.0, metavar="0.02", help="Most of it, of the last step.")
]
Peak: TypeAlias = Annotated[
    float, typer.Option(min=1.05, metavar="2", help="Highest sensitivity: less is more robust.")
]


@tune.command()
@grouped
def pid(
    fit: Actuator, reference: Reference, loop: Loop, result: Result,
    criterion: Criterion = Goal.IAE, effort: Effort = 0.0, overshoot: Overshoot = None,
    peak: Peak = 2.0,
) -> None:  # fmt: skip
    """Gains and derivative filter of a PID.

    \b
    Examples:
      piezo-opt tune pid fit.json
      piezo-opt tune pid fit.json --period "1 ms" --high "6 um" --frequency "10 Hz"
      piezo-opt tune pid fit.json --shape step --overshoot 0.02 --scenarios 40 --picture pid.png
    """
    from piezo_opt.control import tune_pid
    from piezo_opt.report.control import loops

    result.check(fit, reference.reference)
    what = asked(fit, reference, loop)
    with telling("PID") as tell:
        found = tune_pid(
            what.actuator, what.reference, period=what.period, limits=what.limits,
            delay=loop.delay, noise=what.noise, criterion=criterion.value, effort=effort,
            overshoot=overshoot, peak=peak, scenarios=loop.scenarios, seed=loop.seed,
            progress=tell,
        )  # fmt: skip
    result.deliver(
        f"For {what.told}:\n{found}", {**found.to_dict(), **described(what, fit)},
        None if result.picture is None else loops(found.loops, "PID", what.limits),
    )  # fmt: skip
