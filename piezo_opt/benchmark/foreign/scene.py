"""Where and when an effect acts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

import numpy as np

from piezo_opt.benchmark.foreign.mechanics import Resonance
from piezo_opt.benchmark.foreign.operators import Array


@final
@dataclass(frozen=True)
class Scene:
    """Scales of a plant and of its records.

    Attributes:
        low, high: range of the drive [V].
        stroke: free displacement over that range, about [m].
        rate: samples a second.
        duration: of a record [s].
        resonance: its mechanics; None where they are far above the sampling.
    """

    low: float
    high: float
    stroke: float
    rate: float
    duration: float
    resonance: Resonance | None

    @property
    def middle(self) -> float:
        """Of the range [V]."""
        return 0.5 * (self.low + self.high)

    @property
    def half(self) -> float:
        """Half of the range [V]."""
        return 0.5 * (self.high - self.low)

    @property
    def quick(self) -> float:
        """The shortest time that a record shows [s]: of the resonance, else of the sampling."""
        return 1.0 / self.rate if self.resonance is None else 1.0 / self.resonance.omega


@final
@dataclass(frozen=True, eq=False)
class Nodes:
    """The fine grid of one record, with what came before it.

    Attributes:
        scene: scales.
        time: of each node [s]; 0 where the record begins, negative before.
        step: between nodes [s].
        warmth: temperature over the reference at each node [K].
    """

    scene: Scene
    time: Array
    step: float
    warmth: Array


@runtime_checkable
class OnDrive(Protocol):
    """Acts on the drive."""

    def on_drive(self, drive: Array, nodes: Nodes) -> Array:
        """The drive that arrives [V]."""
        ...


@runtime_checkable
class OnStrain(Protocol):
    """Acts on the free displacement."""

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:
        """The free displacement with the effect [m]."""
        ...


@runtime_checkable
class Beside(Protocol):
    """Moves beside the first mode."""

    def beside(self, free: Array, nodes: Nodes) -> Array:
        """What it adds to the position [m]."""
        ...


@runtime_checkable
class OnReading(Protocol):
    """Acts on what is read."""

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """The reading [m]."""
        ...


def wandering(seed: int, count: int, time: Array, duration: float) -> Array:
    """A random walk of unit size over a record, the same for every grid; 0 before it."""
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(count)) / np.sqrt(count)
    knots = np.linspace(0.0, duration, count)
    found: Array = np.interp(time, knots, walk - walk[0])
    return found
