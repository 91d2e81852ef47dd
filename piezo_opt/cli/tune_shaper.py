"""``piezo-opt tune shaper``: which input shaper for a fitted actuator."""

from __future__ import annotations

from typing import Annotated

from piezo_opt.cli.declare import Option
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.limiting import limit_of, limited
from piezo_opt.cli.telling import telling
from piezo_opt.cli.tuning import Actuator, Result, plant, tune


@tune.command()
@grouped
def shaper(
    fit: Actuator, result: Result,
    allowed: Annotated[
        float, Option(metavar="0.05", help="Share of the swinging that may stay.")
    ] = 0.05,
    delay: Annotated[
        str | None,
        Option(
            metavar="'5 ms'", help="Longest delay of the robust shaper; by default that of ZVD."
        ),
    ] = None,
    spread: Annotated[
        float,
        Option(metavar="0.02", help="Further doubt about frequencies, as a share (a load)."),
    ] = 0.0,
    scenarios: Annotated[
        int, Option(min=1, metavar="N", help="Actuators to design on.")
    ] = 60,
    seed: Annotated[int, Option(min=0, help="Seed of the draws.")] = 0,
) -> None:  # fmt: skip
    """Compare shapers on the actuators that the record allows, and say which to take.

    \b
    Examples:
      piezo-opt tune shaper fit.json
      piezo-opt tune shaper fit.json --spread 0.03 --allowed 0.02 --picture shaper.png
    """
    from piezo_opt.control import identified, tune_shaper
    from piezo_opt.report.control import shapers

    limit = limit_of(result.max_time)
    result.check(fit)
    actuator = identified(fit)
    with telling("Shaper") as tell, limited(limit):
        found = tune_shaper(
            actuator, allowed=allowed, delay=delay, spread=spread, scenarios=scenarios, seed=seed,
            progress=tell,
        )  # fmt: skip
    result.deliver(
        str(found), {**found.to_dict(), "plant": plant(actuator, fit)},
        lambda: shapers(found),
    )  # fmt: skip
