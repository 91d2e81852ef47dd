"""Measured and modelled: over time, and in the plane of drive and reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.pictures.picture import (
    MODELS,
    Axis,
    Panel,
    Picture,
    Style,
    Tone,
    Trace,
    clock,
    prefixed,
)
from piezo_opt.pictures.thinning import MOST_POINTS, envelope, outline

FloatArray = NDArray[np.float64]

FEW: Final = 300
"""Samples up to which each is marked."""


@final
@dataclass(frozen=True, eq=False)
class Seen:
    """A stretch of a record, and what models make of it.

    Attributes:
        time, drive, position: (N,) its samples [s, drive_unit, position_unit].
        counted: (N,) whether a sample counts.
        drive_unit, position_unit: of the record.
        models: (label, (N,) reading) of each model.
        explained: (label, (N,) values) of what lies over the residual of the first model.
        startup: instants between which nothing counts, or None.
    """

    time: FloatArray
    drive: FloatArray
    position: FloatArray
    counted: NDArray[np.bool_]
    drive_unit: str
    position_unit: str
    models: Sequence[tuple[str, FloatArray]] = ()
    explained: tuple[str, FloatArray] | None = None
    startup: tuple[float, float] | None = field(default=None)


def over_time(seen: Seen, title: str = "Over time", most: int = MOST_POINTS) -> Picture:
    """Measured and modelled above, what each model leaves over below; start-up shaded.

    A trace has at most ``most`` points.
    """
    readings = [seen.position, *(reading for _, reading in seen.models)]
    left = [np.where(seen.counted, seen.position - reading, np.nan) for _, reading in seen.models]
    extra = [] if seen.explained is None else [seen.explained[1]]
    time, thin = envelope(seen.time, [*readings, *left, *extra], most)
    seconds, time_unit = clock(seen.time)
    time = seconds * time
    split = len(readings)
    factor, unit = prefixed(seen.position_unit, *thin[:split])
    small, small_unit = prefixed(seen.position_unit, *thin[split:])
    labels = ["measured", *(label for label, _ in seen.models)]
    style = Style.MARKED if seen.time.size <= FEW else Style.LINE
    above = tuple(
        Trace(label, time, factor * y, tone, style if tone is Tone.INK else Style.LINE)
        for label, y, tone in zip(labels, thin[:split], (Tone.INK, *MODELS), strict=False)
    )
    names = labels[1:] if len(seen.models) > 1 else ["residual"]
    below = [
        Trace(label, time, small * y, tone)
        for label, y, tone in zip(names, thin[split : split + len(left)], MODELS, strict=False)
    ]
    if seen.explained is not None:
        below.append(Trace(seen.explained[0], time, small * thin[-1], Tone.BLUE))
    shaded = None
    if seen.startup is not None:
        begin, end = seen.startup
        shaded = (seconds * begin, seconds * end, "simulated, not counted")
    across = Axis("time", time_unit, factor=seconds)
    return Picture(
        (
            Panel(title, across, Axis("displacement", unit, factor=factor), above, shaded=shaded),
            Panel(
                "", across, Axis("measured − model", small_unit, factor=small), tuple(below),
                zero=True, shaded=shaded,
            ),
        )
    )  # fmt: skip


def loop(seen: Seen, most: int = MOST_POINTS) -> Picture:
    """Measured and modelled reading against the drive, where they count; ``most`` points each."""
    drive = seen.drive[seen.counted]
    readings = [
        one[seen.counted] for one in (seen.position, *(reading for _, reading in seen.models))
    ]
    volts, drive_unit = prefixed(seen.drive_unit, drive)
    factor, unit = prefixed(seen.position_unit, readings[0])
    # A model's loop has corners of its own; all of them together would leave fewer to each.
    kept = [outline([drive, one], most) for one in readings]
    labels = ["measured", *(label for label, _ in seen.models)]
    few = drive.size <= FEW
    traces = tuple(
        Trace(
            label, volts * drive[at], factor * one[at], tone,
            Style.MARKED if few and tone is Tone.INK else Style.LINE,
        )
        for label, one, at, tone in zip(labels, readings, kept, (Tone.INK, *MODELS), strict=False)
    )  # fmt: skip
    across, up = Axis("drive", drive_unit, factor=volts), Axis("displacement", unit, factor=factor)
    return Picture((Panel("Loop", across, up, traces),))
