"""``piezo-opt tune lqr``: state feedback and observer on a fitted actuator."""

from __future__ import annotations

from piezo_opt.cli.groups import grouped
from piezo_opt.cli.loop_tuning import Aim, Peak, tuned_loop
from piezo_opt.cli.tuning import Actuator, Loop, Reference, Result, tune


@tune.command()
@grouped
def lqr(
    fit: Actuator, reference: Reference, loop: Loop, result: Result, aim: Aim, peak: Peak = 1.6
) -> None:
    """Feedback of estimated states, with a filter that takes the offset; weights are found.

    Ctrl-C and --max-time give the best so far.

    \b
    Examples:
      piezo-opt tune lqr fit.json
      piezo-opt tune lqr fit.json --high "6 um" --frequency "10 Hz" --scenarios 20 --json lqr.json
    """
    from piezo_opt.control import tune_lqr

    tuned_loop("LQR", tune_lqr, fit, reference, loop, result, aim, peak)
