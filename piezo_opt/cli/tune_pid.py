"""``piezo-opt tune pid``: gains of a PID on a fitted actuator."""

from __future__ import annotations

from piezo_opt.cli.groups import grouped
from piezo_opt.cli.loop_tuning import Aim, Peak, tuned_loop
from piezo_opt.cli.tuning import Actuator, Loop, Reference, Result, tune


@tune.command()
@grouped
def pid(
    fit: Actuator, reference: Reference, loop: Loop, result: Result, aim: Aim, peak: Peak = 2.0
) -> None:
    """Gains and derivative filter of a PID.

    Ctrl-C and --max-time give the best so far.

    \b
    Examples:
      piezo-opt tune pid fit.json
      piezo-opt tune pid fit.json --period "1 ms" --high "6 um" --frequency "10 Hz"
      piezo-opt tune pid fit.json --shape step --overshoot 0.02 --scenarios 40 --picture pid.png
    """
    from piezo_opt.control import tune_pid

    tuned_loop("PID", tune_pid, fit, reference, loop, result, aim, peak)
