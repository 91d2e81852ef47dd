"""Pictures of stages with several axes: response matrix, error spectrum, errors by amplitude."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from piezo_opt.linear_models import AxesError, ModalModel, ResponseMatrix
from piezo_opt.linear_models.modal_judging import residual
from piezo_opt.measurement import AxesCampaign, FloatArray
from piezo_opt.pictures.picture import prefixed
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
)
from piezo_opt.units import show

_SMOOTHED: Final = 100
"""Points on a logarithmic axis of frequency: more than a reader tells apart in a small panel."""


def matrix(response: ResponseMatrix, model: ModalModel | None = None) -> Figure:
    """Gain of every axis to every drive, with the deviation that noise and distortion leave."""
    axes, drives = response.response.shape[1:]
    with styled():
        made, panels = figure(axes, drives, width=3.1 * drives + 0.6, height=2.3 * axes + 0.8)
        drive, position = response.units
        factor, unit = prefixed(position, np.abs(response.response))
        fitted = None if model is None else model.response(response.frequency, response.amplitude)
        for panel, (a, d) in zip(panels, np.ndindex(axes, drives), strict=True):
            f = response.frequency
            panel.loglog(
                f, factor * np.abs(response.response[:, a, d]), ".", color=BLACK, markersize=1.6,
                label="measured", rasterized=True,
            )  # fmt: skip
            for sigma, colour, label in (
                (response.total[:, a, d], ORANGE, "its deviation, noise and distortion"),
                (response.noise[:, a, d], GREEN, "from noise alone"),
            ):
                if np.isfinite(sigma).all() and bool(np.any(sigma > 0.0)):
                    panel.loglog(
                        *_banded(f, factor * sigma), color=colour, label=label, linewidth=1.0
                    )
            if fitted is not None:
                panel.loglog(
                    f, factor * np.abs(fitted[:, a, d]), color=VERMILLION, linewidth=0.9,
                    label="model",
                )  # fmt: skip
            panel.set_title(f"axis {a + 1}, drive {d + 1}")
            plain_log_ticks(panel.xaxis)
            if d == 0:
                panel.set_ylabel(labelled("gain", f"{unit}/{drive}"))
            if a == axes - 1:
                panel.set_xlabel("frequency [Hz]")
        legend_below(made, panels[0])
        return made


def error_spectrum(model: ModalModel, level: AxesCampaign, response: ResponseMatrix) -> Figure:
    """Reading, simulation error, distortion and noise of every axis over frequency."""
    with styled():
        axes = model.axes
        made, panels = figure(1, axes, width=3.1 * axes + 0.6, height=3.4)
        error, reading = _spectra(model, level)
        first = level.records[0]
        samples = first.period or len(first)
        f = np.fft.rfftfreq(samples, 1.0 / first.rate)
        inside = (f >= response.frequency[0]) & (f <= response.frequency[-1])
        factor, unit = prefixed(response.units[1], np.sqrt(reading))
        for a, panel in enumerate(panels):
            for values, at, colour, label in (
                (np.sqrt(reading[inside, a]), f[inside], BLACK, "reading"),
                (np.sqrt(error[inside, a]), f[inside], VERMILLION, "simulation error"),
                (response.distortion[:, a], response.frequency, BLUE, "distortion"),
                (response.noise_of_reading[:, a], response.frequency, GREEN, "noise"),
            ):
                if np.isfinite(values).all():
                    panel.loglog(*_banded(at, factor * values), color=colour, label=label)
            panel.set_title(f"axis {a + 1}")
            panel.set_xlabel("frequency [Hz]")
            plain_log_ticks(panel.xaxis)
            if a == 0:
                panel.set_ylabel(labelled("amplitude of a line", unit))
        legend_below(made, panels[0])
        return made


def errors(found: Sequence[tuple[str, AxesError]], responses: Sequence[ResponseMatrix]) -> Figure:
    """Error on held-out realisations by amplitude, one bar for each kind of model."""
    with styled():
        made, (panel,) = figure(width=6.6, height=3.4)
        levels = found[0][1].levels
        at = np.arange(len(levels))
        wide = 0.8 / len(found)
        for k, ((label, error), colour) in enumerate(zip(found, MODELS, strict=False)):
            heights = [100.0 * one.mean for one in error.levels]
            places = at + (k - 0.5 * (len(found) - 1)) * wide
            bars = panel.bar(places, heights, 0.92 * wide, color=colour, label=label)
            panel.bar_label(bars, [f"{h:.2f}" for h in heights], fontsize=8, padding=1)
        for k, one in enumerate(responses):
            noise = 100.0 * float(np.mean(one.shares()[1]))
            if np.isfinite(noise):
                panel.hlines(
                    noise, k - 0.42, k + 0.42, color=GREY, linestyle="--", linewidth=1.2,
                    label="noise" if k == 0 else "_nolegend_",
                )  # fmt: skip
        unit = found[0][1].units[0]
        names = [show(float(np.sqrt(np.mean(one.amplitude**2))), unit) for one in levels]
        panel.set_xticks(at, names)
        panel.set_xlabel("rms of a drive")
        panel.set_ylabel("error, mean of the axes [%]")
        panel.set_ylim(0.0, 1.12 * panel.get_ylim()[1])
        panel.grid(axis="x", visible=False)
        legend_below(made, panel)
        return made


def softening(model: ModalModel) -> Figure:
    """How modes and drives depend on the amplitude."""
    with styled():
        made, panels = figure(1, 4, width=11.0, height=3.3)
        factor, unit = prefixed(model.units[0], model.amplitudes)
        at = factor * model.amplitudes
        middle = len(at) // 2
        strong = np.argsort(model.strength)[::-1][: len(MODELS)]
        for m, colour in zip(np.sort(strong), MODELS, strict=False):
            ratio = model.frequencies[:, m] / model.frequencies[middle, m] - 1.0
            name = show(float(model.frequencies[middle, m]), "Hz")
            panels[0].plot(at, 100.0 * ratio, "o-", color=colour, label=name)
        panels[0].set_ylabel("frequency, change [%]")
        panels[0].legend(fontsize=7)
        for d, colour in zip(range(model.drives), MODELS, strict=False):
            gain = model.gains[:, d]
            for panel, values in (
                (panels[1], 100.0 * (np.abs(gain) - 1.0)),
                (panels[2], np.degrees(np.angle(gain))),
                (panels[3], 1e6 * model.lags[:, d]),
            ):
                panel.plot(at, values, "o-", color=colour, label=f"drive {d + 1}")
        panels[1].legend(fontsize=7)
        for panel, label in zip(
            panels[1:], ("gain, change [%]", "phase, change [°]", "lag, change [µs]"), strict=True
        ):
            panel.set_ylabel(label)
        for panel, title in zip(panels, ("Modes", "Gain", "Phase", "Lag"), strict=True):
            panel.set_title(title)
            panel.set_xlabel(labelled("rms of a drive", unit))
        return made


def _spectra(model: ModalModel, level: AxesCampaign) -> tuple[FloatArray, FloatArray]:
    """(lines, A) mean squares of error and reading of the mean period, by line."""
    found: list[list[FloatArray]] = [[], []]
    for record in level:
        for kept, signal in zip(found, residual(model, record), strict=True):
            mean = signal.mean(axis=0)
            kept.append(np.abs(np.fft.rfft(mean, axis=0) * (2.0 / len(mean))) ** 2)
    return np.asarray(np.mean(found[0], axis=0)), np.asarray(np.mean(found[1], axis=0))


def _banded(frequency: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rms of the lines in bands of equal ratio, each at its middle line."""
    edges = np.geomspace(frequency[0], frequency[-1] * (1.0 + 1e-9), _SMOOTHED + 1)
    band = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, _SMOOTHED - 1)
    count = np.bincount(band, minlength=_SMOOTHED)
    some = count > 0
    power = np.bincount(band, weights=values**2, minlength=_SMOOTHED)[some] / count[some]
    place = np.bincount(band, weights=frequency, minlength=_SMOOTHED)[some] / count[some]
    return np.asarray(place), np.sqrt(power)
