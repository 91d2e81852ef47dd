"""Families of drives with free corners, holds, frequencies, amplitudes and phases.

A member is a point of the unit cube, so that one search serves all of them. Every member keeps the
range and the slew rate by construction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.signals.drive import check_range, sampled
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

CORNERS: Final = 10
"""Corners of a member: two triangles with a minor loop each and a hold, with some to spare."""
TONES: Final = 8
"""Sines of a member: two a decade over four decades."""


@final
@dataclass(frozen=True)
class Room:
    """What a drive may use.

    Args:
        low, high: [unit].
        duration: [s].
        rate: samples a second [Hz].
        slew: fastest change [unit/s].
        highest: fastest sine [Hz]; a fifth of the rate unless given, where a held or a straight
            drive still looks like a sine.
        unit: SI unit of the drive.

    Raises:
        InputError: the range is empty, or a time, rate or frequency is not positive.
    """

    low: float
    high: float
    duration: float
    rate: float
    slew: float = np.inf
    highest: float = 0.0
    unit: str = "V"

    def __post_init__(self) -> None:
        check_range(self.low, self.high, "the drive's range")
        if sampled(self.duration, self.rate, "the drive").size < 8:
            raise InputError(f"{self.duration:g} s at {self.rate:g} Hz are fewer than 8 samples")
        if not self.slew > 0.0:
            raise InputError(f"slew is {self.slew:g} a second; give a positive one")
        if self.highest == 0.0:
            object.__setattr__(self, "highest", self.rate / 5.0)
        if not 2.0 / self.duration < self.highest <= 0.5 * self.rate:
            raise InputError(
                f"highest is {self.highest:g} Hz: give more than two periods in "
                f"{self.duration:g} s, and at most half of {self.rate:g} Hz"
            )

    @property
    def time(self) -> FloatArray:
        """(N,) [s]."""
        return sampled(self.duration, self.rate, "the drive")

    def scaled(self, wave: FloatArray) -> FloatArray:
        """A wave of 0..1 in the range, smaller towards its first value where it is too fast."""
        values = self.low + (self.high - self.low) * wave
        fastest = float(np.abs(np.diff(values)).max(initial=0.0)) * self.rate
        share = min(1.0, self.slew / fastest) if fastest > 0.0 else 1.0
        return np.asarray(values[0] + share * (values - values[0]))


class Family(Protocol):
    """Drives that a point of the unit cube describes."""

    @property
    def name(self) -> str:
        """Of the family."""
        ...

    @property
    def starts(self) -> tuple[FloatArray, ...]:
        """Members to begin a search with."""
        ...

    def wave(self, x: FloatArray, room: Room) -> FloatArray:
        """The member at x (size,), as (N,) values of 0..1 that keep the slew rate."""
        ...

    def said(self, x: FloatArray, room: Room) -> str:
        """The member in words."""
        ...


@final
@dataclass(frozen=True)
class Corners:
    """Straight lines between free levels, each reached in a free time and held for a free time.

    Triangles, minor loops, staircases and steps are members. Of x the first third are levels, the
    second the shares of time for the way, the last those for the hold (squared, so that none is
    near): what the slew rate needs is given first, the rest shared out.
    """

    count: int = CORNERS

    @property
    def name(self) -> str:
        """Of the family."""
        return "corners"

    @property
    def starts(self) -> tuple[FloatArray, ...]:
        """Triangles with minor loops, and a staircase of jumps."""
        n = self.count
        loops = np.resize([1.0, 0.4, 0.7, 0.0, 0.6, 0.2, 0.4, 0.0], n)
        levels = np.resize([1.0, 0.3, 0.8, 0.1, 0.6, 0.0], n)
        half, none, some = np.full(n, 0.5), np.full(n, 0.02), np.full(n, 0.15)
        return (
            np.concatenate([loops, half, some]),
            np.concatenate([levels, none, half]),
        )

    def wave(self, x: FloatArray, room: Room) -> FloatArray:
        """(N,) of 0..1."""
        at, level = self._corners(x, room)
        return np.interp(room.time, at, level)

    def said(self, x: FloatArray, room: Room) -> str:
        """The member in words."""
        _, level = self._corners(x, room)
        volts = room.low + (room.high - room.low) * level[1::2]
        shown = ", ".join(f"{v:.3g}" for v in volts)
        return f"ramps and holds to {shown} {room.unit}"

    def _corners(self, x: FloatArray, room: Room) -> tuple[FloatArray, FloatArray]:
        levels, ways, holds = x[: self.count], x[self.count : -self.count], x[-self.count :]
        moves = np.abs(np.diff(levels, prepend=0.0))
        # One sample at least: a jump goes from one sample to the next.
        least = np.maximum(1.0 / room.rate, moves * (room.high - room.low) / room.slew)
        if least.sum() > 0.9 * room.duration:
            share = 0.9 * room.duration / float(least.sum())
            levels, least = share * levels, share * least
        weight = np.concatenate([ways**2, holds**2])
        total = float(weight.sum())
        weight = weight / total if total > 0.0 else np.full(weight.size, 1.0 / weight.size)
        spare = (room.duration - float(least.sum())) * weight
        lengths = np.column_stack([least + spare[: self.count], spare[self.count :]]).ravel()
        at = np.concatenate([[0.0], np.cumsum(lengths)])
        return at, np.concatenate([[0.0], np.repeat(levels, 2)])


@final
@dataclass(frozen=True)
class Tones:
    """A sum of sines of free frequencies, amplitudes and phases, of a free size around a free mean.

    Of x the first third are the logarithms of frequencies between 1 / duration and the highest, the
    second amplitudes, the last phases; then size and mean.
    """

    count: int = TONES

    @property
    def name(self) -> str:
        """Of the family."""
        return "tones"

    @property
    def starts(self) -> tuple[FloatArray, ...]:
        """Equal sines an octave or more apart, with Schroeder's phases; and one strong slow one."""
        k = np.arange(self.count)
        phases = np.mod(-0.5 * k * (k + 1) / self.count, 1.0)
        spread = (k + 0.5) / self.count
        slow = np.concatenate([[1.0], np.full(self.count - 1, 0.3)])
        end = [1.0, 0.5]
        return (
            np.concatenate([spread, np.full(self.count, 0.6), phases, end]),
            np.concatenate([spread, slow, phases, end]),
        )

    def wave(self, x: FloatArray, room: Room) -> FloatArray:
        """(N,) of 0..1."""
        frequencies, amplitudes, phases = self._lines(x, room)
        sum_ = np.zeros(room.time.size)
        for f, a, p in zip(frequencies, amplitudes, phases, strict=True):
            sum_ += a * np.cos(2.0 * np.pi * (f * room.time + p))
        low, high = float(sum_.min()), float(sum_.max())
        if high <= low:
            return np.full(room.time.size, 0.5)
        size, mean = float(x[-2]), float(x[-1])
        return np.asarray(mean * (1.0 - size) + size * (sum_ - low) / (high - low))

    def said(self, x: FloatArray, room: Room) -> str:
        """The member in words."""
        frequencies, amplitudes, _ = self._lines(x, room)
        strong = amplitudes > 0.1 * amplitudes.max(initial=0.0)
        shown = ", ".join(f"{f:.3g}" for f in np.sort(frequencies[strong]))
        return f"sines of {shown} Hz"

    def _lines(self, x: FloatArray, room: Room) -> tuple[FloatArray, FloatArray, FloatArray]:
        n = self.count
        lowest = 1.0 / room.duration
        frequencies = lowest * (room.highest / lowest) ** x[:n]
        return np.asarray(frequencies), x[n : 2 * n], x[2 * n : 3 * n]


