"""Pictures of black-box linear models: poles, responses, residuals, and what is not linear."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from matplotlib.figure import Figure

from piezo_opt.comparison import Misfit
from piezo_opt.linear_models import FrequencyResponse, OrderSearch, TransferFit, step_criteria
from piezo_opt.linear_models.transfer import half_width
from piezo_opt.measurement import FloatArray
from piezo_opt.pictures.picture import clock, prefixed
from piezo_opt.report.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    MODELS,
    ORANGE,
    VERMILLION,
    figure,
    labelled,
    legend_below,
    plain_log_ticks,
    styled,
    thinned,
)

if TYPE_CHECKING:
    import control

    System: TypeAlias = control.StateSpace | control.TransferFunction


def reading(misfits: Sequence[tuple[str, Misfit]]) -> Figure:
    """Reading and models over time, their errors below."""
    with styled():
        made, (above, below) = figure(2, height=4.4, sharex=True, heights=(1.7, 1.0))
        first = misfits[0][1]
        factor, unit = prefixed(first.record.position_unit, first.measured)
        seconds, time_unit = clock(first.time)
        t, y = thinned(first.time, first.measured)
        above.plot(seconds * t, factor * y, color=BLACK, label="measured")
        small, small_unit = prefixed(first.record.position_unit, *[one.error for _, one in misfits])
        for (label, one), colour in zip(misfits, MODELS, strict=False):
            t, y = thinned(one.time, one.measured - one.error)
            above.plot(seconds * t, factor * y, color=colour, label=label, linewidth=1.0)
            t, e = thinned(one.time, one.error)
            below.plot(seconds * t, small * e, color=colour, linewidth=0.9)
        below.axhline(0.0, color=BLACK, linewidth=0.7)
        above.set_ylabel(labelled("displacement", unit))
        below.set_ylabel(labelled("measured −\nmodel", small_unit))
        below.set_xlabel(labelled("time", time_unit))
        above.set_title("Over time")
        legend_below(made, above)
        return made


def poles_and_zeros(fit: TransferFit) -> Figure:
    """Poles and zeros in the complex plane with 95 % intervals of both parts."""
    with styled():
        made, (axis,) = figure(width=5.2, height=4.2)
        wide = half_width(fit)
        step = min(one.step for one in fit.question.records.records)
        for roots, sigma, mark, colour, label in (
            (fit.poles, fit.pole_sigma, "x", VERMILLION, "poles"),
            (fit.zeros, fit.zero_sigma, "o", BLUE, "zeros"),
        ):
            if not roots.size:
                continue
            size = np.abs(roots)
            near = np.minimum(wide * sigma, size[:, None])
            axis.errorbar(
                roots.real, roots.imag, xerr=near[:, 0], yerr=near[:, 1], fmt=mark,
                color=colour, markerfacecolor="none", markersize=7, elinewidth=0.9, capsize=2,
                label=label,
            )  # fmt: skip
        axis.axvline(0.0, color=BLACK, linewidth=0.7)
        axis.axhline(0.0, color=BLACK, linewidth=0.7)
        half = np.pi / step
        low, high = axis.get_ylim()
        if max(abs(low), abs(high)) > 0.5 * half:
            for sign in (-1.0, 1.0):
                axis.axhline(sign * half, color=GREY, linestyle="--", linewidth=0.9)
            axis.plot([], [], color=GREY, linestyle="--", label="half the sampling rate")
        axis.set_xlabel("real part [1/s]")
        axis.set_ylabel("imaginary part [1/s]")
        axis.set_title("Poles and zeros")
        legend_below(made, axis)
        return made


def bode(
    systems: Sequence[tuple[str, System]],
    units: tuple[str, str],
    span: tuple[float, float],
    measured: FrequencyResponse | None = None,
) -> Figure:
    """Gain and phase; a measured response with its noise and distortion behind.

    Args:
        systems: label and system.
        units: drive_unit and position_unit.
        span: lowest and highest frequency [Hz].
        measured: what was measured, if it was.
    """
    with styled():
        made, (gain, phase) = figure(2, height=4.8, sharex=True, heights=(1.6, 1.0))
        frequency = np.geomspace(*span, 1200)
        answers = [
            (label, frequency, np.asarray(system(2j * np.pi * frequency)).ravel())
            for label, system in systems
        ]
        if measured is not None:
            answers.insert(0, ("measured", measured.frequency, measured.response))
        factor, unit = prefixed(units[1], np.concatenate([np.abs(g) for _, _, g in answers]))
        colours = ([BLACK] if measured is not None else []) + list(MODELS)
        for (label, f, g), colour in zip(answers, colours, strict=False):
            style = "." if label == "measured" else "-"
            gain.loglog(f, factor * np.abs(g), style, color=colour, label=label, markersize=2.5)
            phase.semilogx(
                f, np.degrees(np.unwrap(np.angle(g))), style, color=colour, markersize=2.5
            )
        if measured is not None:
            for values, colour, label in (
                (measured.noise, GREEN, "noise of the mean"),
                (measured.distortion, ORANGE, "distortion of one realisation"),
            ):
                seen = np.isfinite(values) & (values > 0.0)
                if seen.any():
                    gain.loglog(
                        measured.frequency[seen], factor * values[seen], ".",
                        color=colour, markersize=1.8, label=label,
                    )  # fmt: skip
        gain.set_ylabel(labelled("gain", f"{unit}/{units[0]}"))
        phase.set_ylabel("phase [°]")
        phase.set_xlabel("frequency [Hz]")
        plain_log_ticks(phase.xaxis)
        gain.set_title("Frequency response")
        legend_below(made, gain)
        return made


def step(systems: Sequence[tuple[str, System]], units: tuple[str, str]) -> Figure:
    """Answers to a unit step, with the 2 % band of the first one's final value."""
    import control

    with styled():
        made, (axis,) = figure(height=3.4)
        seen = step_criteria(systems[0][1])
        length = max(1.6 * seen.settling_time, 4.0 * seen.rise_time, 1e-12)
        time = np.linspace(0.0, length, 1500)
        curves = [
            (label, np.asarray(control.step_response(system, time).outputs).ravel())
            for label, system in systems
        ]
        factor, unit = prefixed(units[1], *[values for _, values in curves])
        seconds, time_unit = clock(time)
        axis.axhspan(
            *sorted((0.98 * factor * seen.final, 1.02 * factor * seen.final)),
            color="#dfe7f3", zorder=0,
        )  # fmt: skip
        axis.plot([], [], color="#dfe7f3", linewidth=7, label="2 % of the final value")
        for (label, values), colour in zip(curves, MODELS, strict=False):
            axis.plot(seconds * time, factor * values, color=colour, label=label)
        axis.set_xlabel(labelled("time", time_unit))
        axis.set_ylabel(labelled("displacement", f"{unit}/{units[0]}"))
        axis.set_title("Answer to a step")
        legend_below(made, axis)
        return made


