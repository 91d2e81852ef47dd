"""Draws a picture on paper; the page of the workbench draws the same one on a screen."""

from __future__ import annotations

from textwrap import fill
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezo_opt.pictures import Panel, Picture, Style, Tone, Trace
from piezo_opt.pictures.records import FEW
from piezo_opt.report.style import (
    BLACK,
    COLOURS,
    GREY,
    figure,
    legend_below,
    plain_log_ticks,
    styled,
)

_UPPER: Final = 1.6
"""Height of the first of several panels, in that of the others."""
_LETTERS: Final = 12.0
"""Letters of an axis' label that stand beside one inch of it."""
_AROUND: Final = 0.9
"""Inches of a figure above and below its axes."""


def drawn(picture: Picture, *, width: float = 7.2, height: float = 3.2) -> Figure:
    """A figure of the picture, of so many inches."""
    count = len(picture.panels)
    with styled():
        parts = (1.0,) * count if picture.beside else (_UPPER, *[1.0] * (count - 1))
        if picture.beside:
            made, axes = figure(1, count, width=width, height=height)
        else:
            made, axes = figure(count, width=width, height=height, sharex=True, heights=parts)
        inch = (height - _AROUND) / (1.0 if picture.beside else sum(parts))
        for axis, panel, part in zip(axes, picture.panels, parts, strict=True):
            _panel(axis, panel, inch * part)
        if picture.beside:
            for axis in axes[1:]:
                axis.set_ylabel("")
            _share_y(axes)
        else:
            for axis in axes[:-1]:
                axis.set_xlabel("")
        named = axes[0].get_legend_handles_labels()[1]
        if count > 1 and named:
            # Inside the axes there is signal everywhere.
            legend_below(made, axes[0])
        elif named:
            points = sum(trace.x.size for trace in picture.panels[0].traces)
            axes[0].legend(loc="best" if points <= FEW else "upper left")
    return made


def _panel(axis: Axes, panel: Panel, height: float) -> None:
    for trace in panel.traces:
        _trace(axis, trace)
    if panel.zero:
        axis.axhline(0.0, color=BLACK, linewidth=0.7)
    if panel.shaded is not None:
        begin, end, why = panel.shaded
        axis.axvspan(begin, end, color="#eef0f3", zorder=0)
        axis.plot([], [], color="#d5d9df", linewidth=6, label=why)
    if panel.level is not None:
        level, says = panel.level
        axis.axhline(level, color=GREY, linestyle="--", linewidth=1.0)
        axis.annotate(
            says,
            (0.0, level),
            xycoords=("axes fraction", "data"),
            xytext=(3, 3),
            textcoords="offset points",
            color="#5b616b",
            fontsize=8,
        )
    if panel.limits is not None:
        low, high = panel.limits
        axis.set_ylim(low, None if np.isnan(high) else high)
        if np.isnan(high):
            axis.set_xlim(left=min(0.0, axis.get_xlim()[0]) if _positive(panel) else None)
    if panel.across.logarithmic:
        axis.set_xscale("log")
        plain_log_ticks(axis.xaxis)
    if panel.up.logarithmic:
        axis.set_yscale("log")
        plain_log_ticks(axis.yaxis)
    axis.set_title(panel.title)
    axis.set_xlabel(panel.across.label)
    axis.set_ylabel(fill(panel.up.label, max(12, round(_LETTERS * height)), break_long_words=False))


def _positive(panel: Panel) -> bool:
    return all(float(np.nanmin(trace.x, initial=0.0)) >= 0.0 for trace in panel.traces)


def _trace(axis: Axes, trace: Trace) -> None:
    colour, label = COLOURS[trace.tone], trace.label or "_nolegend_"
    few = trace.x.size <= FEW
    match trace.style:
        case Style.LINE:
            # What was measured shows on both sides of a model that lies on it.
            wide = 2.4 if trace.tone is Tone.INK else 1.1
            axis.plot(trace.x, trace.y, color=colour, linewidth=wide, label=label)
        case Style.MARKED:
            # Of samples the points matter; of means the line that joins them.
            sampled = trace.tone is Tone.INK
            axis.plot(
                trace.x,
                trace.y,
                "o-",
                color=colour,
                linewidth=0.6 if sampled else 1.8,
                markersize=3.2 if sampled else 5.0,
                markeredgecolor=colour if sampled else "white",
                label=label,
            )
        case Style.CLOUD:
            axis.plot(
                trace.x,
                trace.y,
                ".",
                color=colour,
                alpha=0.6 if few else 0.15,
                markersize=4.0 if few else 2.5,
                rasterized=trace.x.size > 1500,
                label=label,
            )
        case Style.BAND:
            assert trace.high is not None
            axis.fill_between(
                trace.x, trace.y, trace.high, color=colour, alpha=0.15, linewidth=0, label=label
            )


def _share_y(axes: list[Axes]) -> None:
    low = min(axis.get_ylim()[0] for axis in axes)
    high = max(axis.get_ylim()[1] for axis in axes)
    for axis in axes:
        axis.set_ylim(low, high)
