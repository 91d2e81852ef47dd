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
from piezo_opt.comparison.turns import directions
from piezo_opt.identification import Fit
from piezo_opt.linear_models import TransferFit
from piezo_opt.measurement import FloatArray, Measurement
from piezo_opt.report.style import (
    BLACK,
    BLUE,
    GREY,
    MODELS,
    MOST_POINTS,
    ORANGE,
    VERMILLION,
    figure,
    labelled,
    plain_log_ticks,
    prefixed,
    styled,
    thinned,
)
from piezo_opt.simulation import INITIAL

_PANELS = 3
"""Panels side by side where there is one for each unknown."""
_TITLE = 24
"""Characters of a title that are no wider than such a panel."""


def loop(entries: Sequence[Entry], record: int = 0) -> Figure:
    """Measured and modelled reading against the drive."""
    with styled():
        made, (axis,) = figure(width=5.2, height=4.2)
        shown = entries[0].misfits[record]
        factor, unit = prefixed(shown.record.position_unit, shown.measured)
        volts, drive_unit = prefixed(shown.record.drive_unit, shown.drive)
        drive, measured = thinned(MOST_POINTS, shown.drive, shown.measured)
        few = measured.size <= 300
        axis.plot(
            volts * drive,
            factor * measured,
            "o-" if few else "-",
            color=BLACK,
            markersize=3.2,
            linewidth=0.6 if few else 1.0,
            label="measured",
        )
        for entry, colour in zip(entries, MODELS, strict=False):
            mine = entry.misfits[record]
            drive, modelled = thinned(MOST_POINTS, mine.drive, mine.measured - mine.error)
            label = entry.label if len(entries) > 1 else "model"
            axis.plot(volts * drive, factor * modelled, color=colour, label=label)
        axis.set_xlabel(labelled("drive", drive_unit))
        axis.set_ylabel(labelled("displacement", unit))
        axis.set_title("Loop")
        axis.legend(loc="upper left")
        return made


def over_time(entries: Sequence[Entry], record: int = 0) -> Figure:
    """Reading over time, measured and modelled, with the error below; start-up shaded."""
    with styled():
        made, (above, below) = figure(2, height=4.4, sharex=True, heights=(1.7, 1.0))
        shown = entries[0].misfits[record]
        whole: Measurement = shown.record
        factor, unit = prefixed(whole.position_unit, whole.position)
        seconds, time_unit = clock(whole.time)
        above.plot(
            *_scaled(seconds, factor, *thinned(MOST_POINTS, whole.time, whole.position)),
            color=BLACK,
            label="measured",
        )
        small, small_unit = prefixed(
            whole.position_unit, *[entry.misfits[record].error for entry in entries]
        )
        for entry, colour in zip(entries, MODELS, strict=False):
            mine = entry.misfits[record]
            label = entry.label if len(entries) > 1 else "model"
            above.plot(
                *_scaled(seconds, factor, *thinned(MOST_POINTS, whole.time, mine.modelled)),
                color=colour,
                label=label,
                linewidth=1.1,
            )
            below.plot(
                *_scaled(seconds, small, *thinned(MOST_POINTS, mine.time, mine.error)),
                color=colour,
                linewidth=0.9,
            )
        below.axhline(0.0, color=BLACK, linewidth=0.7)
        if whole.startup > 0:
            edges = seconds * whole.time[0], seconds * (whole.time[0] + whole.startup)
            for axis in (above, below):
                axis.axvspan(*edges, color="#eef0f3", zorder=0)
            above.plot([], [], color="#d5d9df", linewidth=6, label="simulated, not counted")
        above.set_ylabel(labelled("displacement", unit))
        below.set_ylabel(labelled("measured −\nmodel", small_unit))
        below.set_xlabel(labelled("time", time_unit))
        above.set_title("Over time")
        # Inside the axes there is signal everywhere.
        legend_below(made, above)
        return made


def by_branch(entries: Sequence[Entry], record: int = 0) -> Figure:
    """Error against the drive: rising branch on the left, falling branch on the right."""
    with styled():
        made, axes = figure(1, 2, height=3.2)
        shown = entries[0].misfits[record]
        factor, unit = prefixed(
            shown.record.position_unit, *[entry.misfits[record].error for entry in entries]
        )
        volts, drive_unit = prefixed(shown.record.drive_unit, shown.drive)
        branch = directions(shown.record.drive)[shown.record.counted]
        for axis, sign, name in zip(axes, (1.0, -1.0), ("Loading", "Unloading"), strict=True):
            for entry, colour in zip(entries, MODELS, strict=False):
                mine, where = entry.misfits[record], entry.where[record].by_branch
                drive, error = thinned(
                    MOST_POINTS, mine.drive[branch == sign], mine.error[branch == sign]
                )
                axis.plot(
                    volts * drive,
                    factor * error,
                    ".",
                    color=colour,
                    alpha=0.6 if error.size <= 300 else 0.15,
                    markersize=4.0 if error.size <= 300 else 2.5,
                    rasterized=error.size > 1500,
                )
                mean = where.loading_mean if sign > 0 else where.unloading_mean
                centre = 0.5 * (where.edges[1:] + where.edges[:-1])
                label = f"mean, {entry.label}" if len(entries) > 1 else "mean in each bin"
                axis.plot(
                    volts * centre,
                    factor * mean,
                    "o-",
                    color=colour,
                    linewidth=1.8,
                    markersize=6,
                    markeredgecolor="white",
                    label=label,
                )
            axis.axhline(0.0, color=BLACK, linewidth=0.7)
            axis.set_title(f"{name} (drive {'rises' if sign > 0 else 'falls'})")
            axis.set_xlabel(labelled("drive", drive_unit))
        _share_y(axes)
        axes[0].set_ylabel(labelled("measured − model", unit))
        legend_below(made, axes[0])
        return made


