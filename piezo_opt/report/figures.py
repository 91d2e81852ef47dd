"""The pictures: small functions, one for each question an engineer asks, each gives a Figure.

Everything is drawn in SI units with a prefix chosen for the axis. No function touches state that
others share; save a picture with ``savefig``.
"""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from piezo_opt.comparison import Entry
from piezo_opt.identification import Fit
from piezo_opt.linear_models import TransferFit
from piezo_opt.measurement import FloatArray, Measurement
from piezo_opt.pictures import places, records
from piezo_opt.pictures.picture import prefixed
from piezo_opt.report.drawing import drawn
from piezo_opt.report.style import (
    BLACK,
    BLUE,
    ORANGE,
    VERMILLION,
    figure,
    labelled,
    legend_below,
    styled,
)
from piezo_opt.simulation import INITIAL

_WINDOW = 0.04
"""Part of the record that the zoom shows."""
_PANELS = 3
"""Panels side by side where there is one for each unknown."""
_TITLE = 24
"""Characters of a title that are no wider than such a panel."""


def loop(entries: Sequence[Entry], record: int = 0) -> Figure:
    """Measured and modelled reading against the drive."""
    return drawn(records.loop(_seen(entries, record)), width=5.2, height=4.2)


def over_time(entries: Sequence[Entry], record: int = 0) -> Figure:
    """Reading over time, measured and modelled, with the error below; start-up shaded."""
    return drawn(records.over_time(_seen(entries, record)), height=4.4)


def zoom(entries: Sequence[Entry], record: int = 0) -> Figure:
    """The stretch where the first model's error is largest: reading above, error below."""
    shown = entries[0].misfits[record]
    part = np.flatnonzero(shown.record.counted)[window(shown.error)]
    seen = _seen(entries, record, slice(int(part[0]), int(part[-1]) + 1))
    return drawn(records.over_time(seen, "Where the first model is worst"), height=4.0)


def window(error: FloatArray) -> slice:
    """The part of a record in which the mean square error is largest, 20 samples at least."""
    count = min(error.size, max(20, round(_WINDOW * error.size)))
    power = np.concatenate([[0.0], np.cumsum(error**2)])
    begin = int(np.argmax(power[count:] - power[:-count]))
    return slice(begin, begin + count)


def _seen(entries: Sequence[Entry], record: int, part: slice | None = None) -> records.Seen:
    whole: Measurement = entries[0].misfits[record].record
    at = slice(None) if part is None else part
    several = len(entries) > 1
    begin = float(whole.time[0])
    return records.Seen(
        whole.time[at],
        whole.drive[at],
        whole.position[at],
        whole.counted[at],
        whole.drive_unit,
        whole.position_unit,
        [(e.label if several else "model", e.misfits[record].modelled[at]) for e in entries],
        startup=(begin, begin + whole.startup) if whole.startup > 0 and part is None else None,
    )


def by_branch(entries: Sequence[Entry], record: int = 0) -> Figure:
    """Error against the drive: rising branch on the left, falling branch on the right."""
    return drawn(places.branch(_judged(entries, record)))


def spectrum(entries: Sequence[Entry], record: int = 0) -> Figure | None:
    """Amplitude spectra of reading and error, and how much of the error follows the drive.

    None for a record without even sampling, or too short for an averaged spectrum.
    """
    made = places.frequency(_judged(entries, record))
    return None if made is None else drawn(made, height=4.4)


def after_events(entries: Sequence[Entry], record: int = 0) -> Figure | None:
    """Mean error after a step or reversal against the logarithm of time; None without enough."""
    made = places.events(_judged(entries, record))
    return None if made is None else drawn(made)


def by_amplitude(entries: Sequence[Entry], record: int = 0) -> Figure | None:
    """Rms error against the swing of the drive; None for a record of one amplitude."""
    made = places.amplitude(_judged(entries, record))
    return None if made is None else drawn(made, height=3.0)


def _judged(entries: Sequence[Entry], record: int) -> list[places.Judged]:
    return [(one.label, one.misfits[record], one.where[record]) for one in entries]


def correlations(entry: Entry | TransferFit, record: int = 0) -> Figure:
    """Auto- and cross-correlation of the error with the 99.9 % band (residual test)."""
    with styled():
        made, axes = figure(1, 2, height=2.9)
        noise = entry.whiteness[record]
        for axis, values, title, lag in zip(
            axes,
            (noise.autocorrelation, noise.cross_correlation),
            ("Error with itself", "Error with the drive"),
            ("lag [samples]", "lag of the error behind the drive [samples]"),
            strict=True,
        ):
            outside = np.abs(values) > noise.band
            outside &= ~((noise.lags == 0) & (title == "Error with itself"))
            axis.axhspan(-noise.band, noise.band, color="#dfe7f3", zorder=0)
            for part, colour in ((~outside, BLUE), (outside, VERMILLION)):
                axis.vlines(noise.lags[part], 0.0, values[part], color=colour, linewidth=1.4)
                axis.plot(noise.lags[part], values[part], "o", color=colour, markersize=3.2)
            axis.axhline(0.0, color=BLACK, linewidth=0.7)
            axis.set_title(title)
            axis.set_xlabel(lag)
            reach = max(1.3 * noise.band, 1.1 * float(np.abs(values).max()))
            axis.set_ylim(-min(reach, 1.05), min(reach, 1.05))
        axes[0].set_ylabel("correlation")
        axes[1].plot([], [], color="#dfe7f3", linewidth=7, label="99.9 % of white noise")
        axes[1].plot([], [], "o", color=VERMILLION, markersize=3.2, label="outside")
        legend_below(made, axes[1])
        return made


