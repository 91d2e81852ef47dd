"""One resonance, with or without forces that are not linear.

x'' + 2 zeta omega x' + omega^2 x = omega^2 (s - f),      f in metres of free displacement
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias, final, runtime_checkable

import numpy as np
from scipy.linalg import expm

from piezo_opt.benchmark.foreign.linear import second_order
from piezo_opt.benchmark.foreign.operators import Array

Memory: TypeAlias = tuple[float, ...]
Law: TypeAlias = Callable[[float, float, float, Memory], tuple[float, Memory]]
"""(position, velocity / omega, way since the last node, memory there) to (force, memory here)."""


@runtime_checkable
class Force(Protocol):
    """A force that is not linear, in metres of free displacement."""

    def law(self) -> tuple[Law, Memory]:
        """The law, and its memory at rest."""
        ...


@final
@dataclass(frozen=True)
class Resonance:
    """Mechanics of second order.

    Attributes:
        omega: natural frequency [rad/s].
        zeta: damping ratio.
    """

    omega: float
    zeta: float

    def moved(self, free: Array, forces: tuple[Force, ...], step: float) -> Array:
        """Position under a free displacement that is linear between the nodes."""
        if not forces:
            return second_order(free, self.omega, self.zeta, step)
        return _integrated(self, free, forces, step)


def _integrated(mechanics: Resonance, free: Array, forces: tuple[Force, ...], step: float) -> Array:
    """The linear part exactly; the forces linear between nodes, predicted and corrected once."""
    # Time in units of 1 / omega.
    a = np.zeros((4, 4))
    a[:2, :3] = [[0.0, 1.0, 0.0], [-1.0, -2.0 * mechanics.zeta, 1.0]]
    a[2, 3] = 1.0 / (step * mechanics.omega)
    e = expm(a * step * mechanics.omega)
    (xx, xv, x0, x1), (vx, vv, v0, v1) = e[0].tolist(), e[1].tolist()
    laws = [force.law() for force in forces]
    memories = [memory for _, memory in laws]
    rules = [rule for rule, _ in laws]
    drive = free.tolist()
    x, v = drive[0], 0.0
    pull = sum(rule(x, 0.0, 0.0, m)[0] for rule, m in zip(rules, memories, strict=True))
    # At rest the spring holds the forces that do not vanish there.
    for _ in range(50):
        x = drive[0] - pull
        pull = sum(rule(x, 0.0, 0.0, m)[0] for rule, m in zip(rules, memories, strict=True))
    u, last = drive[0] - pull, drive[0]
    found = [x]
    for value in drive[1:]:
        ahead = u + value - last
        last = value
        for _ in range(2):
            # x1 and v1 weigh the growth of the input over the step.
            grown = ahead - u
            there = xx * x + xv * v + x0 * u + x1 * grown
            speed = vx * x + vv * v + v0 * u + v1 * grown
            ahead, after = value, []
            for rule, memory in zip(rules, memories, strict=True):
                force, kept = rule(there, speed, there - x, memory)
                ahead -= force
                after.append(kept)
        grown = ahead - u
        x, v = (
            xx * x + xv * v + x0 * u + x1 * grown,
            vx * x + vv * v + v0 * u + v1 * grown,
        )
        u, memories = ahead, after
        found.append(x)
        if not abs(x) < 1.0:
            return np.full(free.size, np.nan)  # a softening spring gave way
    return np.array(found)


@final
@dataclass(frozen=True)
class Duffing:
    """f = c x (x / size)^2: a spring that hardens or softens (Duffing, 1918)."""

    size: float
    strength: float

    def law(self) -> tuple[Law, Memory]:
        factor = self.strength / self.size**2

        def rule(x: float, v: float, way: float, memory: Memory) -> tuple[float, Memory]:  # noqa: ARG001
            return factor * x**3, memory

        return rule, ()


@final
@dataclass(frozen=True)
class Dahl:
    """f = c size z, dz/dx = (1 - z sign(dx)) / length (Dahl, 1968), exactly along a step."""

    length: float
    size: float
    strength: float

    def law(self) -> tuple[Law, Memory]:
        most = self.strength * self.size

        def rule(x: float, v: float, way: float, memory: Memory) -> tuple[float, Memory]:  # noqa: ARG001
            z = _bristle(memory[0], way, self.length)
            return most * z, (z,)

        return rule, (0.0,)


def _bristle(z: float, way: float, length: float) -> float:
    """Deflection of a bristle after a way in one direction."""
    toward = math.copysign(1.0, way)
    return toward + (z - toward) * math.exp(-abs(way) / length)


@final
@dataclass(frozen=True)
class LuGre:
    """Stribeck's friction with bristles (Canudas de Wit et al., 1995).

    f = c size (z + viscous v / slow),    z' = v / length - |v| z / (length g(v)),
    g = 1 + stiction exp(-(v / slow)^2)
    """

    length: float
    stiction: float
    slow: float
    viscous: float
    size: float
    strength: float

    def law(self) -> tuple[Law, Memory]:
        most = self.strength * self.size

        def rule(x: float, v: float, way: float, memory: Memory) -> tuple[float, Memory]:  # noqa: ARG001
            g = 1.0 + self.stiction * math.exp(-min((v / self.slow) ** 2, 50.0))
            z = g * _bristle(memory[0] / g, way, self.length * g)
            return most * (z + self.viscous * v / self.slow), (z,)

        return rule, (0.0,)


@final
@dataclass(frozen=True)
class Iwan:
    """f = sum of elastic sliders in parallel (Iwan, 1966): stops of equal stiffness."""

    yields: tuple[float, ...]
    strength: float

    def law(self) -> tuple[Law, Memory]:
        share = self.strength / len(self.yields)

        def rule(x: float, v: float, way: float, memory: Memory) -> tuple[float, Memory]:  # noqa: ARG001
            kept = tuple(
                max(-most, min(most, z + way)) for z, most in zip(memory, self.yields, strict=True)
            )
            return share * sum(kept), kept

        return rule, (0.0,) * len(self.yields)


@final
@dataclass(frozen=True)
class HystereticSpring:
    """f = c size z, dz = dx (1 - (beta sign(dx z) + gamma) |z|^n) / size (Bouc, 1967)."""

    size: float
    beta: float
    gamma: float
    exponent: int
    strength: float

    def law(self) -> tuple[Law, Memory]:
        def slope(z: float, by: float) -> float:
            wide = self.beta if z * by > 0.0 else -self.beta
            return 1.0 - (wide + self.gamma) * float(abs(z) ** self.exponent)

        def rule(x: float, v: float, way: float, memory: Memory) -> tuple[float, Memory]:  # noqa: ARG001
            by = way / self.size
            z = memory[0]
            z += by * slope(z + 0.5 * by * slope(z, by), by)
            return self.strength * self.size * z, (z,)

        return rule, (0.0,)


@final
@dataclass(frozen=True)
class DragDamping:
    """f = c |v| v / (omega^2 size): drag of a fluid."""

    size: float
    strength: float

    def law(self) -> tuple[Law, Memory]:
        def rule(x: float, v: float, way: float, memory: Memory) -> tuple[float, Memory]:  # noqa: ARG001
            return self.strength * abs(v) * v / self.size, memory

        return rule, ()


@final
@dataclass(frozen=True)
class AmplitudeDamping:
    """f = c (x / size)^2 v / omega: damping that grows with the deflection (Eichler, 2011)."""

    size: float
    strength: float

    def law(self) -> tuple[Law, Memory]:
        def rule(x: float, v: float, way: float, memory: Memory) -> tuple[float, Memory]:  # noqa: ARG001
            return self.strength * (x / self.size) ** 2 * v, memory

        return rule, ()
