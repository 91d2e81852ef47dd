"""Structures beside the first mode, and sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.benchmark.foreign.linear import low_pass, passed, second_order
from piezo_opt.benchmark.foreign.operators import Array, play
from piezo_opt.benchmark.foreign.scene import Nodes, wandering


@final
@dataclass(frozen=True)
class FrameMode:
    """The frame gives way to the motion's inertia: + strength p^2 / (p^2 + 2 zeta w p + w^2) x."""

    omega: float
    zeta: float
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """With the frame's motion."""
        moved = passed(
            [1.0, 0.0, 0.0], [1.0, 2.0 * self.zeta, 1.0], position, nodes.step * self.omega
        )
        found: Array = position + self.strength * moved
        return found


@final
@dataclass(frozen=True)
class ParallelMode:
    """Another mode beside the first, driven by the same force: + strength q."""

    omega: float
    zeta: float
    strength: float

    def beside(self, free: Array, nodes: Nodes) -> Array:
        """What this mode adds to the motion of the first."""
        found: Array = self.strength * second_order(free, self.omega, self.zeta, nodes.step)
        return found


@final
@dataclass(frozen=True)
class SensorFilter:
    """A sensor of finite bandwidth: a low pass of time ``strength`` [s]."""

    damping: float | None
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """Filtered."""
        return low_pass(position, self.strength, self.damping, nodes.step)


@final
@dataclass(frozen=True)
class Backlash:
    """Play of half width ``strength`` times half the stroke between actuator and sensor."""

    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """With play."""
        width = 0.5 * nodes.scene.stroke * self.strength
        return play(position - width, position + width, float(position[0]))


@final
@dataclass(frozen=True)
class SensorPolynomial:
    """+ strength stroke (y / stroke)^order."""

    order: int
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """Bent."""
        stroke = nodes.scene.stroke
        found: Array = position + self.strength * stroke * (position / stroke) ** self.order
        return found


@final
@dataclass(frozen=True)
class PeriodicError:
    """+ strength wavelength sin(4 pi y / wavelength + phase) (Bobroff, 1987; Heydemann, 1981)."""

    wavelength: float
    phase: float
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:  # noqa: ARG002
        """With the fringes' error."""
        angle = 4.0 * np.pi * position / self.wavelength + self.phase
        found: Array = position + self.strength * self.wavelength * np.sin(angle)
        return found


@final
@dataclass(frozen=True)
class Ramp:
    """+ strength stroke t / duration."""

    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """Drifted."""
        scene = nodes.scene
        found: Array = position + self.strength * scene.stroke * nodes.time / scene.duration
        return found


@final
@dataclass(frozen=True)
class Settling:
    """+ strength stroke (1 - exp(-t / tau))."""

    tau: float
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """Drifted."""
        grown = -np.expm1(-np.maximum(nodes.time, 0.0) / self.tau)
        found: Array = position + self.strength * nodes.scene.stroke * grown
        return found


@final
@dataclass(frozen=True)
class RandomWalk:
    """+ strength stroke times a random walk of unit size over the record."""

    seed: int
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """Drifted."""
        scene = nodes.scene
        walk = wandering(self.seed, 400, nodes.time, scene.duration)
        found: Array = position + self.strength * scene.stroke * walk
        return found


@final
@dataclass(frozen=True)
class Hum:
    """+ strength stroke sum_k share_k sin(2 pi k f t + phase_k)."""

    frequency: float
    shares: tuple[float, ...]
    phases: tuple[float, ...]
    strength: float

    def on_reading(self, position: Array, nodes: Nodes) -> Array:
        """With the mains."""
        found = position.copy()
        for k, (share, phase) in enumerate(zip(self.shares, self.phases, strict=True), start=1):
            angle = 2.0 * np.pi * k * self.frequency * nodes.time + phase
            found += self.strength * nodes.scene.stroke * share * np.sin(angle)
        return found
