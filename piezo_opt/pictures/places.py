"""Where the residual lives: by branch, frequency, amplitude, after events, over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.pictures.picture import MODELS, Axis, Panel, Picture, Style, Tone, Trace, prefixed
from piezo_opt.pictures.thinning import MOST_POINTS, outline

if TYPE_CHECKING:  # records are shown before the solvers are loaded
    from piezo_opt.comparison import Misfit, Where

FloatArray = NDArray[np.float64]

Judged = tuple[str, "Misfit", "Where"]
"""A model on a record: its label, what it leaves over, and where that lives."""

BANDS: Final = 600
"""Bands of a spectrum: a picture has not many more dots across."""


def branch(models: Sequence[Judged]) -> Picture:
    """Error against the drive: rising branch on the left, falling branch on the right."""
    record = models[0][1].record
    factor, unit = prefixed(record.position_unit, *(misfit.error for _, misfit, _ in models))
    volts, drive_unit = prefixed(record.drive_unit, models[0][1].drive)
    panels = []
    for sign, name in ((1.0, "Loading (drive rises)"), (-1.0, "Unloading (drive falls)")):
        traces = []
        for (label, misfit, where), tone in zip(models, MODELS, strict=False):
            drive, error = misfit.drive[misfit.branch == sign], misfit.error[misfit.branch == sign]
            found = where.by_branch
            mean = found.loading_mean if sign > 0 else found.unloading_mean
            if drive.size:
                at = outline([drive, error], MOST_POINTS)
                traces.append(Trace("", volts * drive[at], factor * error[at], tone, Style.CLOUD))
            called = f"mean, {label}" if len(models) > 1 else "mean in each bin"
            middles = 0.5 * (found.edges[1:] + found.edges[:-1])
            traces.append(Trace(called, volts * middles, factor * mean, tone, Style.MARKED))
        across = Axis("drive", drive_unit, factor=volts)
        up = Axis("measured − model", unit, factor=factor)
        panels.append(Panel(name, across, up, tuple(traces), zero=True))
    return Picture(tuple(panels), beside=True)


def frequency(models: Sequence[Judged]) -> Picture | None:
    """Amplitude spectra of reading and error, and how much of the error follows the drive.

    None for a record without even sampling, or too short for an averaged spectrum.
    """
    views = [where.by_frequency for _, _, where in models]
    if not np.isfinite(views[0].band):
        return None
    x, densities = banded(views[0].frequency, [views[0].reading, *(one.error for one in views)])
    reading, *errors = (np.sqrt(one) for one in densities)
    # Between the largest of both: four decades apart, one of them would need powers of ten.
    largest = float(reading.max()), max(float(one.max()) for one in errors)
    factor, unit = prefixed(
        models[0][1].record.position_unit, np.sqrt(np.array([largest[0] * largest[1]]))
    )
    several = len(models) > 1
    kept = outline([np.nan_to_num(one.coherence) for one in views])
    lines = views[0].frequency[kept]
    across = Axis("frequency", "Hz", logarithmic=True)
    return Picture(
        (
            Panel(
                "By frequency", across,
                Axis("density", f"{unit}/√Hz", logarithmic=True, factor=factor),
                (
                    Trace("reading", x, factor * reading, Tone.INK),
                    *(
                        Trace(f"error, {label}" if several else "error", x, factor * one, tone)
                        for (label, _, _), one, tone in zip(models, errors, MODELS, strict=False)
                    ),
                ),
            ),
            Panel(
                "", across, Axis("coherence of error and drive", "1"),
                tuple(
                    Trace("", lines, one.coherence[kept], tone)
                    for one, tone in zip(views, MODELS, strict=False)
                ),
                limits=(0.0, 1.05), level=(views[0].band, "99.9 % of noise stays below"),
            ),
        )
    )  # fmt: skip


def events(models: Sequence[Judged]) -> Picture | None:
    """Mean error after a step or reversal against the logarithm of time; None without enough."""
    views = [where.after_events for _, _, where in models]
    if not views[0].events or views[0].since.size < 4:
        return None
    factor, unit = prefixed(models[0][1].record.position_unit, *(one.mean for one in views))
    traces = []
    for (label, _, _), view, tone in zip(models, views, MODELS, strict=False):
        mean, half = factor * view.mean, factor * 2.0 * view.uncertainty
        called = label if len(models) > 1 else "mean ± 2 standard errors"
        traces += [
            Trace("", view.since, mean - half, tone, Style.BAND, mean + half),
            Trace(called, view.since, mean, tone, Style.MARKED),
        ]
    kind, count = views[0].kind, views[0].events
    return Picture(
        (
            Panel(
                f"After {'steps' if kind == 'step' else 'reversals'} ({count} averaged)",
                Axis(f"time since the drive's last {kind}", "s", logarithmic=True),
                Axis("ahead of the model", unit, factor=factor),
                tuple(traces), zero=True,
            ),
        )
    )  # fmt: skip


def amplitude(models: Sequence[Judged]) -> Picture | None:
    """Rms error against the swing of the drive; None for a record of one amplitude."""
    views = [where.by_amplitude for _, _, where in models]
    if views[0].swing.size < 2:
        return None
    record = models[0][1].record
    factor, unit = prefixed(record.position_unit, *(one.rms for one in views))
    volts, drive_unit = prefixed(record.drive_unit, models[0][1].drive)
    traces = tuple(
        Trace(
            label if len(models) > 1 else "", volts * one.swing, factor * one.rms, tone,
            Style.MARKED,
        )
        for (label, _, _), one, tone in zip(models, views, MODELS, strict=False)
    )  # fmt: skip
    across = Axis("swing of the drive between two turns", drive_unit, factor=volts)
    up = Axis("rms error", unit, factor=factor)
    return Picture((Panel("By amplitude", across, up, traces, limits=(0.0, np.nan)),))


def stretches(models: Sequence[Judged]) -> Picture:
    """Rms error of each stretch of the record."""
    views = [where.over_time for _, _, where in models]
    factor, unit = prefixed(models[0][1].record.position_unit, *(one.rms for one in views))
    traces = tuple(
        Trace(
            label if len(models) > 1 else "", 0.5 * (one.edges[1:] + one.edges[:-1]),
            factor * one.rms, tone, Style.MARKED,
        )
        for (label, _, _), one, tone in zip(models, views, MODELS, strict=False)
    )  # fmt: skip
    up = Axis("rms error", unit, factor=factor)
    return Picture((Panel("By stretch", Axis("time", "s"), up, traces, limits=(0.0, np.nan)),))


VIEWS: Final[dict[str, Callable[[Sequence[Judged]], Picture | None]]] = {
    "branch": branch,
    "frequency": frequency,
    "amplitude": amplitude,
    "events": events,
    "time": stretches,
}
"""The views in which a residual can be looked at, by name."""


def pictures(models: Sequence[Judged]) -> dict[str, Picture]:
    """Every view for which the record has data, by name."""
    made = {name: view(models) for name, view in VIEWS.items()}
    return {name: one for name, one in made.items() if one is not None}


def picture(made: dict[str, Picture], name: str) -> Picture:
    """One of the pictures.

    Raises:
        InputError: there is none of that name.
    """
    if name not in made:
        raise InputError(f"This record has no picture by {name!r}: there is {', '.join(made)}.")
    return made[name]


def banded(
    x: FloatArray, densities: Sequence[FloatArray], most: int = BANDS
) -> tuple[FloatArray, list[FloatArray]]:
    """Power densities averaged over bands of equal width on a logarithmic axis.

    The mean of a band is what all of its lines carry together; no line gets lost.
    """
    if x.size <= most:
        return x, list(densities)
    edges = np.geomspace(x[0], x[-1], most + 1)
    which = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, most - 1)
    count = np.bincount(which, minlength=most)
    held = count > 0
    return (
        np.bincount(which, x, minlength=most)[held] / count[held],
        [np.bincount(which, one, minlength=most)[held] / count[held] for one in densities],
    )
