"""The base plant: gain, Bouc-Wen loop, second-order mechanics, offset.

Written for the bench alone, with its own numerics: the loop is integrated over the *path* of the
drive (it knows no time), the mechanics by their exact response to an input that is linear in
every sub-step, with jumps between sub-steps. Signals on the fine grid therefore have two values
per sub-step, the one it begins with and the one it ends with: arrays of shape (2, n).

References: Wen (1976), J. Eng. Mech. Div. 102(2), 249-263; Low & Guo (1995), J.
Microelectromech. Syst. 4(4), 230-237; Franklin, Powell & Workman (1998), Digital Control of
Dynamic Systems, ch. 4 (exact discretisation under a linear input).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array: TypeAlias = NDArray[np.float64]

_PATH_STEP = 0.04
"""Largest part of the loop's own width (1 / (beta + gamma)) travelled in one step of the path."""

NAMES = (
    "gain", "alpha", "beta", "gamma", "exponent", "omega", "zeta", "offset", "start_loop",
    "start_position", "start_velocity",
)  # fmt: skip
"""What a refit of the base plant may move, in the order of its vector."""

STATIC = ("gain", "alpha", "beta", "gamma", "exponent", "offset", "start_loop")
"""The same where the mechanics are too fast to be seen."""


@final
@dataclass(frozen=True)
class Base:
    """The parameters of the base plant, and where one record of it starts.

        dh/dv = alpha - (beta sign(dv) sign(h) + gamma) |h| |h / pivot|^(exponent - 1)
        s = gain v - h,   x'' = omega^2 (s - x) - 2 zeta omega x',   reading = x + offset

    Units: gain, alpha m/V; beta, gamma 1/V; omega rad/s; offset, pivot, start_loop,
    start_position m; start_velocity m/s. With ``static`` the position is s.
    """

    gain: float
    alpha: float
    beta: float
    gamma: float
    exponent: float
    pivot: float
    omega: float
    zeta: float
    offset: float
    static: bool
    start_loop: float = 0.0
    start_position: float = 0.0
    start_velocity: float = 0.0

    @property
    def width(self) -> float:
        """Inverse of the drive over which the loop bends [1/V]."""
        return self.beta + abs(self.gamma)

    def vector(self) -> Array:
        """The parameters in the order of NAMES."""
        return np.array([getattr(self, name) for name in NAMES])


@final
@dataclass(frozen=True)
class Grid:
    """Samples at ``rate`` [1/s], each interval cut into ``substeps``; the record is kept from
    sample ``first`` on, which is the time 0 of ``time``."""

    samples: int
    first: int
    rate: float
    substeps: int

    @property
    def step(self) -> float:
        """Length of a sub-step [s]."""
        return 1.0 / (self.rate * self.substeps)

    @property
    def count(self) -> int:
        """Number of sub-steps."""
        return (self.samples - 1) * self.substeps

    @property
    def time(self) -> Array:
        """Time of the ends of the sub-steps [s], shape (count + 1,)."""
        index = np.arange(self.count + 1, dtype=np.float64) - self.first * self.substeps
        return np.asarray(index * self.step, dtype=np.float64)

    def ends(self, values: Array, held: bool) -> Array:
        """A sampled signal at both ends of every sub-step, linear or held between the samples."""
        if held:
            return np.repeat(values[:-1], self.substeps)[None, :].repeat(2, axis=0)
        nodes = np.interp(
            np.arange(self.count + 1) / self.substeps, np.arange(self.samples), values
        )
        return both(nodes)

    def sampled(self, nodes: Array) -> Array:
        """A continuous signal at the samples of the record."""
        return nodes[self.first * self.substeps :: self.substeps]


def both(nodes: Array) -> Array:
    """A continuous signal, shape (n + 1,), at both ends of every sub-step, shape (2, n)."""
    return np.stack((nodes[:-1], nodes[1:]))


@final
@dataclass(frozen=True)
class Path:
    """The drive as a sequence of moves without time, and which move ends at which end.

    Attributes:
        moves: change of the drive in each move [V].
        share: which part of its sub-step's time a move takes.
        substep: the sub-step a move belongs to.
        index: how many moves are done at the beginning and at the end of every sub-step.
    """

    moves: Array
    share: Array
    substep: NDArray[np.intp]
    index: NDArray[np.intp]


def path(ends: Array, width: float, *, with_rest: bool = False) -> Path:
    """Cut the drive into moves so short that the loop is integrated exactly enough.

    Rest is left out unless asked for: a loop without relaxation does not move at rest.
    """
    count = ends.shape[1]
    changes = np.empty((count, 2))
    changes[0, 0] = 0.0
    changes[1:, 0] = ends[0, 1:] - ends[1, :-1]
    changes[:, 1] = ends[1] - ends[0]
    flat = changes.ravel()
    parts = np.ceil(np.abs(flat) * width / _PATH_STEP).astype(np.intp)
    if with_rest:
        parts[1::2] = np.maximum(parts[1::2], 1)
    moves = np.repeat(flat / np.maximum(parts, 1), parts)
    takes = np.tile([0.0, 1.0], count) / np.maximum(parts, 1)
    substep = np.repeat(np.repeat(np.arange(count), 2), parts)
    return Path(moves, np.repeat(takes, parts), substep, np.cumsum(parts).reshape(count, 2).T)


