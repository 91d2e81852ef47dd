"""Pictures of closed loops and of shapers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from piezo_opt.control.modes import Mode, vibration
from piezo_opt.pictures.picture import prefixed
from piezo_opt.report.style import (
    BLACK,
    BLUE,
    GREY,
    MODELS,
    VERMILLION,
    figure,
    labelled,
    styled,
    thinned,
)

if TYPE_CHECKING:
    from piezo_opt.control import ClosedLoop, Limits, TunedShaper


def loops(runs: Sequence[ClosedLoop], name: str, limits: Limits) -> Figure:
    """Reference and position, their difference, and the drive within its limits, of the first."""
    run = runs[0]
    with styled():
        made, (above, middle, below) = figure(rows=3, width=7.2, height=6.2, sharex=True)
        seconds, second = prefixed("s", run.time)
        metres, unit = prefixed("m", run.reference, run.position)
        time, reference = thinned(run.time, run.reference)
        above.plot(seconds * time, metres * reference, color=BLACK, label="reference")
        time, position = thinned(run.time, run.position)
        above.plot(seconds * time, metres * position, color=BLUE, linestyle="--", label="position")
        above.set_ylabel(labelled("position", unit))
        above.set_title(f"{name}: expected on the identified actuator")
        above.legend(loc="upper right")
        metres, unit = prefixed("m", run.error)
        time, error = thinned(run.time, run.error)
        middle.plot(seconds * time, metres * error, color=VERMILLION, linewidth=0.9)
        middle.set_ylabel(labelled("error", unit))
        middle.set_title(
            f"{metres * run.rms:.3g} {unit} rms, {metres * run.largest:.3g} {unit} at most"
        )
        time, drive = thinned(run.time, run.drive)
        below.plot(seconds * time, drive, color=BLUE, drawstyle="steps-post", linewidth=0.9)
        for end in (limits.low, limits.high):
            if np.isfinite(end):
                below.axhline(end, color=GREY, linestyle=":", linewidth=1.0)
        below.set_ylabel(labelled("drive", "V"))
        below.set_xlabel(labelled("time", second))
        below.set_title(f"drive, limits {limits.told()}")
    return made


def shapers(found: TunedShaper) -> Figure:
    """What each shaper leaves against the frequency, and where the actuators' frequencies lie."""
    first = found.modes[0]
    own = first.omega / (2.0 * np.pi)
    with styled():
        made, (above, below) = figure(rows=2, width=7.2, height=5.4)
        width = max(0.25, 1.2 * float(np.abs(found.frequencies / own - 1.0).max()))
        ratio = np.linspace(max(1.0 - width, 0.05), 1.0 + width, 400)
        hertz, unit = prefixed("Hz", np.array([own]))
        for row, colour in zip(found.rows, MODELS, strict=False):
            taken = row.shaper is found.shaper
            left = [
                vibration(
                    row.shaper.amplitudes, row.shaper.times,
                    [Mode(r * m.omega, m.zeta, m.share) for m in found.modes],
                )
                for r in ratio
            ]  # fmt: skip
            above.plot(
                hertz * own * ratio, 100.0 * np.array(left), color=colour,
                linewidth=2.2 if taken else 1.1,
                label=row.shaper.name + (" (taken)" if taken else ""),
            )  # fmt: skip
        low, high = hertz * np.quantile(found.frequencies, (0.025, 0.975))
        least = 0.002 * hertz * own
        above.axvspan(
            min(low, hertz * own - least), max(high, hertz * own + least), color=GREY, alpha=0.25,
            label="95 % of the actuators",
        )  # fmt: skip
        above.axhline(100.0 * found.allowed, color=BLACK, linestyle=":", linewidth=1.0)
        above.set_ylim(0.0, 30.0)
        above.set_xlabel(labelled("frequency of the mode", unit))
        above.set_ylabel("vibration left [%]")
        above.set_title("What is left of a bare step's swing")
        above.legend(loc="upper center", ncols=3)
        longest = max(row.shaper.delay for row in found.rows)
        seconds, second = prefixed("s", np.array([longest]))
        for row, colour in zip(found.rows, MODELS, strict=False):
            times = np.append(row.shaper.times, 1.25 * longest)
            below.step(
                seconds * np.insert(times, 0, -0.1 * longest),
                np.insert(np.append(np.cumsum(row.shaper.amplitudes), 1.0), 0, 0.0),
                where="post", color=colour, label=row.shaper.name,
                linewidth=2.2 if row.shaper is found.shaper else 1.1,
            )  # fmt: skip
        below.set_xlabel(labelled("time", second))
        below.set_ylabel("shaped step")
        below.set_title("A step through each of them")
        below.legend(loc="lower right")
    return made
