"""Work and precision: what an error costs, for every way to simulate."""

from __future__ import annotations

from matplotlib.figure import Figure

from piezo_opt.benchmark.alternatives import EQUAL, Alternatives
from piezo_opt.report.style import BLACK, MODELS, figure, styled


def work_precision(found: Alternatives) -> Figure:
    """Error over the stroke against nanoseconds a sample, one line a way.

    Args:
        found: points of every way.
    """
    with styled():
        made, axes = figure(1, 1, width=7.0, height=4.6)
        axis = axes[0]
        for k, way in enumerate(found.ways):
            own = sorted((p.nanoseconds, p.error) for p in found.points if p.way == way)
            colour = (BLACK, *MODELS)[k % (len(MODELS) + 1)]
            dashes = "-" if k <= len(MODELS) else "--"
            times, errors = zip(*own, strict=True)
            axis.plot(times, errors, marker="o", color=colour, linestyle=dashes, label=way)
        axis.axhline(EQUAL, color="#d5d9df", linewidth=0.8)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("nanoseconds a sample")
        axis.set_ylabel("largest error over the stroke")
        axis.legend()
    return made
