"""Hysteresis operators: play, Prandtl-Ishlinskii, Preisach and Bouc-Wen.

All map an input that is monotone between its values, shape (n,), to an output at the same values,
and begin as if the input had come from zero, demagnetised.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

Array: TypeAlias = NDArray[np.float64]


class Operator(Protocol):
    """A hysteresis operator of a drive that is scaled to its span."""

    def __call__(self, drive: Array) -> Array:
        """Output at the values of a drive; both are near 1 at full drive."""
        ...


def play(below: Array, above: Array, start: float = 0.0) -> Array:
    """Play operator between two envelopes.

        y_k = max(below_k, min(above_k, y_(k-1))),        y_(-1) = start

    With below = u - r and above = u + r it is the play of half width r (Krasnosel'skii and
    Pokrovskii, 1989). A clamp after a clamp is a clamp: the recursion is a scan, in log2(n)
    passes over all values.
    """
    low, high = below.copy(), above.copy()
    reach = 1
    while reach < low.size:
        first = low[:-reach], high[:-reach]
        later = low[reach:], high[reach:]
        after = np.clip(first[0], *later), np.clip(first[1], *later)
        low[reach:], high[reach:] = after
        reach *= 2
    found: Array = np.clip(start, low, high)
    return found


@final
@dataclass(frozen=True)
class PrandtlIshlinskii:
    """Weighted plays: y = rest u + sum_i w_i play_(r_i)(u) (Kuhnen, 2003).

    Attributes:
        rest: weight of the input itself.
        weights, thresholds: of each play, positive.
    """

    rest: float
    weights: tuple[float, ...]
    thresholds: tuple[float, ...]

    def __call__(self, drive: Array) -> Array:
        found = self.rest * drive
        for weight, threshold in zip(self.weights, self.thresholds, strict=True):
            found = found + weight * play(drive - threshold, drive + threshold)
        return found


@final
@dataclass(frozen=True)
class Preisach:
    """Relays with a smooth density over the Preisach plane (Mayergoyz, 1991).

        y = linear u + (1 - linear) P(u),
        dP along a branch from a turning point a = 2 E(a, u),
        E(a, b) = integral of the density over the triangle between a and b

    The density is a sum of two Gaussians over the plane of switching inputs, the same when both
    are exchanged, of inputs between -1.5 and 1.5.

    Attributes:
        linear: share of the output without memory.
        centre, width: of the interaction field, (up + down) / 2.
        coercive, spread: of the half width of the relays, (up - down) / 2.
        past: turning points of the input before the first value.
    """

    linear: float
    centre: float
    width: float
    coercive: float
    spread: float

    past: tuple[float, ...] = ()

    @cached_property
    def _everett(self) -> RectBivariateSpline:
        nodes = np.linspace(-_EDGE, _EDGE, 241)
        up, down = np.meshgrid(nodes, nodes, indexing="ij")
        field, half = 0.5 * (up + down), 0.5 * (up - down)
        density = np.exp(-(((field - self.centre) / self.width) ** 2)) * (
            np.exp(-(((half - self.coercive) / self.spread) ** 2))
            + np.exp(-(((half + self.coercive) / self.spread) ** 2))
        )
        # Twice E(a, b) is the integral over the square [b, a] x [b, a]: it goes on smoothly
        # over the diagonal, as the density does.
        mean = density[1:, 1:] + density[:-1, 1:] + density[1:, :-1] + density[:-1, :-1]
        total = np.zeros_like(density)
        total[1:, 1:] = np.cumsum(np.cumsum(mean, axis=0), axis=1)
        own = np.diagonal(total)
        twice = own[:, None] + own[None, :] - total - total.T
        unit = twice[np.searchsorted(nodes, 1.0), np.searchsorted(nodes, 0.0)]
        return RectBivariateSpline(nodes, nodes, twice / unit)

    def __call__(self, drive: Array) -> Array:
        anchors, parents, branch = _branches(np.concatenate([self.past, drive]).tolist())
        grown = self._everett.ev(anchors, anchors[parents])
        grown = np.where(anchors > anchors[parents], grown, -grown).tolist()
        reached = [0.0]
        for parent, step in zip(parents[1:].tolist(), grown[1:], strict=True):
            reached.append(reached[parent] + step)
        branch = branch[len(self.past) :]
        turned = anchors[branch]
        along = self._everett.ev(drive, turned)
        memory = np.array(reached)[branch] + np.where(drive > turned, along, -along)
        found: Array = self.linear * drive + (1.0 - self.linear) * memory
        return found


def _branches(drive: list[float]) -> tuple[Array, NDArray[np.intp], NDArray[np.intp]]:
    """Turning points, the one that each was reached from, and that of each value's branch.

    A turning point is wiped out when the input passes it.
    """
    anchors, parents, branch = [-_EDGE], [0], []
    open_: list[int] = [0]
    last, rising = -_EDGE, True
    for value in drive:
        if value != last and (value > last) is not rising:
            anchors.append(last)
            parents.append(open_[-1])
            open_.append(len(anchors) - 1)
            rising = not rising
        while len(open_) > 2 and (value > anchors[open_[-2]]) is rising:
            del open_[-2:]
        branch.append(open_[-1])
        last = value
    return np.array(anchors), np.array(parents), np.array(branch)


@final
@dataclass(frozen=True)
class BoucWen:
    """Bouc-Wen in its standard form (Wen, 1976), of exponent 1, 2 or between.

    y = linear u + (1 - linear) z,        dz/du = 1 - (beta sign(du z) + gamma) |z|^n
    """

    linear: float
    beta: float
    gamma: float
    exponent: float

    def __call__(self, drive: Array) -> Array:
        loop: list[float] = []
        z, last = 0.0, 0.0
        for value in drive.tolist():
            # The way from zero to the first value is long: more steps there.
            parts = 1 if loop else 200
            for _ in range(parts):
                z = self._moved(z, (value - last) / parts)
            loop.append(z)
            last = value
        found: Array = self.linear * drive + (1.0 - self.linear) * np.array(loop)
        return found

    def _moved(self, z: float, by: float) -> float:
        """One midpoint step: its error is far below that of the record's own sub-steps."""
        middle = z + 0.5 * by * self._slope(z, by)
        return z + by * self._slope(middle, by)

    def _slope(self, z: float, by: float) -> float:
        wide = self.beta if z * by > 0.0 else -self.beta
        return 1.0 - (wide + self.gamma) * float(abs(z) ** self.exponent)


_EDGE = 1.5