def spectrum(entries: Sequence[Entry], record: int = 0) -> Figure | None:
    """Amplitude spectra of reading and error, and how much of the error follows the drive.

    None for a record without even sampling, or too short for an averaged spectrum.
    """
    views = [entry.where[record].by_frequency for entry in entries]
    if not np.isfinite(views[0].band):
        return None
    with styled():
        made, (above, below) = figure(2, height=4.4, sharex=True, heights=(1.6, 1.0))
        base = entries[0].misfits[record].record.position_unit
        roots = [np.sqrt(view.error) for view in views]
        # Between the largest of both: four decades apart, one of them would need powers of ten.
        largest = float(np.sqrt(views[0].reading.max())), max(float(r.max()) for r in roots)
        factor, unit = prefixed(base, np.sqrt([largest[0] * largest[1]]))
        above.loglog(
            views[0].frequency, factor * np.sqrt(views[0].reading), color=BLACK, label="reading"
        )
        for entry, view, root, colour in zip(entries, views, roots, MODELS, strict=False):
            label = f"error, {entry.label}" if len(entries) > 1 else "error"
            above.loglog(view.frequency, factor * root, color=colour, label=label)
            below.semilogx(view.frequency, view.coherence, color=colour, linewidth=1.0)
        below.axhline(views[0].band, color=GREY, linestyle="--", linewidth=1.0)
        below.annotate(
            "99.9 % of noise stays below",
            (views[0].frequency[0], views[0].band),
            xytext=(3, 3),
            textcoords="offset points",
            color="#5b616b",
            fontsize=8,
        )
        below.set_ylim(0.0, 1.05)
        above.set_ylabel(f"density [{unit}/√Hz]")
        below.set_ylabel("coherence of\nerror and drive")
        below.set_xlabel("frequency [Hz]")
        above.set_title("By frequency")
        plain_log_ticks(below.xaxis)
        plain_log_ticks(above.yaxis)
        above.legend(loc="upper right")
        return made


def after_events(entries: Sequence[Entry], record: int = 0) -> Figure | None:
    """Mean error after a step or reversal against the logarithm of time; None without enough."""
    views = [entry.where[record].after_events for entry in entries]
    if not views[0].events or views[0].since.size < 4:
        return None
    with styled():
        made, (axis,) = figure(height=3.2)
        factor, unit = prefixed(
            entries[0].misfits[record].record.position_unit, *[view.mean for view in views]
        )
        for entry, view, colour in zip(entries, views, MODELS, strict=False):
            band = factor * 2.0 * view.uncertainty
            axis.fill_between(
                view.since,
                factor * view.mean - band,
                factor * view.mean + band,
                color=colour,
                alpha=0.15,
                linewidth=0,
            )
            axis.semilogx(
                view.since,
                factor * view.mean,
                "o-",
                color=colour,
                markersize=4,
                label=entry.label if len(entries) > 1 else "mean ± 2 standard errors",
            )
        axis.axhline(0.0, color=BLACK, linewidth=0.7)
        plain_log_ticks(axis.xaxis)
        kind, events = views[0].kind, views[0].events
        axis.set_title(f"After {'steps' if kind == 'step' else 'reversals'} ({events} averaged)")
        axis.set_xlabel(f"time since the drive's last {kind} [s]")
        axis.set_ylabel(f"measurement ahead of\nthe model [{unit}]")
        axis.legend(loc="best")
        return made


def by_amplitude(entries: Sequence[Entry], record: int = 0) -> Figure | None:
    """Rms error against the swing of the drive; None for a record of one amplitude."""
    views = [entry.where[record].by_amplitude for entry in entries]
    if views[0].swing.size < 2:
        return None
    with styled():
        made, (axis,) = figure(height=3.0)
        misfit = entries[0].misfits[record]
        factor, unit = prefixed(misfit.record.position_unit, *[view.rms for view in views])
        volts, drive_unit = prefixed(misfit.record.drive_unit, misfit.drive)
        for entry, view, colour in zip(entries, views, MODELS, strict=False):
            axis.plot(volts * view.swing, factor * view.rms, "o-", color=colour, label=entry.label)
        axis.set_ylim(bottom=0.0)
        axis.set_xlim(left=0.0)
        axis.set_title("By amplitude")
        axis.set_xlabel(labelled("swing of the drive between two turns", drive_unit))
        axis.set_ylabel(labelled("rms error", unit))
        if len(entries) > 1:
            axis.legend(loc="best")
        return made


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


def clock(time: FloatArray) -> tuple[float, str]:
    span = float(time[-1] - time[0])
    if span < 1e-3:
        return 1e6, "µs"
    return (1e3, "ms") if span < 1.0 else (1.0, "s")


def _scaled(
    across: float, up: float, time: FloatArray, values: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return across * time, up * values


def _share_y(axes: Sequence[Axes]) -> None:
    low = min(axis.get_ylim()[0] for axis in axes)
    high = max(axis.get_ylim()[1] for axis in axes)
    for axis in axes:
        axis.set_ylim(low, high)


def legend_below(made: Figure, axis: Axes) -> None:
    # The only layout that makes room for a legend outside of all axes; it costs two more passes.
    made.set_layout_engine("constrained")
    handles, names = axis.get_legend_handles_labels()
    fitting = max(1, 90 // (max(map(len, names)) + 8))
    made.legend(handles, names, loc="outside lower center", ncols=min(fitting, len(names)))
