"""What no catalogue of effects has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.integrate import cumulative_trapezoid

from piezo_opt.benchmark.foreign.operators import Array
from piezo_opt.benchmark.foreign.scene import Nodes, wandering


@final
@dataclass(frozen=True)
class Sticking:
    """The reading sticks at random times for a while, and then lets go.

    Attributes:
        begins, lasts: shares of the duration.
        strength: how much of the motion is lost while it sticks, up to 1.
    """

    begins: tuple[float, ...]
    lasts: float
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """With sticks."""
        found = position.copy()
        share = nodes.time / nodes.scene.duration
        for begin in self.begins:
            inside = (share >= begin) & (share < begin + self.lasts)
            held = np.interp(begin, share, position)
            found[inside] += self.strength * (held - position[inside])
        return found


@final
@dataclass(frozen=True)
class EncoderLines:
    """A scale that is read in whole lines of pitch ``strength`` stroke."""

    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """In whole lines."""
        pitch = self.strength * nodes.scene.stroke
        return np.asarray(pitch * np.round(position / pitch))


@final
@dataclass(frozen=True)
class GainStep:
    """The gain is 1 + strength between two times, shares of the duration."""

    begin: float
    end: float
    strength: float

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:  # noqa: ARG002
        """With another gain for a while."""
        share = nodes.time / nodes.scene.duration
        inside = (share >= self.begin) & (share < self.end)
        found: Array = free * (1.0 + self.strength * inside)
        return found


@final
@dataclass(frozen=True)
class Wandering:
    """A vibration of the surroundings whose frequency and amplitude wander."""

    frequency: float
    seed: int
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """With the vibration."""
        scene = nodes.scene
        walk = wandering(self.seed, 60, nodes.time, scene.duration)
        size = 1.0 + 0.5 * np.tanh(wandering(self.seed + 1, 40, nodes.time, scene.duration))
        rate = self.frequency * (1.0 + 0.3 * np.tanh(walk))
        phase = 2.0 * np.pi * cumulative_trapezoid(rate, dx=nodes.step, initial=0)
        found: Array = position + self.strength * scene.stroke * size * np.sin(phase)
        return found


@final
@dataclass(frozen=True)
class Dropouts:
    """Pulses of the sensor at random times, of one to six samples.

    Attributes:
        at, heights: shares of the duration; of the stroke and of ``strength``.
        lasts: samples.
    """

    at: tuple[float, ...]
    heights: tuple[float, ...]
    lasts: tuple[int, ...]
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """With pulses."""
        scene = nodes.scene
        found = position.copy()
        for at, height, lasts in zip(self.at, self.heights, self.lasts, strict=True):
            begin = at * scene.duration
            inside = (nodes.time >= begin) & (nodes.time < begin + lasts / scene.rate)
            found[inside] += self.strength * scene.stroke * height
        return found
