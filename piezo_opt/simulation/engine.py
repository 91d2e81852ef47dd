"""Two engines that run a scheme over segments: the compiled program, and CasADi's own machine.

Both take the state and its sensitivities at the start and return readings; the compiled one is
many times faster (see the speed benchmark), the other needs no compiler. Engines hold nothing that
a run changes, so several threads may use one.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.simulation.composed import ComposedEngine
from piezo_opt.simulation.composed import program as composed
from piezo_opt.simulation.runs import Ceiling, Run
from piezo_opt.simulation.schedule import Segment
from piezo_opt.simulation.scheme import Scheme, scheme
from piezo_opt.symbolic import one_at_a_time

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]


class Engine(Protocol):
    """Runs one scheme."""

    @property
    def compiled(self) -> bool:
        """Whether the engine is machine code."""

    def start(
        self, segment: Segment, parameters: FloatArray, deviation: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """States (n,) and their sensitivities (n, k) at rest, plus a deviation (n,)."""

    def from_rest(
        self,
        segment: Segment,
        substeps: IntArray,
        parameters: FloatArray,
        deviation: FloatArray,
        *,
        states: bool = False,
        ceiling: Ceiling | None = None,
    ) -> Run:
        """:meth:`run` from what :meth:`start` returns."""

    def run(
        self,
        segment: Segment,
        substeps: IntArray,
        parameters: FloatArray,
        start: FloatArray,
        start_sensitivities: FloatArray,
        *,
        states: bool = False,
        ceiling: Ceiling | None = None,
    ) -> Run:
        """Simulate, no further than a ceiling; shapes as in :class:`Run`.

        ``start_sensitivities`` is (n, k).
        """


@lru_cache(maxsize=2048)
def engine(
    system: System,
    directions: tuple[str, ...],
    prefer_compiled: bool = True,
    exact: bool = False,
) -> Engine:
    """The engine that serves best on this machine for a system and its directions.

    Args:
        system: assembled model.
        directions: of the sensitivities.
        prefer_compiled: False takes CasADi's virtual machine even where a compiler exists.
        exact: whether linear blocks are moved by their exponential.
    """
    made = composed(system, exact) if prefer_compiled else None
    if made is not None:
        return ComposedEngine(made, directions)
    return _interpreter(system, directions, exact)


@one_at_a_time
def _interpreter(system: System, directions: tuple[str, ...], exact: bool) -> VirtualMachine:
    return VirtualMachine(scheme(system, directions, exact))


def _pack(made: Scheme, dense: FloatArray) -> FloatArray:
    return np.ascontiguousarray(dense[made.rows, made.columns]) if dense.size else np.zeros(0)


def _unpack(made: Scheme, packed: FloatArray, states: int) -> FloatArray:
    dense = np.zeros((states, len(made.directions)))
    dense[made.rows, made.columns] = packed
    return dense


@final
class VirtualMachine:
    """CasADi's interpreter, mapped over the sub-steps."""

    compiled = False

    def __init__(self, made: Scheme) -> None:
        self._scheme = made
        self._chunks = {size: _accumulator(made.step, size) for size in _CHUNKS}

    def start(
        self, segment: Segment, parameters: FloatArray, deviation: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """States (n,) and their sensitivities (n, k) at rest, plus a deviation (n,)."""
        given = (parameters, segment.time[0], segment.drive[0], segment.channels[0], deviation)
        x, s = (out.full().ravel() for out in self._scheme.start(*given))
        return x, _unpack(self._scheme, s, x.size)

    def from_rest(
        self,
        segment: Segment,
        substeps: IntArray,
        parameters: FloatArray,
        deviation: FloatArray,
        *,
        states: bool = False,
        ceiling: Ceiling | None = None,
    ) -> Run:
        """Simulate from :meth:`start`."""
        begun = self.start(segment, parameters, deviation)
        return self.run(segment, substeps, parameters, *begun, states=states, ceiling=ceiling)

    def run(
        self,
        segment: Segment,
        substeps: IntArray,
        parameters: FloatArray,
        start: FloatArray,
        start_sensitivities: FloatArray,
        *,
        states: bool = False,
        ceiling: Ceiling | None = None,  # noqa: ARG002
    ) -> Run:
        """Simulate to the end, which the ceiling allows, too."""
        made = self._scheme
        n = start.size
        which = np.repeat(np.arange(substeps.size), substeps)
        ends = np.cumsum(substeps)
        within = np.arange(which.size) - np.repeat(ends - substeps, substeps)
        divide = np.maximum(substeps, 1)
        h, ht = segment.length / divide, segment.length_by_delay / divide

        def at(inside: NDArray[np.integer], index: NDArray[np.intp]) -> dict[str, FloatArray]:
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
            moving = at(within, which)
            rows = np.vstack([np.atleast_2d(moving[name]) for name in _MOVING])
            x_all, s_all = self._accumulate(rows, p, x0, s0)
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

    def _accumulate(
        self, rows: FloatArray, p: FloatArray, x0: FloatArray, s0: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """States and sensitivities after each column of ``rows``."""
        state, done, begin = np.concatenate([x0, s0]), [], 0
        while begin < rows.shape[1]:
            left = rows.shape[1] - begin
            size = next((c for c in _CHUNKS if c <= left), _CHUNKS[-1])
            part = rows[:, begin : begin + size]
            # The last chunk is filled up with repetitions, whose results are not read.
            filled = np.pad(part, ((0, 0), (0, size - part.shape[1])), mode="edge")
            out = self._chunks[size](state, filled, p).full()[:, : part.shape[1]]
            state = out[:, -1]
            done.append(out)
            begin += size
        out = np.hstack(done)
        return out[: x0.size], out[x0.size :]


_MOVING = ("h", "du", "dc", "hT", "t", "u", "c", "uT", "tT", "cT")
_CHUNKS = (512, 64)


def _accumulator(step: ca.Function, size: int) -> ca.Function:
    """``(xS, moving (m, size), p) -> xS (., size)`` after each of ``size`` sub-steps."""
    symbols = {name: ca.SX.sym(name, step.size_in(name)[0]) for name in step.name_in()}
    both = ca.SX.sym("xS", symbols["x"].numel() + symbols["S"].numel())
    split = [symbols["x"].numel()]
    named = symbols | {"x": both[: split[0]], "S": both[split[0] :]}
    moving = ca.vertcat(*(symbols[name] for name in _MOVING))
    after = ca.vertcat(*step(*(named[name] for name in step.name_in())))
    one = ca.Function("po_one", [both, moving, symbols["p"]], [after])
    many = one.mapaccum("po_many", size)
    first, columns, p = ca.MX.sym("xS", both.numel()), ca.MX.sym("m", moving.numel(), size), None
    p = ca.MX.sym("p", symbols["p"].numel())
    return ca.Function(
        "po_chunk", [first, columns, p], [many(first, columns, ca.repmat(p, 1, size))]
    )


def _map(
    reading: ca.Function, count: int, p: FloatArray, inputs: dict[str, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    # A column is the same for every reading, so CasADi repeats it.
    given = {**{n: np.atleast_2d(a) for n, a in inputs.items()}, "p": p[:, None]}
    y, j = reading.call([ca.DM(given[n]) for n in reading.name_in()])
    return y.full(), j.full().reshape(-1, count)
