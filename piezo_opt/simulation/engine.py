"""Two engines that run a scheme over segments: the compiled program, and CasADi's own machine.

Both take the state and its sensitivities at the start and return readings; the compiled one is
some ten times faster, the other needs no compiler.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.simulation.compiler import load
from piezo_opt.simulation.program import SYMBOL, source
from piezo_opt.simulation.schedule import Segment
from piezo_opt.simulation.scheme import Scheme, scheme

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


@final
@dataclass(frozen=True, eq=False)
class Run:
    """What a run returns.

    Attributes:
        reading: (N,) [m].
        sensitivities: (N, k) derivative of the reading by each direction.
        states: (N, n) at the readings, None unless asked for.
        last: (n,) states at the end.
        last_sensitivities: (n, k) derivative of the last states by each direction.
    """

    reading: FloatArray
    sensitivities: FloatArray
    states: FloatArray | None
    last: FloatArray
    last_sensitivities: FloatArray


class Engine(Protocol):
    """Runs one scheme."""

    @property
    def compiled(self) -> bool:
        """Whether the engine is machine code."""

    def run(
        self,
        segment: Segment,
        substeps: IntArray,
        parameters: FloatArray,
        start: FloatArray,
        start_sensitivities: FloatArray,
        *,
        states: bool = False,
    ) -> Run:
        """Simulate; shapes as in :class:`Run`, ``start_sensitivities`` (n, k)."""


@lru_cache(maxsize=256)
def engine(system: System, directions: tuple[str, ...], prefer_compiled: bool = True) -> Engine:
    """The fastest engine there is on this machine for a system and its directions."""
    made = scheme(system, directions)
    if prefer_compiled:
        library = load(source(made))
        if library is not None:
            return CompiledEngine(made, library)
    return VirtualMachine(made)


def _pack(made: Scheme, dense: FloatArray) -> FloatArray:
    return np.ascontiguousarray(dense[made.rows, made.columns]) if dense.size else np.zeros(0)


def _unpack(made: Scheme, packed: FloatArray, states: int) -> FloatArray:
    dense = np.zeros((states, len(made.directions)))
    dense[made.rows, made.columns] = packed
    return dense


@final
class CompiledEngine:
    """The C program of a scheme, called through ctypes (which releases the interpreter lock)."""

    compiled = True

    def __init__(self, made: Scheme, library: ctypes.CDLL) -> None:
        self._scheme = made
        self._function = getattr(library, SYMBOL)
        self._function.restype = None
        self._function.argtypes = [ctypes.c_long] + [ctypes.c_void_p] * 18

    def run(
        self,
        segment: Segment,
        substeps: IntArray,
        parameters: FloatArray,
        start: FloatArray,
        start_sensitivities: FloatArray,
        *,
        states: bool = False,
    ) -> Run:
        made = self._scheme
        count, n, k = segment.readings, start.size, len(made.directions)
        x = np.array(start, dtype=float)
        s = _pack(made, start_sensitivities)
        y, j = np.empty(count), np.empty((count, k))
        xs = np.empty((count, n)) if states else None
        columns = [
            segment.length, substeps, segment.time, segment.drive, segment.slope,
            segment.channels, segment.channel_slopes, segment.length_by_delay,
            segment.drive_by_delay, segment.time_by_delay, segment.channels_by_delay,
            segment.reading, np.ascontiguousarray(parameters, dtype=float), x, s, y, j,
        ]  # fmt: skip
        pointers = [a.ctypes.data for a in columns]
        pointers.append(xs.ctypes.data if xs is not None else None)
        self._function(segment.length.size, *pointers)
        return Run(y, j, xs, x, _unpack(made, s, n))


@final
class VirtualMachine:
    """CasADi's interpreter, mapped over the sub-steps."""

    compiled = False

    def __init__(self, made: Scheme) -> None:
        self._scheme = made

    def run(
        self,
        segment: Segment,
        substeps: IntArray,
        parameters: FloatArray,
        start: FloatArray,
        start_sensitivities: FloatArray,
        *,
        states: bool = False,
    ) -> Run:
        made = self._scheme
        n = start.size
        which = np.repeat(np.arange(substeps.size), substeps)
        ends = np.cumsum(substeps)
        within = np.arange(which.size) - np.repeat(ends - substeps, substeps)
        divide = np.maximum(substeps, 1)
        h, ht = segment.length / divide, segment.length_by_delay / divide

        def at(inside: NDArray[np.intp], index: NDArray[np.intp]) -> dict[str, FloatArray]:
            past, past_t = inside * h[index], inside * ht[index]
            slopes = segment.channel_slopes[index]
            return {
                "h": h[index],
                "du": segment.slope[index],
                "dc": slopes.T,
                "hT": ht[index],
                "t": segment.time[index] + past,
                "u": segment.drive[index] + segment.slope[index] * past,
                "c": (segment.channels[index] + slopes * past[:, None]).T,
                "uT": segment.drive_by_delay[index] + segment.slope[index] * past_t,
                "tT": segment.time_by_delay[index] + past_t,
                "cT": (segment.channels_by_delay[index] + slopes * past_t[:, None]).T,
            }

        p = np.asarray(parameters, dtype=float)
        x0 = np.asarray(start, dtype=float)
        s0 = _pack(made, start_sensitivities)
        xs, ss = np.tile(x0[:, None], (1, 1)), np.tile(s0[:, None], (1, 1))
        if which.size:
            x_all, s_all = _accumulate(made.step, which.size, p, x0, s0, at(within, which))
            xs, ss = np.hstack([xs, x_all]), np.hstack([ss, s_all])
        order = np.argsort(np.where(segment.reading >= 0, segment.reading, segment.reading.size))
        read = order[: segment.readings]
        inputs = at(substeps[read], read)
        inputs["x"], inputs["S"] = xs[:, ends[read]], ss[:, ends[read]]
        y, j = _map(made.reading, read.size, p, inputs)
        return Run(
            y.ravel(),
            np.ascontiguousarray(j.T),
            np.ascontiguousarray(inputs["x"].T) if states else None,
            xs[:, -1].copy(),
            _unpack(made, ss[:, -1], n),
        )


