"""``piezo-opt tune lqr``: state feedback and observer on a fitted actuator."""

from __future__ import annotations

from piezo_opt.cli.groups import grouped
from piezo_opt.cli.telling import telling
from piezo_opt.cli.tune_pid import Criterion, Effort, Goal, Overshoot, Peak
from piezo_opt.cli.tuning import Actuator, Loop, Reference, Result, asked, described, tune


@tune.command()
@grouped
def lqr(
    fit: Actuator, reference: Reference, loop: Loop, result: Result,
    criterion: Criterion = Goal.IAE, effort: Effort = 0.0, overshoot: Overshoot = None,
    peak: Peak = 1.6,
) -> None:  # fmt: skip
    """Feedback of estimated states, with a filter that takes the offset; weights are found.

    \b
    Examples:
      piezo-opt tune lqr fit.json
      piezo-opt tune lqr fit.json --high "6 um" --frequency "10 Hz" --scenarios 20 --json lqr.json
    """
    from piezo_opt.control import tune_lqr
    from piezo_opt.report.control import loops

    result.check(fit, reference.reference)
    what = asked(fit, reference, loop)
    with telling("LQR") as tell:
        found = tune_lqr(
            what.actuator, what.reference, period=what.period, limits=what.limits,
            delay=loop.delay, noise=what.noise, criterion=criterion.value, effort=effort,
            overshoot=overshoot, peak=peak, scenarios=loop.scenarios, seed=loop.seed,
            progress=tell,
        )  # fmt: skip
    result.deliver(
        f"For {what.told}:\n{found}", {**found.to_dict(), **described(what, fit)},
        None if result.picture is None else loops(found.loops, "LQR", what.limits),
    )  # fmt: skip
