"""A simulated record linearised from reading to reading, for corrections that vary in time.

Along a simulated trajectory, with w linear between the readings k and k + 1,

    dx_(k+1) = A_k dx_k + B_k w_k + E_k w_(k+1)
    dy_k     = C_k dx_k + D_k w_k

The derivatives are those of the scheme itself, sub-step by sub-step, so that answers computed from
them are the answers of the simulation. All intervals begin at known states and are therefore gone
through at the same time: the number of calls is that of the sub-steps within an interval. The
first state is not moved by a correction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.lazy import lazy
from piezo_opt.simulation.scheme import INITIAL, INPUTS, Scheme, scheme
from piezo_opt.simulation.simulate import Simulator

FloatArray = NDArray[np.float64]

_TOGETHER = 20_000
"""Instants handed to the symbolic engine at a time: its copies are large."""


@final
@dataclass(frozen=True, eq=False)
class Answer:
    """Derivatives for one correction: B, E (N-1, n) and D (N,)."""

    b: FloatArray
    e: FloatArray
    d: FloatArray

    @lazy
    def moves_states(self) -> bool:
        """Whether the correction acts on more than the reading itself."""
        return bool(self.b.any() or self.e.any())


@final
class Transitions:
    """The linearised record as two triangular solves.

    Args:
        simulator: a model with one effect a correction, each with two amplitudes at 0 that
            multiply two channels; what the channels hold does not matter.
        values: the point of linearisation.
        amplitudes: for each correction the full names of its two amplitudes.
        channels: for each correction the names of its two channels.
    """

    def __init__(
        self,
        simulator: Simulator,
        values: Mapping[str, float],
        amplitudes: Sequence[tuple[str, str]],
        channels: Sequence[tuple[str, str]],
    ) -> None:
        system = simulator.system
        self.states = len(system.state_names)
        starts = tuple(INITIAL + name for name in system.state_names)
        moved = (*starts, *(name for pair in amplitudes for name in pair))
        made = scheme(system, moved, simulator.exact)
        falling = [system.channel_names.index(pair[0]) for pair in channels]
        rising = [system.channel_names.index(pair[1]) for pair in channels]
        x = simulator.response(values).states
        self.samples = x.shape[0]
        p = np.array([values[name] for name in system.parameter_names], dtype=float)
        a, slopes = _intervals(made, simulator, values, x, p, falling, rising)
        c, d = _readings(made, simulator, values, x, p, falling)
        self._a, self._c = a, c
        self._answers = [
            Answer(slopes[:, :, 2 * k], slopes[:, :, 2 * k + 1], d[:, 2 * k])
            for k in range(len(amplitudes))
        ]
        self._chain = _triangular(a)

    def forward(self, correction: int, w: FloatArray) -> FloatArray:
        """Change of the reading (N, q) by corrections w (N, q)."""
        of = self._answers[correction]
        moved = of.d[:, None] * w
        if of.moves_states:
            pushes = np.zeros((self.samples, self.states, w.shape[1]))
            np.multiply(of.b[:, :, None], w[:-1, None, :], out=pushes[1:])
            pushes[1:] += of.e[:, :, None] * w[1:, None, :]
            x = self._chain.solve(pushes.reshape(-1, w.shape[1])).reshape(pushes.shape)
            moved += np.einsum("kn,knq->kq", self._c, x)
        return moved

    def adjoint(self, correction: int, y: FloatArray) -> FloatArray:
        """The transpose of :meth:`forward` on one column (N,)."""
        of = self._answers[correction]
        found = of.d * y
        if of.moves_states:
            # The stubs of SciPy do not know the second argument.
            pulled = self._chain.solve((self._c * y[:, None]).ravel(), "T")  # type: ignore[call-overload]
            pulled = pulled.reshape(self.samples, self.states)
            found[:-1] += np.einsum("kn,kn->k", of.b, pulled[1:])
            found[1:] += np.einsum("kn,kn->k", of.e, pulled[1:])
        return np.asarray(found)

    def starts(self) -> FloatArray:
        """Change of the reading (N, n) by the states at the start."""
        n = self.states
        if n == 0:
            return np.zeros((self.samples, 0))
        first = np.zeros((self.samples * n, n))
        first[:n] = np.eye(n)
        x = self._chain.solve(first).reshape(self.samples, n, n)
        return np.asarray(np.einsum("kn,knq->kq", self._c, x))


def _triangular(a: FloatArray) -> scipy.sparse.linalg.SuperLU:
    """The chain x_(k+1) - A_k x_k = push_k as a factorised sparse matrix; it fills nothing in."""
    count, n = a.shape[0], a.shape[1]
    k, i, j = np.meshgrid(np.arange(count), np.arange(n), np.arange(n), indexing="ij")
    rows, columns = ((k + 1) * n + i).ravel(), (k * n + j).ravel()
    size = (count + 1) * n
    below = scipy.sparse.csc_matrix((-a.ravel(), (rows, columns)), shape=(size, size))
    whole = scipy.sparse.csc_matrix(below + scipy.sparse.identity(size, format="csc"))
    return scipy.sparse.linalg.splu(whole, permc_spec="NATURAL", diag_pivot_thresh=0.0)


def _intervals(
    made: Scheme,
    simulator: Simulator,
    values: Mapping[str, float],
    x: FloatArray,
    p: FloatArray,
    falling: Sequence[int],
    rising: Sequence[int],
) -> tuple[FloatArray, FloatArray]:
    """A (N-1, n, n) and the derivatives (N-1, n, 2 q) by the corrections at both ends."""
    segment = simulator.segment(values)
    substeps = simulator.accuracy.substeps.of(segment)
    n, count = x.shape[1], x.shape[0] - 1
    directions = len(made.directions)
    # The interval of a segment is that of the next reading; the first reading begins the first.
    after = np.concatenate([[0], np.cumsum(segment.reading >= 0)[:-1]]) - 1
    inside = np.flatnonzero((after >= 0) & (after < count) & (segment.length > 0))
    which = np.repeat(inside, substeps[inside])
    first = np.concatenate([[0], np.cumsum(substeps[inside])[:-1]])
    within = np.arange(which.size) - np.repeat(first, substeps[inside])
    h = (segment.length / np.maximum(substeps, 1))[which]
    interval = after[which]
    layer = np.arange(which.size) - np.searchsorted(interval, interval)
    past = within * h
    length = np.bincount(interval, h, minlength=count)
    length = np.where(length > 0, length, 1.0)
    elapsed = np.cumsum(h) - h
    elapsed = elapsed - elapsed[np.searchsorted(interval, interval)]
    c = segment.channels[which] + segment.channel_slopes[which] * past[:, None]
    dc = segment.channel_slopes[which].copy()
    part = elapsed / length[interval]
    for column in falling:
        c[:, column], dc[:, column] = 1.0 - part, -1.0 / length[interval]
    for column in rising:
        c[:, column], dc[:, column] = part, 1.0 / length[interval]
    inputs = {
        "h": h, "du": segment.slope[which], "t": segment.time[which] + past,
        "u": segment.drive[which] + segment.slope[which] * past,
    }  # fmt: skip
    now = x[:-1].T.copy()
    carried = np.tile(_identity(made)[:, None], (1, count))
    order = np.argsort(layer, kind="stable")
    bounds = np.searchsorted(layer[order], np.arange(int(layer.max(initial=-1)) + 2))
    for begin, end in pairwise(bounds.tolist()):
        rows = order[begin:end]
        own = interval[rows]
        given = {name: column[rows][None] for name, column in inputs.items()}
        given |= {"c": c[rows].T, "dc": dc[rows].T, "x": now[:, own], "S": carried[:, own], "p": p}
        now[:, own], carried[:, own] = _call(made.step, given, rows.size)
    dense = np.zeros((count, n, directions))
    dense[:, made.rows, made.columns] = carried.T
    return dense[:, :, :n], dense[:, :, n:]


def _readings(
    made: Scheme,
    simulator: Simulator,
    values: Mapping[str, float],
    x: FloatArray,
    p: FloatArray,
    falling: Sequence[int],
) -> tuple[FloatArray, FloatArray]:
    """C (N, n) and the direct derivatives (N, 2 q) by a correction at its reading."""
    segment = simulator.segment(values)
    at = np.flatnonzero(segment.reading >= 0)
    at = at[np.argsort(segment.reading[at])]
    length = segment.length[at]
    c = segment.channels[at] + segment.channel_slopes[at] * length[:, None]
    c[:, list(falling)] = 1.0
    n = x.shape[1]
    given = {
        "du": segment.slope[at][None], "t": (segment.time[at] + length)[None],
        "u": (segment.drive[at] + segment.slope[at] * length)[None],
        "c": c.T, "dc": 0.0 * c.T, "x": x.T, "S": np.tile(_identity(made)[:, None], (1, at.size)),
        "p": p,
    }  # fmt: skip
    _, slopes = _call(made.reading, given, at.size)
    return slopes.T[:, :n], slopes.T[:, n:]


def _identity(made: Scheme) -> FloatArray:
    """The carried entries at the beginning of an interval: each state moves itself alone."""
    return np.asarray((made.rows == made.columns).astype(float))


def _call(function: object, given: Mapping[str, FloatArray], count: int) -> list[FloatArray]:
    """A function of the scheme on many instants; what is not given is 0."""
    parts = []
    for first in range(0, count, _TOGETHER):
        some = slice(first, min(first + _TOGETHER, count))
        size = some.stop - first
        columns = []
        for index, name in enumerate(INPUTS):
            rows = function.size1_in(index)  # type: ignore[attr-defined]
            if name == "p":
                columns.append(np.tile(given["p"][:, None], (1, size)))
            elif name in given and rows:
                columns.append(given[name][:, some])
            else:
                columns.append(np.zeros((rows, size)))
        found = function.map(size)(*columns)  # type: ignore[attr-defined]
        parts.append([out.full() for out in found])
    return [np.hstack(outs) for outs in zip(*parts, strict=True)]