def trajectories(fit: Fit) -> Figure | None:
    """Every unknown over the iterations, one panel each, and the rms error last.

    Thesis, Fig. 3.19. None when the solver left no trace of two iterates.
    """
    if fit.trace.rms.size < 2:
        return None
    names = fit.trace.names
    with styled():
        rows = -(-(len(names) + 1) // _PANELS)
        made, axes = figure(rows, _PANELS, height=1.75 * rows + 0.3)
        steps = np.arange(fit.trace.rms.size, dtype=np.float64)
        for axis, name, values in zip(axes, names, fit.trace.values.T, strict=False):
            factor, unit = prefixed(fit.unit(name), values)
            _trajectory(axis, steps, factor * values, labelled(_short(name), unit), BLUE)
        last = axes[len(names)]
        factor, unit = prefixed("m", fit.trace.rms)
        _trajectory(last, steps, factor * fit.trace.rms, labelled("rms error", unit), VERMILLION)
        if float(fit.trace.rms.max()) > 10.0 * float(fit.trace.rms.min()) > 0.0:
            last.set_yscale("log")
        for axis in axes[len(names) + 1 :]:
            axis.set_visible(False)
        for axis in axes[max(0, len(names) + 1 - _PANELS) : len(names) + 1]:
            axis.set_xlabel("iteration")
        return made


def estimates(fit: Fit) -> Figure | None:
    """Every estimate with its 95 % interval, relative to its value; None when nothing is known.

    An interval that spans zero means that the record does not show the sign.
    """
    known = [n for n in fit.names if np.isfinite(fit.std[n]) and fit.values[n] != 0.0]
    if not known:
        return None
    with styled():
        made, (axis,) = figure(width=7.2, height=0.34 * len(known) + 1.1)
        half = np.array(
            [100.0 * (fit.interval(n)[1] - fit.values[n]) / abs(fit.values[n]) for n in known]
        )
        reach = float(np.clip(1.15 * half.max(), 1e-3, 250.0))
        place = np.arange(len(known))[::-1]
        for y, size, name in zip(place, half, known, strict=True):
            certain = size < 100.0
            colour = BLUE if certain else VERMILLION
            drawn = min(float(size), reach)
            axis.plot([-drawn, drawn], [y, y], color=colour, linewidth=2.2, solid_capstyle="butt")
            axis.plot([0.0], [y], "o", color=colour, markersize=4.5)
            text = f"{_short(name)}  ± {float(f'{size:.2g}'):g} %"
            if size >= 1e3:
                text = f"{_short(name)}  unknown"
            axis.annotate(
                text,
                (-0.02, y),
                xycoords=("axes fraction", "data"),
                ha="right",
                va="center",
                fontsize=8.5,
            )
        axis.axvline(0.0, color=BLACK, linewidth=0.7)
        axis.set_xlim(-reach, reach)
        axis.set_ylim(-0.7, len(known) - 0.3)
        axis.set_yticks([])
        axis.grid(visible=False, axis="y")
        axis.spines["left"].set_visible(False)
        axis.set_title("Estimates ± 95 %, relative to the value")
        axis.set_xlabel("deviation from the estimate [%]")
        return made


def multi_start(fit: Fit) -> Figure | None:
    """Where every start of a multi-start led, best first; None for a single start."""
    if len(fit.starts) < 2:
        return None
    with styled():
        made, (axis,) = figure(height=2.9)
        reached = np.sort(np.array([start.rms for start in fit.starts]))
        reached = reached[np.isfinite(reached)]
        if reached.size == 0:
            return None
        factor, unit = prefixed("m", reached[:1])
        same = reached <= reached[0] * 1.001
        order = np.arange(1, reached.size + 1)
        for part, colour, label in (
            (same, BLUE, f"same optimum: {np.count_nonzero(same)} of {len(fit.starts)}"),
            (~same, ORANGE, "elsewhere"),
        ):
            if part.any():
                axis.plot(
                    order[part],
                    factor * reached[part],
                    "o",
                    color=colour,
                    markersize=5,
                    label=label,
                )
        if reached[-1] > 20.0 * reached[0] > 0.0:
            axis.set_yscale("log")
        else:
            # From zero: a difference in the tenth digit must not look like one.
            axis.set_ylim(0.0, 1.35 * factor * float(reached[-1]))
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
        axis.set_title("Where the starts led")
        axis.set_xlabel("start, sorted by result")
        axis.set_ylabel(labelled("rms error", unit))
        axis.legend(loc="upper left")
        return made


def _short(name: str) -> str:
    """A parameter as a picture names it: initial states say so in words."""
    return f"{name.removeprefix(INITIAL)} at start" if name.startswith(INITIAL) else name


def _trajectory(axis: Axes, steps: FloatArray, values: FloatArray, title: str, colour: str) -> None:
    marker = "o-" if steps.size <= 40 else "-"
    axis.plot(steps, values, marker, color=colour, markersize=2.8, linewidth=1.1)
    # The layout leaves no room beside a panel for a title wider than that.
    axis.set_title(fill(title, _TITLE, break_long_words=False), fontsize=9, fontweight="normal")
    axis.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=5))
    if axis.get_yscale() != "log":
        axis.yaxis.set_major_locator(MaxNLocator(nbins=4))
