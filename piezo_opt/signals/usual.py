"""The drives that are usually played: each kind shows another family of effects."""

from __future__ import annotations

from typing import Final

from piezo_opt.signals.drive import Drive
from piezo_opt.signals.families import Room
from piezo_opt.signals.limits import DriveLimits, within
from piezo_opt.signals.loops import decaying_triangles, square, staircase
from piezo_opt.signals.tones import Lines, Phases, chirp, multisine, sine

_LEVELS: Final = (0.0, 0.5, 1.0, 0.25, 0.75, 0.0, 1.0, 0.0)
"""Of the staircase, as shares of the range: steps of all sizes, up and down."""


def usual(room: Room, resonance: float | None = None) -> tuple[Drive, ...]:
    """Drives by rule within a range, time and slew rate.

    Slow and fast, large and small, smooth, with corners, with jumps, with rests. Fast ones take
    half of the range, in its middle.

    Args:
        room: what a drive may use.
        resonance: [Hz], where one is known: fast sines stay below it, chirps pass it.
    """
    low, high, rate, unit = room.low, room.high, room.rate, room.unit
    lasting = room.time.size / rate
    middle, quarter = 0.5 * (low + high), 0.25 * (high - low)
    half = middle - quarter, middle + quarter
    slow, top, fast = 4.0 / lasting, min(room.highest, rate / 6.0), rate / 25.0
    if resonance is not None and resonance < 0.5 * rate:
        top = min(top, max(3.0 * resonance, 10.0 * slow))
        fast = min(fast, resonance / 3.0)
    rest = max(0.1, 2.0 / room.time.size)
    # Four passes and holds that fill half of the time each.
    loops, hold = 3.75 / lasting, lasting / 8.0
    levels = [low + (high - low) * level for level in _LEVELS]
    made = [
        sine(low, high, slow, lasting, rate=rate, unit=unit),
        sine(*half, slow, lasting, rate=rate, unit=unit),
        decaying_triangles(low, high, loops, rate=rate, count=2, hold=hold, unit=unit),
        square(low, high, 1.0 / lasting, rate=rate, duty=1.0 - rest, unit=unit),
        staircase(levels, lasting / len(levels), rate=rate, unit=unit),
    ]
    if fast > 4.0 * slow:
        made.append(sine(*half, fast, lasting, rate=rate, unit=unit))
    if top > 4.0 * slow:
        made.append(chirp(*half, 0.5 * slow, top, lasting, rate=rate, unit=unit))
        made.append(
            multisine(
                low, high, 1.0 / lasting, top, lasting, rate=rate, lines=Lines.LOGARITHMIC,
                phases=Phases.SCHROEDER, unit=unit,
            )
        )  # fmt: skip
    return tuple(within(drive, DriveLimits(slew=room.slew)) for drive in made)