_MOVING = ("h", "du", "dc", "hT", "t", "u", "c", "uT", "tT", "cT")


def _accumulate(
    step: ca.Function,
    count: int,
    p: FloatArray,
    x0: FloatArray,
    s0: FloatArray,
    inputs: dict[str, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    symbols = {name: ca.MX.sym(name, step.size_in(name)[0]) for name in step.name_in()}
    n = x0.size
    both = ca.MX.sym("xS", n + s0.size)
    moving = ca.MX.sym("moving", sum(symbols[name].numel() for name in _MOVING))
    parts = ca.vertsplit(moving, np.cumsum([0, *(symbols[m].numel() for m in _MOVING)]).tolist())
    named = dict(zip(_MOVING, parts, strict=True))
    named |= {"p": symbols["p"], "x": both[:n], "S": both[n:]}
    x_next, s_next = step(*(named[name] for name in step.name_in()))
    one = ca.Function("po_one", [both, moving, symbols["p"]], [ca.vertcat(x_next, s_next)])
    rows = np.vstack([np.atleast_2d(inputs[name]) for name in _MOVING if symbols[name].numel()])
    chunk, done = 4096, []
    state = np.concatenate([x0, s0])
    whole = one.mapaccum("po_many", chunk) if count >= chunk else None
    for begin in range(0, count, chunk):
        part = rows[:, begin : begin + chunk]
        size = part.shape[1]
        many = whole if whole is not None and size == chunk else one.mapaccum("po_rest", size)
        out = np.array(many(state, part, ca.repmat(ca.DM(p), 1, size)))
        state = out[:, -1]
        done.append(out)
    out = np.hstack(done)
    return out[:n], out[n:]


def _map(
    reading: ca.Function, count: int, p: FloatArray, inputs: dict[str, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    whole = reading.map(count)
    given = {**inputs, "p": ca.repmat(ca.DM(p), 1, count)}
    out = whole(*(np.atleast_2d(given[n]) if n != "p" else given[n] for n in reading.name_in()))
    return np.array(out[0]), np.array(out[1]).reshape(-1, count)
