"""``piezo-opt tune mpc``: a predictive controller with the fitted model."""

from __future__ import annotations

from typing import Annotated

from piezo_opt.cli.declare import Option
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.limiting import leave_early, limit_of, limited
from piezo_opt.cli.telling import telling
from piezo_opt.cli.tuning import Actuator, Loop, Reference, Result, asked, described, tune
from piezo_opt.units import quantity


@tune.command()
@grouped
def mpc(
    fit: Actuator, reference: Reference, loop: Loop, result: Result,
    stroke: Annotated[
        tuple[str, str] | None,
        Option(metavar="LOW HIGH", help="Positions that are allowed, '0 um' '8 um'."),
    ] = None,
    horizon: Annotated[
        int | None,
        Option(min=1, metavar="N", help="Periods ahead; by default the shortest that does."),
    ] = None,
    preview: Annotated[
        bool, Option(help="Whether the reference is known before.")
    ] = True,
) -> None:  # fmt: skip
    """Predictive control: the hysteretic model over a horizon, within limits.

    Ctrl-C and --max-time give the best so far.

    \b
    Examples:
      piezo-opt tune mpc fit.json
      piezo-opt tune mpc fit.json --period "1 ms" --high "6 um" --frequency "10 Hz" --slew "8 kV/s"
    """
    from piezo_opt.control import tune_mpc
    from piezo_opt.report.control import loops

    limit = limit_of(result.max_time)
    result.check(fit, reference.reference)
    what = asked(fit, reference, loop)
    ends = None if stroke is None else (quantity(stroke[0], "m"), quantity(stroke[1], "m"))
    with telling("MPC") as tell, limited(limit):
        found = tune_mpc(
            what.actuator, what.reference, period=what.period, limits=what.limits, stroke=ends,
            delay=loop.delay, noise=what.noise, horizon=horizon, preview=preview,
            scenarios=loop.scenarios, seed=loop.seed, progress=tell,
        )  # fmt: skip
    result.deliver(
        f"For {what.told}:\n{found}", {**found.to_dict(), **described(what, fit)},
        lambda: loops(found.loops, "MPC", what.limits),
    )  # fmt: skip
    leave_early(found.interrupted, limit)
