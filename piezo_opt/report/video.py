"""A picture of a track: the first frame with what was followed, and the distance over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from piezo_opt.pictures.picture import prefixed
from piezo_opt.report.style import (
    BLUE,
    ORANGE,
    SKY,
    VERMILLION,
    figure,
    labelled,
    styled,
)
from piezo_opt.video import Track


def overlay(track: Track) -> Figure:
    """Box, reference and path on the first frame; below, the distance with two sigma and gaps."""
    height, width = track.first.shape
    with styled():
        wide = 7.2
        tall = min(6.0, wide * 0.85 * height / width)
        made, (above, below) = figure(rows=2, width=wide, height=tall + 2.6, heights=(tall, 2.3))
        _frame(above, track)
        _distance(below, track)
    return made


def _frame(axis: Any, track: Track) -> None:
    height, width = track.first.shape
    axis.imshow(track.first, cmap="gray", vmin=0.0, vmax=255.0)
    axis.grid(visible=False)
    box = track.box
    axis.add_patch(
        Rectangle(
            (box.x - 0.5, box.y - 0.5), box.width, box.height, fill=False, edgecolor=ORANGE,
            linewidth=1.6, label="feature at the beginning",
        )
    )  # fmt: skip
    place = track.place[track.valid]
    axis.plot(place[:, 0], place[:, 1], color=SKY, linewidth=1.0, label="its path")
    x, y = track.reference
    middle = box.centre
    axis.plot([x, middle[0]], [y, middle[1]], ":", color=ORANGE, linewidth=1.0)
    axis.plot(x, y, "+", color=VERMILLION, markersize=11, markeredgewidth=2.0, label="reference")
    # A reference beside the picture is shown where it is.
    axis.set_xlim(min(-0.5, x - 4.0), max(width - 0.5, x + 4.0))
    axis.set_ylim(max(height - 0.5, y + 4.0), min(-0.5, y - 4.0))
    axis.set_xlabel("x [px]")
    axis.set_ylabel("y [px]")
    axis.set_title(track.name)
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, ncols=3)


def _distance(axis: Any, track: Track) -> None:
    told = track.valid
    factor, unit = prefixed("m", track.distance[told])
    seconds, second = prefixed("s", track.time)
    time, distance = seconds * track.time, factor * track.distance
    reach = 2.0 * factor * track.sigma
    axis.fill_between(
        time, distance - reach, distance + reach, color=BLUE, alpha=0.25, linewidth=0.0,
        label="two sigma",
    )  # fmt: skip
    axis.plot(time, distance, color=BLUE, linewidth=0.9, label="distance from the reference")
    if not told.all():
        low = float(np.nanmin(distance - reach))
        axis.plot(
            time[~told], np.full(int((~told).sum()), low), "|", color=VERMILLION, markersize=7.0,
            label="lost",
        )  # fmt: skip
    axis.set_xlabel(labelled("time", second))
    axis.set_ylabel(labelled("distance", unit))
    axis.margins(y=0.28)
    axis.legend(loc="upper center", ncols=3)
