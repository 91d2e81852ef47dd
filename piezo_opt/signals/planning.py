"""What a search for a drive takes from a fit where nothing else is said."""

from __future__ import annotations

from typing import Final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.signals.answer import Answer
from piezo_opt.signals.drive import Drive, FloatArray
from piezo_opt.signals.families import Room
from piezo_opt.signals.loops import triangle

_LONGEST: Final = 20_000
"""Samples of a drive beyond which a search would take minutes; the record's length is cut there."""


def room_of(
    fit: Fit, *, duration: float | None, slew: float, highest: float, low: float | None,
    high: float | None, rate: float | None,
) -> Room:  # fmt: skip
    """Range, rate and length of the fit's first record, where nothing else is given."""
    record = fit.records[0]
    hertz = record.rate if rate is None else rate
    lasting = record.duration + record.step if duration is None else duration
    return Room(
        low=float(record.drive.min()) if low is None else low,
        high=float(record.drive.max()) if high is None else high,
        duration=min(lasting, _LONGEST / hertz),
        rate=hertz,
        slew=slew,
        highest=highest,
        unit=record.drive_unit,
    )


def resonance_of(fit: Fit) -> float | None:
    """Lowest natural frequency of the model [Hz]."""
    found = [
        fit.values[f"{name}.{own}"] / (2.0 * np.pi)
        for name, effect in fit.model
        for own, p in effect.parameters.items()
        if effect.structural and p.unit == "rad/s" and f"{name}.{own}" in fit.values
    ]
    return min(found, default=None)


def noise_of(fit: Fit, noise: float | None) -> float:
    """The noise given, or the fit's residual [m].

    Raises:
        InputError: it is not positive.
    """
    found = fit.rms if noise is None else noise
    if not 0.0 < found < np.inf:
        raise InputError(f"noise is {found:g} m; give a positive length in metres")
    return found


def slow_triangle(room: Room) -> Drive:
    """Once up and down within the room."""
    made = triangle(room.low, room.high, 1.0 / room.duration, rate=room.rate, unit=room.unit)
    count = room.time.size
    return Drive(made.name, made.description, made.values[:count], room.rate, room.unit)


def stroke_of(
    answer: Answer, slow: FloatArray, stroke: tuple[float, float] | None
) -> tuple[float, float]:
    """Positions allowed [m]: those given, else by a slow drive (N,) over the whole range.

    Raises:
        InputError: the range given is empty.
    """
    if stroke is None:
        reading = answer.reading(slow)
        span = float(np.ptp(reading))
        return float(reading.min()) - span, float(reading.max()) + span
    if not stroke[0] < stroke[1]:
        raise InputError(f"stroke {stroke[0]:g}..{stroke[1]:g} m is empty: give low below high")
    return stroke


def excess(reading: FloatArray, allowed: tuple[float, float]) -> float:
    """How far a reading (N,) leaves the positions allowed, as a share of their range."""
    low, high = allowed
    beyond = max(0.0, low - float(reading.min()), float(reading.max()) - high)
    return beyond / (high - low)
