"""The pictures of a diagnosis: who is suspected, and how the error falls to the noise."""

from __future__ import annotations

import re
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezo_opt.diagnosis import Diagnosis, Quantity
from piezo_opt.diagnosis.advice import Advice
from piezo_opt.pictures.picture import clock, prefixed
from piezo_opt.report.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    PURPLE,
    SKY,
    VERMILLION,
    figure,
    labelled,
    legend_below,
    plain_log_ticks,
    styled,
    thinned,
)

_MOST_SUSPECTS = 12
"""Bars; the table below them has all candidates."""
_APART = 0.15
"""Logarithm of fitted over held-out error from which both are written beside their points."""
_TITLE = 72
"""Letters of a title in one line."""
_BINS = 16
"""Bins in which a correction is averaged over the signal that it depends on."""
_LETTERS = 84
"""Letters that fit side by side under an axis."""
SIGNIFICANT = 1e-3
"""Corrected p-value below which a bar is drawn in colour."""


def ladder(diagnosis: Diagnosis) -> Figure | None:
    """Error after each accepted effect, fitted and held out, over the noise floor."""
    points = diagnosis.ladder
    if not points:
        return None
    noise = diagnosis.noise
    with styled():
        made, (axis,) = figure(height=3.8)
        train = np.array([p.rms for p in points])
        held = np.array([np.nan if p.held_out is None else p.held_out for p in points])
        factor, unit = prefixed("m", train, held[np.isfinite(held)])
        place = np.arange(len(points))
        low, high = factor * noise.low, factor * noise.high
        axis.axhspan(low, high, color="#d8efe6", zorder=0)
        axis.axhline(
            factor * noise.rms,
            color=GREEN,
            linewidth=1.2,
            linestyle="-" if noise.measured else "--",
            label=f"noise floor, {'measured' if noise.measured else 'estimated'}",
        )
        axis.plot(
            place, factor * train, "o-", color=BLUE, markersize=7, linewidth=2, label="fitted data"
        )
        if np.isfinite(held).any():
            axis.plot(
                place,
                factor * held,
                "s--",
                color=VERMILLION,
                markersize=6,
                linewidth=1.6,
                label="held-out data",
            )
        values = factor * np.concatenate([train, held[np.isfinite(held)]])
        bottom, top = min(values.min(), factor * noise.rms), values.max()
        if top > 4.0 * bottom:
            axis.set_yscale("log")
            # Room for the numbers, on a long axis as on a short one.
            room = (top / bottom) ** 0.15
            axis.set_ylim(bottom / max(1.4, room), top * max(1.8, room))
            plain_log_ticks(axis.yaxis)
        else:
            axis.set_ylim(0.0, 1.22 * top)
        for x, now, other in zip(place, factor * train, factor * held, strict=True):
            below = now < other
            _beside(axis, float(x), float(now), f"{now:.4g} {unit}", BLUE, below=bool(below))
            if np.isfinite(other) and abs(np.log(other / now)) > _APART:
                text = f"{other:.4g} {unit}"
                _beside(axis, float(x), float(other), text, VERMILLION, below=not below)
        axis.set_xticks(place, [_wrapped(p.label, _LETTERS // len(points)) for p in points])
        axis.set_xlim(-0.5, len(points) - 0.45)
        axis.grid(visible=False, axis="x")
        axis.set_ylabel(labelled("rms error", unit))
        axis.set_title("The ladder: the error as effects are added")
        legend_below(made, axis)
        return made


def _wrapped(label: str, width: int) -> str:
    """A label in lines of so many letters, broken after a blank or an underscore."""
    lines = [""]
    for part in re.findall(r"[^ _]*[ _]?", label):
        if lines[-1] and len(lines[-1]) + len(part.rstrip()) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(line.strip() for line in lines)


def _beside(axis: Axes, x: float, y: float, text: str, colour: str, *, below: bool) -> None:
    axis.annotate(
        text,
        (x, y),
        # A falling ladder leaves room below to the left and above to the right.
        xytext=(-8, -12) if below else (8, 5),
        ha="right" if below else "left",
        textcoords="offset points",
        fontsize=9,
        fontweight="bold",
        color=colour,
    )


def suspects(diagnosis: Diagnosis) -> Figure | None:
    """Share of the error that each absent effect would explain, and what the record can see."""
    shown = diagnosis.suspects[:_MOST_SUSPECTS]
    if not shown:
        return None
    taken = {step.name for step in diagnosis.steps}
    with styled():
        made, (left, right) = figure(1, 2, height=0.34 * len(shown) + 1.5)
        place = np.arange(len(shown))[::-1]
        colours = [
            VERMILLION if s.name in taken else BLUE if s.p_value < SIGNIFICANT else "#c3c8d0"
            for s in shown
        ]
        left.barh(place, [100.0 * s.score for s in shown], color=colours, height=0.62)
        for y, suspect in zip(place, shown, strict=True):
            left.annotate(
                percent(suspect.score),
                (100.0 * suspect.score, float(y)),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                fontsize=8.5,
            )
        left.set_yticks(place, [s.name for s in shown])
        left.set_xlim(0.0, 118.0)
        left.set_xticks([0, 25, 50, 75, 100])
        left.set_xlabel("share of the error explained [%]")
        left.set_title("Suspects, before any refit")
        for colour, text in (
            (VERMILLION, "accepted"),
            (BLUE, "beyond chance"),
            ("#c3c8d0", "within chance"),
        ):
            if colour in colours:
                left.plot([], [], "s", color=colour, markersize=7, label=text)
        right.barh(place, [100.0 * s.visibility for s in shown], color=SKY, height=0.62)
        for y, suspect in zip(place, shown, strict=True):
            like = ", ".join(name for name, cosine in suspect.overlaps[:2] if cosine > 0.9)
            right.annotate(
                percent(suspect.visibility) + (f"  like {like}" if like else ""),
                (100.0 * suspect.visibility, float(y)),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                fontsize=7.5,
                color="#40454e",
            )
        right.set_yticks([])
        right.set_xlim(0.0, 200.0)
        right.set_xticks([0, 50, 100])
        right.set_xlabel("visible in this record [%]")
        right.set_title("Could it be seen, and what is alike")
        for axis in (left, right):
            axis.grid(visible=False, axis="y")
            axis.set_ylim(-0.7, len(shown) - 0.3)
        legend_below(made, left)
        return made


def percent(share: float) -> str:
    """A share with two digits below ten percent, and none after the point above."""
    value = 100.0 * share
    return f"{value:.0f} %" if value >= 10.0 else f"{value:.2g} %"


def correction(diagnosis: Diagnosis) -> Figure | None:
    """The smallest correction that would explain the rest: over time, and against the signal.

    None where the diagnosis needs none.
    """
    left = diagnosis.unexplained
    if left is None:
        return None
    force = left.forces[0]
    with styled():
        made, axes = figure(1, 1 if left.against is None else 2, height=3.1)
        time, values = force.time[0], force.correction[0]
        factor, unit = prefixed(force.place.unit, values)
        seconds, time_unit = clock(time)
        axes[0].plot(*thinned(seconds * time, factor * values), color=PURPLE, linewidth=0.9)
        axes[0].set_xlabel(labelled("time", time_unit))
        axes[0].set_ylabel(labelled("correction", unit))
        axes[0].set_title(f"What the {force.place.value} lacks")
        if left.against is not None:
            quantity = Quantity(left.against.split(",")[0])
            of, values = np.concatenate(force.signals[quantity]), np.concatenate(force.correction)
            across, of_unit = prefixed(quantity.unit, of)
            axes[1].plot(
                across * of,
                factor * values,
                ".",
                color=PURPLE,
                markersize=2.5,
                alpha=0.15 if of.size > 300 else 0.6,
                rasterized=of.size > 1500,
            )
            edges = np.quantile(of, np.linspace(0.0, 1.0, _BINS + 1))
            index = np.clip(np.searchsorted(edges, of, side="right") - 1, 0, _BINS - 1)
            filled = [k for k in range(_BINS) if (index == k).any()]
            axes[1].plot(
                [across * of[index == k].mean() for k in filled],
                [factor * values[index == k].mean() for k in filled],
                "o-",
                color=BLACK,
                markersize=4,
                label="mean in each bin",
            )
            axes[1].set_xlabel(labelled(quantity.value, of_unit))
            axes[1].set_title(f"Against {left.against}")
            axes[1].legend(loc="best")
        return made


def to_play(advice: Advice) -> Figure:
    """The drive that is worth playing next."""
    with styled():
        made, (axis,) = figure(height=2.3)
        seconds, time_unit = clock(advice.drive.time)
        time, values = thinned(advice.drive.time, advice.drive.values)
        axis.plot(seconds * time, values, color=GREY, linewidth=1.0)
        axis.set_xlabel(labelled("time", time_unit))
        axis.set_ylabel(labelled("drive", advice.drive.unit))
        said = advice.drive.description
        axis.set_title(fill(said[:1].upper() + said[1:], _TITLE))
        return made