def loops(
    moves: Array, alpha: Array, beta: Array, gamma: Array, exponent: Array, pivot: float,
    start: Array,
) -> Array:  # fmt: skip
    """The hysteretic displacement of several loops along one path, shape (moves + 1, loops) [m].

    Written as dh/dv = alpha - k(h) h, every move is the implicit midpoint rule with k taken at a
    predicted middle: second order, and stable where the loop bends sharply.
    """
    out = np.empty((moves.size + 1, start.size))
    out[0] = start
    h = start.copy()
    rest = exponent - 1.0
    bent = bool(np.any(rest != 0.0))
    k, work, middle = (np.empty_like(h) for _ in range(3))
    for i, move in enumerate(moves.tolist(), start=1):
        half = 0.5 * move
        turned = beta if move > 0.0 else -beta
        level = h
        for _ in range(2):
            np.sign(level, out=k)
            np.multiply(k, gamma, out=k)
            np.add(k, turned, out=k)
            if bent:
                np.abs(level, out=work)
                np.divide(work, pivot, out=work)
                np.power(work, rest, out=work)
                np.multiply(k, work, out=k)
            np.multiply(k, half, out=k)
            np.multiply(alpha, half, out=work)
            np.add(h, work, out=middle)
            np.add(k, 1.0, out=k)
            np.divide(middle, k, out=middle)
            level = middle
        np.add(middle, middle, out=work)
        np.subtract(work, h, out=h)
        out[i] = h
    return out


def filtered(ends: Array, pole: complex, start: complex, step: float) -> NDArray[np.complex128]:
    """Exact c' = pole c + u for u linear in every sub-step; c at the ends, shape (n + 1,)."""
    grown = np.exp(pole * step)
    total = (grown - 1.0) / pole
    late = (total - step) / (pole * step)
    force = (total - late) * ends[0] + late * ends[1]
    rest, _ = lfilter([1.0], [1.0, -grown], force, zi=np.array([grown * start]))
    return np.concatenate(([start], rest))


def lagged(ends: Array, tau: float, start: float, step: float) -> Array:
    """First-order lag: tau z' = u - z, at the ends of the sub-steps, shape (n + 1,)."""
    return np.real(filtered(ends, -1.0 / tau, start * tau, step)) / tau


def pole_of(omega: float, zeta: float) -> complex:
    """The upper pole of an underdamped second-order system [rad/s]."""
    return complex(-zeta * omega, omega * np.sqrt(1.0 - zeta * zeta))


def mechanics(
    free: Array, omega: float, zeta: float, position: float, velocity: float, step: float
) -> tuple[Array, Array]:
    """Position and velocity under the free displacement, at the ends of the sub-steps.

    With the pole p the complex combination c = x' - conj(p) x obeys c' = p c + omega^2 s alone.
    """
    pole = pole_of(omega, zeta)
    start = velocity - pole.conjugate() * position
    c = filtered(omega * omega * free, pole, start, step)
    x = np.imag(c) / pole.imag
    return x, np.real(c) + pole.real * x


def base_responses(base: Base, vectors: Array, drive: Array, held: bool, rate: float) -> Array:
    """The readings of several base plants under one sampled drive, shape (plants, samples) [m].

    Args:
        base: gives the pivot and whether the plant is static.
        vectors: parameters in the order of NAMES, shape (plants, len(NAMES)).
        drive: samples [V]; held or linear in between; ``rate`` in samples a second.
    """
    p = dict(zip(NAMES, vectors.T, strict=True))
    fastest = 0.0 if held else float(np.max(np.abs(np.diff(drive))))
    substeps = 1 if base.static else int(np.clip(np.ceil(fastest * base.width / 0.08), 1, 6))
    grid = Grid(drive.size, 0, rate, substeps)
    ends = grid.ends(drive, held)
    way = path(ends, base.width)
    keys = np.stack([p[name] for name in ("alpha", "beta", "gamma", "exponent", "start_loop")])
    different, which = np.unique(keys, axis=1, return_inverse=True)
    alpha, beta, gamma, exponent, start = different
    h = loops(way.moves, alpha, beta, gamma, exponent, base.pivot, start)
    out = np.empty((vectors.shape[0], drive.size))
    for i, column in enumerate(which.ravel()):
        free = p["gain"][i] * ends - h[way.index, column]
        if base.static:
            first = p["gain"][i] * drive[0] - p["start_loop"][i]
            x = np.concatenate(([first], free[1]))
        else:
            x, _ = mechanics(
                free, p["omega"][i], p["zeta"][i], p["start_position"][i],
                p["start_velocity"][i], grid.step,
            )  # fmt: skip
        out[i] = grid.sampled(x) + p["offset"][i]
    return out
