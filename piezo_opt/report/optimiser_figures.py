"""Pictures of a comparison of optimisers: who solves how much, at what price."""

from __future__ import annotations

from textwrap import fill
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezo_opt.benchmark.optimisation import CONTENDERS, Comparison
from piezo_opt.benchmark.optimisation.contenders import Family
from piezo_opt.benchmark.optimisation.profiles import Curve
from piezo_opt.benchmark.optimisation.result import Kind
from piezo_opt.report.style import BLACK, MODELS, figure, plain_log_ticks, styled

_BACKGROUND: Final = "#d5d9df"
_ACROSS: Final[dict[str, str]] = {
    "data": "simulations for each unknown and one more",
    "performance": "price over that of the cheapest solver",
}
_LARGEST_RATIO: Final = 1e4
_WIDTH: Final = 150
"""Characters of a line below the picture."""


def profile(comparison: Comparison, kind: Kind, tolerance: float) -> Figure:
    """Data or performance profile, three panels of solvers, all others in grey behind them.

    Below it stands in two sentences what it says.

    Args:
        comparison: the runs; hide solvers by ``comparison.without(...)``.
        kind: over simulations, or over the price of the cheapest.
        tolerance: share of what there is to be gained that may be left.
    """
    curves = comparison.profile(kind, tolerance)
    with styled():
        made, axes = figure(1, 3, width=11.0, height=6.2)
        end = comparison.budget if kind == "data" else _LARGEST_RATIO
        begin = 1.0 if kind == "performance" else _first(curves)
        for axis, family in zip(axes, Family, strict=True):
            for curve in curves.values():
                _staircase(axis, curve, begin, end, color=_BACKGROUND, linewidth=0.8)
            mine = [name for name in curves if CONTENDERS[name].family is family]
            for k, name in enumerate(sorted(mine, key=lambda n: -curves[n].last)):
                colour = (BLACK, *MODELS)[k % (len(MODELS) + 1)]
                dashes = "-" if k <= len(MODELS) else "--"
                _staircase(
                    axis, curves[name], begin, end, color=colour, linestyle=dashes,
                    label=f"{name}  {100.0 * curves[name](end):.0f} %",
                )  # fmt: skip
            axis.set_xscale("log")
            axis.set_xlim(begin, end)
            axis.set_ylim(0.0, 1.02)
            plain_log_ticks(axis.xaxis)
            axis.set_title(family.value)
            axis.set_xlabel(_ACROSS[kind])
            if mine:
                axis.legend(loc="upper left", bbox_to_anchor=(0.0, -0.13), fontsize=7.5)
        axes[0].set_ylabel(f"share of cases solved to {tolerance:.0e}")
        sentences = " ".join(comparison.sentences(kind, tolerance))
        made.supxlabel(fill(sentences, _WIDTH), fontsize=9.0, x=0.01, ha="left")
        return made


def _first(curves: dict[str, Curve]) -> float:
    """Somewhat before anybody has solved anything."""
    begins = [curve.at[0] for curve in curves.values() if curve.at.size]
    return 0.8 * float(min(begins, default=1.0))


def _staircase(axis: Axes, curve: Curve, begin: float, end: float, **look: object) -> None:
    at = np.concatenate([[begin], curve.at, [max(end, *curve.at[-1:], begin)]])
    share = np.concatenate([[0.0], curve.share, [curve.last]])
    axis.step(at, share, where="post", **look)  # type: ignore[arg-type]
