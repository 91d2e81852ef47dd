"""Pictures of drives: what is played, and which frequencies it holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from piezo_opt.pictures.picture import prefixed
from piezo_opt.report.style import (
    BLUE,
    VERMILLION,
    figure,
    labelled,
    plain_log_ticks,
    styled,
    thinned,
)

if TYPE_CHECKING:
    from piezo_opt.signals import Drive


def preview(drive: Drive) -> Figure:
    """The drive over time, and the amplitudes of its spectrum."""
    with styled():
        made, (above, below) = figure(rows=2, width=7.2, height=4.6)
        seconds, second = prefixed("s", drive.time)
        volts, unit = prefixed(drive.unit, drive.values)
        time, values = thinned(drive.time, drive.values)
        style = "steps-post" if drive.steps else "default"
        above.plot(seconds * time, volts * values, color=BLUE, drawstyle=style)
        above.set_xlabel(labelled("time", second))
        above.set_ylabel(labelled("drive", unit))
        above.set_title(drive.name.replace("_", " "))
        size = drive.values.size
        repeats = 1
        if drive.period is not None:
            repeats = max(1, round(drive.duration / drive.period))
        hertz = np.fft.rfftfreq(size, 1.0 / drive.rate)[repeats::repeats]
        swing = drive.values - drive.values.mean()
        amplitude = 2.0 * np.abs(np.fft.rfft(swing))[repeats::repeats] / size
        lines = bool(drive.excited)
        floor = 1e-5 * float(amplitude.max() or 1.0)
        scale, shown = prefixed("Hz", np.array([hertz[-1] * 0.5]))
        if lines:
            hertz, amplitude = hertz[amplitude > floor], amplitude[amplitude > floor]
        below.loglog(
            scale * hertz,
            np.maximum(volts * amplitude, volts * floor),
            "." if lines else "-",
            color=BLUE,
            markersize=3.5,
            linewidth=0.9,
            label="lines" if lines else None,
        )
        if drive.silent:
            below.plot(
                scale * np.array(drive.silent),
                np.full(len(drive.silent), volts * floor),
                "|", color=VERMILLION, markersize=7.0, label="left out on purpose",
            )  # fmt: skip
            below.legend(loc="center left")
        below.set_xlabel(labelled("frequency", shown))
        below.set_ylabel(labelled("amplitude", unit))
        plain_log_ticks(below.xaxis)
        plain_log_ticks(below.yaxis)
    return made
