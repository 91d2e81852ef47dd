"""Amplifiers, cables and converters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.benchmark.foreign.linear import low_pass
from piezo_opt.benchmark.foreign.operators import Array, play
from piezo_opt.benchmark.foreign.scene import Nodes


@final
@dataclass(frozen=True)
class LowPass:
    """An amplifier of finite bandwidth: a low pass of time ``strength`` [s]."""

    damping: float | None
    strength: float

    def on_drive(self, drive: Array, nodes: Nodes) -> Array:
        """Filtered."""
        return low_pass(drive, self.strength, self.damping, nodes.step)


@final
@dataclass(frozen=True)
class DeadTime:
    """v(t - T); ``strength`` is T [s], any fraction of a sample."""

    strength: float

    def on_drive(self, drive: Array, nodes: Nodes) -> Array:
        """Later."""
        return np.interp(nodes.time - self.strength, nodes.time, drive)


@final
@dataclass(frozen=True)
class SlewRate:
    """|v'| <= peak / (1 + strength) on the way up, ``down`` times as fast on the way down.

    Attributes:
        peak: rate of the drive that is limited at all [V/s].
    """

    peak: float
    down: float
    strength: float

    def on_drive(self, drive: Array, nodes: Nodes) -> Array:
        """Limited."""
        up = self.peak / (1.0 + self.strength) * nodes.step
        down = self.down * up
        now = float(drive[0])
        found = []
        for value in drive.tolist():
            now = min(max(value, now - down), now + up)
            found.append(now)
        return np.array(found)


@final
@dataclass(frozen=True)
class Clipping:
    """Hard limits ``strength`` of the range inside its ends, or the upper one only."""

    both: bool
    strength: float

    def on_drive(self, drive: Array, nodes: Nodes) -> Array:
        """Clipped."""
        scene = nodes.scene
        inside = 2.0 * scene.half * self.strength
        low = scene.low + inside if self.both else -np.inf
        return np.clip(drive, low, scene.high - inside)


@final
@dataclass(frozen=True)
class Compression:
    """middle + A tanh((v - middle) / A), A = half the range / strength."""

    strength: float

    def on_drive(self, drive: Array, nodes: Nodes) -> Array:
        """Compressed."""
        scene = nodes.scene
        scale = scene.half / self.strength
        found: Array = scene.middle + scale * np.tanh((drive - scene.middle) / scale)
        return found


@final
@dataclass(frozen=True)
class DeadBand:
    """No answer within ``strength`` of the range about a rest voltage [V]."""

    rest: float
    strength: float

    def on_drive(self, drive: Array, nodes: Nodes) -> Array:
        """With the band cut out."""
        width = nodes.scene.half * self.strength
        around = drive - self.rest
        found: Array = drive - np.clip(around, -width, width)
        return found


@final
@dataclass(frozen=True)
class LostMotion:
    """Play of half width ``strength`` times half the range."""

    strength: float

    def on_drive(self, drive: Array, nodes: Nodes) -> Array:
        """With play."""
        width = nodes.scene.half * self.strength
        return play(drive - width, drive + width, float(drive[0]))
