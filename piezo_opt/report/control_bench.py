"""What controllers cost and find, as a picture."""

from __future__ import annotations

from matplotlib.figure import Figure

from piezo_opt.benchmark.controllers import ControlBench
from piezo_opt.report.style import BLACK, BLUE, VERMILLION, figure, plain_log_ticks, styled


def benched(found: ControlBench) -> Figure:
    """Time of a sample by way; costs of both searches from every start against their simulations.

    Args:
        found: the bench.
    """
    rows = found.iterations.rows
    ways = list(dict.fromkeys(r.way for r in rows))
    actuators = list(dict.fromkeys(r.actuator for r in rows))
    with styled():
        made, axes = figure(rows=2, width=7.2, height=6.6)
        time, searches = axes
        for k, (actuator, colour) in enumerate(zip(actuators, (BLUE, VERMILLION), strict=False)):
            own = [r for r in rows if r.actuator == actuator]
            at = [ways.index(r.way) + 0.2 * (k - 0.5) for r in own]
            middle, late = [1e3 * r.median for r in own], [1e3 * r.late for r in own]
            time.vlines(at, middle, late, color=colour, linewidth=1.2)
            time.plot(at, middle, "o", color=colour, label=f"actuator {actuator}")
            time.plot(at, late, "_", color=colour, markersize=9)
        time.set_yscale("log")
        plain_log_ticks(time.yaxis)
        time.set_xticks(range(len(ways)), ways)
        time.set_ylabel("time of a sample [ms]")
        time.set_title("Predictive control: points are medians, bars go to the 99.9 % quantile")
        time.legend(loc="upper left")
        best = min(r.cost for r in found.starts.rows)
        for way, colour, mark in (("simplex", VERMILLION, "s"), ("gradient", BLUE, "o")):
            counts = [
                r.simplex_simulations if way == "simplex" else r.simulations
                for r in found.starts.rows
            ]
            costs = [(r.simplex if way == "simplex" else r.cost) / best for r in found.starts.rows]
            searches.plot(counts, costs, mark, color=colour, alpha=0.7, label=way)
        searches.axhline(1.0, color=BLACK, linewidth=0.6)
        for axis, scale in (
            (searches.xaxis, searches.set_xscale),
            (searches.yaxis, searches.set_yscale),
        ):
            scale("log")
            plain_log_ticks(axis)
        searches.set_xlabel("simulations of the loop")
        searches.set_ylabel("cost over the best")
        searches.set_title("A PID from seeded starts: a point is where a search ended")
        searches.legend(loc="upper left")
    return made
