"""What a hidden effect may do to the base plant, and the scene it acts in."""

# Every effect has the same signatures, whether it reads the whole scene or not.
# ruff: noqa: ARG002

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, Self, final

import numpy as np

from piezo_opt.benchmark.plants.physics import Array, Base, Grid


@final
@dataclass(frozen=True)
class Scale:
    """The sizes of a plant, by which its effects are measured; the same in all its records.

    Attributes:
        low, high: range of the drive [V].
        gain: of the base plant [m/V].
        omega, zeta: of the base plant.
        duration: of a record [s].
        loop: largest hysteretic displacement [m].
        static: the mechanics are too fast to be seen.
    """

    low: float
    high: float
    gain: float
    omega: float
    zeta: float
    duration: float
    loop: float
    static: bool

    @property
    def span(self) -> float:
        """Range of the drive [V]."""
        return self.high - self.low

    @property
    def reach(self) -> float:
        """Largest drive on either side [V]."""
        return max(abs(self.low), abs(self.high))

    @property
    def stroke(self) -> float:
        """Stroke of the gain alone [m]."""
        return self.gain * self.span


@final
@dataclass(frozen=True)
class Scene:
    """One record in the making: its grid, its base plant and drive, its temperature.

    Attributes:
        ends: the drive before any effect, shape (2, sub-steps) [V].
        warmer: temperature over the reference at the ends of the sub-steps [K].
        seed: of what happens at random *during* this record.
    """

    grid: Grid
    base: Base
    ends: Array
    warmer: Array
    seed: int

    def finer(self, values: Array, *, held: bool) -> Scene:
        """The same record at sub-steps of half the length.

        Args:
            values: the sampled drive [V].
            held: whether it is held between the samples.
        """
        grid = replace(self.grid, substeps=2 * self.grid.substeps)
        warmer = np.interp(
            np.arange(grid.count + 1) / 2.0, np.arange(self.warmer.size), self.warmer
        )
        return replace(self, grid=grid, ends=grid.ends(values, held), warmer=warmer)


class Pull(Protocol):
    """A term of the loop: what a move adds, and how much it drags on the loop itself."""

    def __call__(
        self, drive: float, move: float, seconds: float, loop: float
    ) -> tuple[float, float]:
        """Added displacement [m] and relative decay over one move of the drive."""


class Force(Protocol):
    """A force of the motion balance with a memory, as the displacement it takes away [m]."""

    def at(self, position: float, velocity: float, free: float, time: float) -> float:
        """The force there, from the memory last kept."""

    def keep(self) -> None:
        """Keep the memory of the last call."""


class Grip(Protocol):
    """Something that holds the position still for a while."""

    def holds(self, free: float, position: float, time: float) -> bool:
        """Whether the position stays where it is."""


@final
@dataclass(frozen=True)
class Back:
    """The motion's charge on the drive: v = u - kappa q, with q the velocity lagged twice."""

    kappa: float
    slow: float
    quick: float


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """A hidden effect at some intensity; what it leaves alone passes unchanged.

    Attributes:
        intensity: the gate, relative to the plant's own scale.
        scale: the plant it sits in.
    """

    name: ClassVar[str]
    plausible: ClassVar[tuple[float, float]]
    """Range of intensities found in hardware."""

    intensity: float
    scale: Scale

    def at(self, intensity: float) -> Self:
        """The same effect at another intensity."""
        return replace(self, intensity=intensity)

    @property
    def form(self) -> str:
        """Which of several ways of writing it this one is."""
        return ""

    def drive(self, scene: Scene, ends: Array) -> Array:
        """The drive that arrives, shape (2, sub-steps) [V]."""
        return ends

    def pull(self) -> Pull | None:
        """A term of the loop."""
        return None

    def strain(self, scene: Scene, ends: Array, free: Array) -> Array | None:
        """Displacement added to the free one, shape (2, sub-steps) [m]."""
        return None

    def force(self, scene: Scene) -> Force | None:
        """A force of the motion balance."""
        return None

    def grip(self, scene: Scene) -> Grip | None:
        """A hold on the position."""
        return None

    def back(self) -> Back | None:
        """A coupling from the motion back to the drive."""
        return None

    def read(self, scene: Scene, free: Array, position: Array) -> Array:
        """The reading of a position, both at the ends of the sub-steps, shape (sub-steps + 1,)."""
        return position


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """A number between low and high, every ratio equally likely."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))