def orders(search: OrderSearch) -> Figure:
    """Mean squared error of every order tried, fitted and on the test records."""
    with styled():
        made, (axis,) = figure(height=3.4)
        labels = [f"{r.fit.question.poles}, {r.fit.question.zeros}" for r in search.rows]
        at = np.arange(len(labels))
        own = np.array([row.fit.metrics.rms for row in search.rows])
        test = [row.test.rms if row.test is not None else np.nan for row in search.rows]
        unit = search.rows[0].fit.question.records.records[0].position_unit
        factor, shown = prefixed(unit, own)
        axis.semilogy(at, factor * own, "o-", color=BLUE, label="fitted", linewidth=0.8)
        if np.isfinite(test).any():
            axis.semilogy(
                at, factor * np.array(test), "s-", color=VERMILLION, label="test", linewidth=0.8
            )
        chosen = search.rows.index(search.chosen)
        axis.axvspan(chosen - 0.3, chosen + 0.3, color="#dfe7f3", zorder=0)
        axis.plot([], [], color="#dfe7f3", linewidth=7, label="chosen")
        axis.set_xticks(at, labels)
        axis.set_xlabel("poles, zeros")
        axis.set_ylabel(labelled("rms error", shown))
        axis.set_title("Orders")
        plain_log_ticks(axis.yaxis)
        legend_below(made, axis)
        return made


def free_lines(response: FrequencyResponse) -> Figure | None:
    """What is read at the lines that the drive leaves free; None where it leaves none."""
    if not response.separates:
        return None
    with styled():
        made, (axis,) = figure(height=3.4)
        unit = response.units[1]
        factor, shown = prefixed(unit, response.even, response.odd)
        curves: list[tuple[FloatArray, FloatArray, str, str]] = [
            (response.even_frequency, response.even, BLUE, "even lines"),
            (response.odd_frequency, response.odd, VERMILLION, "odd lines"),
        ]
        if response.floor.size:
            inside = response.lines <= response.frequency[-1]
            curves.append((response.lines[inside], response.floor[inside], GREY, "noise"))
        for frequency, values, colour, label in curves:
            axis.loglog(
                frequency, factor * np.maximum(values, 1e-300), ".", color=colour, markersize=3,
                label=label,
            )  # fmt: skip
        axis.set_xlabel("frequency [Hz]")
        axis.set_ylabel(labelled("reading", shown))
        axis.set_title("Where the drive is silent")
        plain_log_ticks(axis.xaxis)
        legend_below(made, axis)
        return made
