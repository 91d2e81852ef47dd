"""Hidden happenings that no catalogue row describes."""

# Every effect has the same signatures, whether it reads the whole scene or not.
# ruff: noqa: ARG002

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, final

import numpy as np

from piezo_opt.benchmark.plants.hidden import Force, Grip, Hidden, Scene
from piezo_opt.benchmark.plants.physics import Array


def _telegraph(random: np.random.Generator, time: Array, switches: int) -> Array:
    """A signal that jumps between random levels in -1..1 at random instants."""
    instants = np.sort(random.uniform(time[0], time[-1], switches))
    levels = random.uniform(0.4, 1.0, switches + 1) * np.where(
        np.arange(switches + 1) % 2 == 0, 1.0, -1.0
    )
    return levels[np.searchsorted(instants, time)]


@final
@dataclass(frozen=True, kw_only=True)
class GainSwitching(Hidden):
    """The gain jumps at random instants. Intensity: size of the jumps over the gain."""

    name: ClassVar[str] = "gain_switching"
    plausible: ClassVar[tuple[float, float]] = (2e-3, 0.05)
    switches: int

    def strain(self, scene: Scene, ends: Array, free: Array) -> Array:
        """The free displacement's share that comes and goes."""
        random = np.random.default_rng([scene.seed, 1])
        level = _telegraph(random, scene.grid.time[:-1], self.switches)
        return self.intensity * level * free


@final
@dataclass(frozen=True, kw_only=True)
class UnrecordedInput(Hidden):
    """A second drive that nobody recorded: a telegraph signal or a slow sine of wandering phase.

    Intensity: its displacement over the stroke.
    """

    name: ClassVar[str] = "unrecorded_input"
    plausible: ClassVar[tuple[float, float]] = (5e-4, 0.1)
    signal: Literal["telegraph", "sine"]
    events: int

    @property
    def form(self) -> str:
        """Telegraph or sine."""
        return self.signal

    def strain(self, scene: Scene, ends: Array, free: Array) -> Array:
        """The displacement of the second drive, through the same mechanics."""
        random = np.random.default_rng([scene.seed, 2])
        time = scene.grid.time[:-1]
        if self.signal == "telegraph":
            level = _telegraph(random, time, self.events)
        else:
            knots = np.cumsum(random.standard_normal(self.events)) / np.sqrt(self.events)
            wander = np.interp(time, np.linspace(time[0], time[-1], self.events), knots)
            turns = self.events / 2.0 * (time - time[0]) / (time[-1] - time[0])
            level = np.sin(2.0 * np.pi * (turns + wander) + random.uniform(0.0, 2.0 * np.pi))
        return np.broadcast_to(self.intensity * self.scale.stroke * level, free.shape)


@final
class _Grip:
    """Holds from given instants on, until the spring pulls hard enough."""

    def __init__(self, instants: Array, level: float) -> None:
        self._instants, self._level = instants.tolist(), level
        self._holding = False

    def holds(self, free: float, position: float, time: float) -> bool:
        """Sticks at the next instant, breaks away at the level."""
        if self._holding:
            self._holding = abs(free - position) < self._level
        elif self._instants and time >= self._instants[0]:
            self._instants.pop(0)
            self._holding = True
        return self._holding


@final
@dataclass(frozen=True, kw_only=True)
class StickEvents(Hidden):
    """The stage sticks now and then. Intensity: break-away force over that of the full stroke."""

    name: ClassVar[str] = "stick_events"
    plausible: ClassVar[tuple[float, float]] = (3e-3, 0.3)
    events: int

    def grip(self, scene: Scene) -> Grip:
        """The events of this record."""
        random = np.random.default_rng([scene.seed, 3])
        time = scene.grid.time
        instants = np.sort(random.uniform(time[0], time[-1], self.events))
        return _Grip(instants, self.intensity * self.scale.stroke)


@final
class _Burden:
    """From an instant on: more mass, and a spring beside it."""

    def __init__(self, instant: float, mass: float, spring: float, damping: float) -> None:
        self._instant, self._mass, self._spring = instant, mass, spring
        self._damping = damping

    def at(self, position: float, velocity: float, free: float, time: float) -> float:
        """x'' (1 + m) = omega^2 (s - (1 + k) x) - 2 zeta omega x', as what it takes away."""
        if time < self._instant:
            return 0.0
        pull = free - (1.0 + self._spring) * position - self._damping * velocity
        return self._mass / (1.0 + self._mass) * pull + self._spring * position

    def keep(self) -> None:
        """A load has no memory."""


@final
@dataclass(frozen=True, kw_only=True)
class LoadChange(Hidden):
    """A load laid on in the middle of a record. Intensity: its mass over the stage's."""

    name: ClassVar[str] = "load_change"
    plausible: ClassVar[tuple[float, float]] = (5e-3, 0.5)
    spring: float
    """Its stiffness over the stage's, over its mass over the stage's."""

    def force(self, scene: Scene) -> Force:
        """The load of this record."""
        random = np.random.default_rng([scene.seed, 4])
        instant = random.uniform(0.3, 0.7) * self.scale.duration
        mass = 0.0 if self.scale.static else self.intensity
        return _Burden(
            instant, mass, self.spring * self.intensity, 2.0 * self.scale.zeta / self.scale.omega
        )
