"""The ceramic: what its free displacement has beside a loop of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.benchmark.foreign.linear import first_order, superposed
from piezo_opt.benchmark.foreign.operators import Array, play
from piezo_opt.benchmark.foreign.scene import Nodes


@final
@dataclass(frozen=True)
class Curved:
    """+ strength stroke u^order, u = v / span: electrostriction at order 2."""

    order: int
    strength: float

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:
        """With the power added."""
        scene = nodes.scene
        found: Array = (
            free + self.strength * scene.stroke * (0.5 * drive / scene.half) ** self.order
        )
        return found


@final
@dataclass(frozen=True)
class LogarithmicCreep:
    """+ strength int lg(1 + (t - t') / begin) ds(t') (Jung and Gweon, 2000)."""

    begin: float
    strength: float

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:  # noqa: ARG002
        """Crept."""
        time = nodes.step * np.arange(free.size)
        late = time + self.begin
        answer = (late * np.log1p(time / self.begin) - time) / np.log(10.0)
        return free + self.strength * superposed(free, answer, nodes.step)


@final
@dataclass(frozen=True)
class PowerCreep:
    """+ strength int ((t - t') / unit)^power ds(t'): Andrade's law at 1/3, or another power."""

    unit: float
    power: float
    strength: float

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:  # noqa: ARG002
        """Crept."""
        late = np.arange(free.size) * (nodes.step / self.unit)
        answer: Array = np.power(late, self.power + 1.0) * (self.unit / (self.power + 1.0))
        return free + self.strength * superposed(free, answer, nodes.step)


@final
@dataclass(frozen=True)
class DelayedElasticity:
    """One Kelvin-Voigt element: + strength s through a low pass, from rest."""

    tau: float
    strength: float

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:  # noqa: ARG002
        """Crept."""
        late = first_order(free - free[0], self.tau, nodes.step)
        found: Array = free + self.strength * late
        return found


@final
@dataclass(frozen=True)
class GainWarms:
    """s (1 + strength dT)."""

    strength: float

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:  # noqa: ARG002
        """Warmed."""
        found: Array = free * (1.0 + self.strength * nodes.warmth)
        return found


@final
@dataclass(frozen=True)
class StackExpands:
    """+ strength stroke dT."""

    strength: float

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:  # noqa: ARG002
        """Warmed."""
        found: Array = free + self.strength * nodes.scene.stroke * nodes.warmth
        return found


@final
@dataclass(frozen=True)
class UnequalPlay:
    """Generalised plays whose envelopes spread upwards (Al Janaideh, Rakheja and Su, 2011).

    Of the drive u, scaled to -1..1 over the range, the envelopes are u - r (1 + strength u) and
    u + r (1 + strength u), or bent on the falling branch only; what they change is added.

    Attributes:
        thresholds, weight: of the plays, and what each is worth of the stroke.
        falling: whether only the falling branch is bent.
    """

    thresholds: tuple[float, ...]
    weight: float
    falling: bool
    strength: float

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:
        """With the unequal loop."""
        scene = nodes.scene
        u = (drive - scene.middle) / scene.half
        found = free.copy()
        for r in self.thresholds:
            bent = r * (1.0 + self.strength * u)
            unequal = play(u - (r if self.falling else bent), u + bent)
            found += 0.5 * scene.stroke * self.weight * (unequal - play(u - r, u + r))
        return found


@final
@dataclass(frozen=True)
class RatePlay:
    """Plays whose thresholds grow with the rate (Al Janaideh and Krejci, 2013).

        r(q) = r (1 + strength lg(1 + q)), or r (1 + strength q^power),      q = |v'| / usual

    Attributes:
        thresholds, weight: as for UnequalPlay.
        usual: rate of the drive [V/s].
        power: None for the logarithm.
    """

    thresholds: tuple[float, ...]
    weight: float
    usual: float
    power: float | None
    strength: float

    def on_strain(self, drive: Array, free: Array, nodes: Nodes) -> Array:
        """With the wider loop."""
        scene = nodes.scene
        u = (drive - scene.middle) / scene.half
        slope = np.abs(np.diff(drive, append=drive[-1])) / nodes.step / self.usual
        # A threshold cannot jump with the slope: the domain walls need some time.
        q = np.maximum(first_order(slope, 2.0 / scene.rate, nodes.step), 0.0)
        grown = np.log10(1.0 + q) if self.power is None else q**self.power
        found = free.copy()
        for r in self.thresholds:
            wide = r * (1.0 + self.strength * grown)
            found += (
                0.5 * scene.stroke * self.weight * (play(u - wide, u + wide) - play(u - r, u + r))
            )
        return found