@final
@dataclass(frozen=True)
class Mixed:
    """Corners with sines on them: the share of the range that the sines take is free."""

    corners: Corners = Corners(6)
    tones: Tones = Tones(4)

    @property
    def name(self) -> str:
        """Of the family."""
        return "corners with tones"

    @property
    def starts(self) -> tuple[FloatArray, ...]:
        """Loops with a fifth of the range in sines."""
        return tuple(
            np.concatenate([[0.2], one, self.tones.starts[0]]) for one in self.corners.starts
        )

    def wave(self, x: FloatArray, room: Room) -> FloatArray:
        """(N,) of 0..1."""
        share, split = float(x[0]), 1 + 3 * self.corners.count
        slow = self.corners.wave(x[1:split], room)
        return np.asarray((1.0 - share) * slow + share * self.tones.wave(x[split:], room))

    def said(self, x: FloatArray, room: Room) -> str:
        """The member in words."""
        split = 1 + 3 * self.corners.count
        return (
            f"{self.corners.said(x[1:split], room)}, with {self.tones.said(x[split:], room)} in "
            f"{show(float(x[0]) * (room.high - room.low), room.unit)} of it"
        )


FAMILIES: Final[tuple[Family, ...]] = (Corners(), Tones(), Mixed())
"""Those that are searched unless told otherwise."""
