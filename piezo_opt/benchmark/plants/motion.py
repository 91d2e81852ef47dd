"""Hidden forces of the motion balance, each as the displacement it takes away, F / omega^2."""

# Every effect has the same signatures, whether it reads the whole scene or not.
# ruff: noqa: ARG002

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, exp, sinh
from typing import ClassVar, final

from piezo_opt.benchmark.plants.hidden import Force, Hidden, Scene

_PATH_STEP = 0.04
"""Largest part of a mount's reach travelled in one step of its law."""


@final
class _Spring:
    """sinh(b u) / b - u, or u |u| + u^3 weighted, of the position over the stroke."""

    def __init__(self, stroke: float, strength: float, bend: float, even: float) -> None:
        self._stroke, self._strength, self._bend, self._even = stroke, strength, bend, even

    def at(self, position: float, velocity: float, free: float, time: float) -> float:
        """The part of the spring that is not straight."""
        u = position / self._stroke
        if self._bend > 0.0:
            b = self._bend
            shape = (sinh(b * u) / b - u) * 6.0 / (b * b)
        else:
            shape = u * u * u + self._even * u * abs(u)
        return self._strength * self._stroke * shape

    def keep(self) -> None:
        """A spring has no memory."""


@final
@dataclass(frozen=True, kw_only=True)
class CubicStiffness(Hidden):
    """Guide that stiffens or softens: sinh, or a cube with some x |x|.

    Intensity: the force at full stroke over the linear one.
    """

    name: ClassVar[str] = "cubic_stiffness"
    plausible: ClassVar[tuple[float, float]] = (2e-3, 0.4)
    bend: float
    """b of the sinh; 0 for the polynomial."""
    even: float
    sign: float

    @property
    def form(self) -> str:
        """Sinh or polynomial."""
        return "sinh" if self.bend > 0.0 else "polynomial"

    def force(self, scene: Scene) -> Force:
        """The spring in this plant."""
        return _Spring(self.scale.stroke, self.sign * self.intensity, self.bend, self.even)


@final
class _Bristle:
    """LuGre: bristles bend, slip at a level that falls with the speed, and are damped."""

    def __init__(
        self, level: float, reach: float, static: float, speed: float, damping: float, step: float
    ) -> None:
        self._level, self._reach, self._static = level, reach, static
        self._speed, self._damping, self._step = speed, damping, step
        self._z = self._next = 0.0
        self._from: float | None = None
        self._to = 0.0

    def at(self, position: float, velocity: float, free: float, time: float) -> float:
        """The bristles' force at the end of a step, at the speed of its mean."""
        self._to = position
        if self._from is None:
            self._next = self._z
            return self._level * self._z
        moved = (position - self._from) / self._reach
        speed = (position - self._from) / self._step
        slip = 1.0 + (self._static - 1.0) * exp(-((speed / self._speed) ** 2))
        # Exact along a stretch of one direction: a jump of the drive is one step of the plant.
        level = slip if moved > 0.0 else -slip
        self._next = level + (self._z - level) * exp(-abs(moved) / slip)
        return self._level * (self._next + self._damping * (self._next - self._z) / self._step)

    def keep(self) -> None:
        """The step is done."""
        self._z, self._from = self._next, self._to


@final
@dataclass(frozen=True, kw_only=True)
class Friction(Hidden):
    """LuGre friction. Intensity: sliding friction over the force of the full stroke.

    Source: Canudas de Wit, Olsson, Astrom & Lischinsky (1995), IEEE Trans. Automatic Control
    40(3), 419-425.
    """

    name: ClassVar[str] = "friction"
    plausible: ClassVar[tuple[float, float]] = (5e-4, 0.08)
    presliding: float
    """Presliding displacement over the stroke."""
    static: float
    """Static over sliding friction."""

    def force(self, scene: Scene) -> Force:
        """The contact in this plant."""
        stroke = self.scale.stroke
        return _Bristle(
            self.intensity * stroke, self.presliding * stroke, self.static,
            0.02 * stroke * self.scale.omega, 0.05 / self.scale.omega, scene.grid.step,
        )  # fmt: skip


@final
class _Memory:
    """Bouc-Wen on the position: z' = x' - |x'| |z|^(n-1) z (c + d sign(x' z)), saturating at 1."""

    def __init__(self, level: float, reach: float, exponent: float, skew: float) -> None:
        self._level, self._reach, self._rest, self._skew = level, reach, exponent - 1.0, skew
        self._z = self._next = 0.0
        self._from: float | None = None
        self._to = 0.0

    def at(self, position: float, velocity: float, free: float, time: float) -> float:
        """The force at the end of a step, by the midpoint rule along the way."""
        self._to = position
        if self._from is None:
            self._next = self._z
            return self._level * self._z
        moved = (position - self._from) / self._reach
        # A jump of the drive is one step of a plant without inertia, and many of the law.
        parts = max(ceil(abs(moved) / _PATH_STEP), 1)
        half = 0.5 * moved / parts
        z = self._z
        for _ in range(parts):
            middle = z
            for _ in range(2):
                aligned = 1.0 if half * middle > 0.0 else -1.0
                drag = abs(half) * abs(middle) ** self._rest
                drag *= (1.0 + self._skew * aligned) / (1.0 + self._skew)
                middle = (z + half) / (1.0 + drag)
            z = 2.0 * middle - z
        self._next = z
        return self._level * self._next

    def keep(self) -> None:
        """The step is done."""
        self._z, self._from = self._next, self._to


@final
@dataclass(frozen=True, kw_only=True)
class HystereticForce(Hidden):
    """Bouc-Wen restoring force on the position, exponent above one.

    Intensity: the saturated force over that of the full stroke. Source: Wen (1976), J. Eng. Mech.
    Div. 102(2), 249-263.
    """

    name: ClassVar[str] = "hysteretic_force"
    plausible: ClassVar[tuple[float, float]] = (3e-3, 0.4)
    reach: float
    """Displacement at which the force saturates, over the stroke."""
    exponent: float
    skew: float

    def force(self, scene: Scene) -> Force:
        """The mount in this plant."""
        stroke = self.scale.stroke
        return _Memory(self.intensity * stroke, self.reach * stroke, self.exponent, self.skew)
