"""One record, many sets of parameters: in lanes, on all cores."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import resources
from itertools import pairwise
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System, assemble, folded
from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError, ModelError
from piezo_opt.measurement import Measurement
from piezo_opt.simulation.accuracy import Substeps
from piezo_opt.simulation.compiler import load
from piezo_opt.simulation.lanes import RUN, WIDTH, source
from piezo_opt.simulation.library import origin
from piezo_opt.simulation.schedule import Segment
from piezo_opt.simulation.scheme import INITIAL
from piezo_opt.simulation.simulate import TOLERANCE, Initial, Simulator
from piezo_opt.symbolic import one_at_a_time
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

_WRITERS: Final = ("scheme.py", "lanes.py")
"""What a program in lanes follows from, beside what the library of effects follows from."""
_EXTREMES: Final = 12
"""Sets at which the sub-steps are chosen."""
_PIECES: Final = 4
"""Pieces of work for each thread: they need not take equally long."""


@final
@dataclass(frozen=True, eq=False)
class Many:
    """Simulated sets.

    Attributes:
        readings: (K, N) [m], a row a set; (0, N) where they were not wanted.
        squares: (K,) sum over the counted samples of the squared difference from the measured
            position [m^2].
        substeps: the same for all sets.
        lanes: sets side by side; 1 where every set was simulated by itself.
        threads: that shared the work.
    """

    readings: FloatArray
    squares: FloatArray
    substeps: Substeps
    lanes: int
    threads: int


def simulate_many(
    model: Model,
    values: Mapping[str, float | FloatArray],
    record: Measurement,
    *,
    initial: Initial = Initial.REST,
    tolerance: float = TOLERANCE,
    substeps: Substeps | None = None,
    readings: bool = True,
    threads: int | None = None,
) -> Many:
    """Simulate a model on a record's drive for K sets of parameters.

    Sets lie in lanes of a compiled program, as wide as the processor's vector registers, and pieces
    of them go to threads. Arrays are read where they are: nothing is copied. All sets share their
    sub-steps, the finest that any of the extreme ones needs; at these a set's numbers are those of
    :func:`simulate` to the last digits.

    Where there is no compiler, for a steady state, and where a delay differs from set to set, every
    set is simulated by itself, in threads.

    Args:
        model: a sum of effects.
        values: by name, SI: arrays (K,) of what differs, numbers for what does not; nominal where
            none is given. ``"initial." + state`` is a deviation from rest at the start.
        record: gives time, drive and channels, and the position that ``squares`` compares with.
        initial: rest or periodic steady state.
        tolerance: admissible error of the scheme as a share of the reading's range.
        substeps: given ones instead of chosen ones.
        readings: False keeps the sums of squares only: a million sets fit into memory.
        threads: all cores unless given.

    Raises:
        InputError: arrays of different lengths or shapes, none at all, or no finite simulation.
        ModelError: a name that the model does not have.
    """
    arrays, numbers, count = _sorted(model, values)
    threads = threads or os.cpu_count() or 1
    runtime = [n for n in arrays if n in model.parameters]
    at = _extreme(arrays, numbers, count)
    chosen = (
        _chosen(model, record, at, runtime, initial, tolerance) if substeps is None else substeps
    )
    simulator = Simulator(model, record, at[0], runtime=runtime, initial=initial, substeps=chosen)
    delays = {simulator.segment(one).length.tobytes() for one in at}
    library = None
    if initial is Initial.REST and len(delays) == 1 and not chosen.exact:
        system = assemble(model, folded(model, [*runtime, *_moved(model, at[0])]))
        library = _library(system)
    if library is None:
        return _one_by_one(simulator, arrays, numbers, count, readings, threads)
    segment = simulator.segment(at[0])
    return _in_lanes(
        library, system, segment, record, arrays, numbers, count, chosen, readings, threads
    )


def _sorted(
    model: Model, values: Mapping[str, float | FloatArray]
) -> tuple[dict[str, FloatArray], dict[str, float], int]:
    """What differs from set to set, what does not, and how many sets there are."""
    arrays: dict[str, FloatArray] = {}
    numbers: dict[str, float] = dict(Values.nominal(model))
    for name, value in values.items():
        if name not in model.parameters and not name.startswith(INITIAL):
            raise ModelError(
                f"simulate_many: the model has no parameter '{name}'; it has "
                f"{', '.join(model.parameters)}."
            )
        if np.ndim(value) == 0:
            numbers[name] = float(value)
            continue
        array = np.asarray(value, dtype=np.float64)
        if array.ndim != 1 or array.size == 0 or not np.isfinite(array).all():
            raise InputError(
                f"simulate_many: '{name}' has shape {array.shape}; give finite numbers in one row, "
                "one a set."
            )
        arrays[name] = array
        numbers.pop(name, None)
    sizes = {array.size for array in arrays.values()}
    if len(sizes) != 1:
        told = ", ".join(f"{name}: {array.size}" for name, array in arrays.items()) or "none"
        raise InputError(
            f"simulate_many: give at least one parameter as an array, and all of one length; these "
            f"are: {told}."
        )
    return arrays, numbers, sizes.pop()


def _of(
    arrays: Mapping[str, FloatArray], numbers: Mapping[str, float], index: int
) -> dict[str, float]:
    """One set by name."""
    return {**numbers, **{name: float(array[index]) for name, array in arrays.items()}}


def _moved(model: Model, values: Mapping[str, float]) -> list[str]:
    return [k for k, v in folded(model).items() if values.get(k, v) != v]


def _extreme(
    arrays: Mapping[str, FloatArray], numbers: Mapping[str, float], count: int
) -> list[dict[str, float]]:
    """The first set, and those in which something is smallest or largest."""
    found = dict.fromkeys([0, count - 1])
    for array in arrays.values():
        found.update(dict.fromkeys((int(array.argmin()), int(array.argmax()))))
    return [_of(arrays, numbers, index) for index in list(found)[:_EXTREMES]]


def _chosen(
    model: Model,
    record: Measurement,
    at: Sequence[Mapping[str, float]],
    runtime: Sequence[str],
    initial: Initial,
    tolerance: float,
) -> Substeps:
    """Sub-steps that are fine enough for all of some sets."""
    simulator = Simulator(
        model, record, at[0], runtime=runtime, initial=initial, tolerance=tolerance
    )
    found = simulator.accuracy.substeps
    for one in at[1:]:
        other = simulator.choose(one, tolerance).substeps
        found = replace(
            found,
            longest=min(found.longest, other.longest),
            largest_move=min(found.largest_move, other.largest_move),
            farthest=min(found.farthest, other.farthest),
            times=max(found.times, other.times),
        )
    return found


@lru_cache(maxsize=256)
def _library(system: System) -> ctypes.CDLL | None:
    """The compiled program of a system; None where there is none."""
    recipe = "\n".join((system.recipe, "lanes", _writers()))
    try:
        return load(recipe, lambda _: _source(system))
    except NotImplementedError:
        return None


@one_at_a_time
def _source(system: System) -> str:
    return source(system)


@cache
def _writers() -> str:
    here = resources.files(__package__)
    return "\n".join((origin(), *(here.joinpath(name).read_text() for name in _WRITERS)))


@final
class _Columns:
    """Where the program finds a number for each set: addresses, and steps of 0 or more."""

    def __init__(
        self,
        names: Sequence[str],
        arrays: Mapping[str, FloatArray],
        numbers: Mapping[str, float],
        default: float | None,
    ) -> None:
        self._held: list[FloatArray] = []
        self.addresses = (ctypes.c_void_p * max(1, len(names)))()
        self.steps = (ctypes.c_long * max(1, len(names)))()
        for i, name in enumerate(names):
            array = arrays.get(name)
            if array is None:
                number = numbers[name] if default is None else numbers.get(name, default)
                array = np.array([number])
                self.steps[i] = 0
            else:
                self.steps[i] = array.strides[0] // array.itemsize
            self._held.append(array)
            self.addresses[i] = array.ctypes.data


def _in_lanes(
    library: ctypes.CDLL,
    system: System,
    segment: Segment,
    record: Measurement,
    arrays: Mapping[str, FloatArray],
    numbers: Mapping[str, float],
    count: int,
    substeps: Substeps,
    readings: bool,
    threads: int,
) -> Many:
    run = getattr(library, RUN)
    run.restype = None
    pointer, whole = ctypes.c_void_p, ctypes.c_long
    run.argtypes = [whole, whole, whole, *[pointer] * 12, whole, *[pointer] * 3]
    cut = substeps.of(segment)
    p = _Columns(system.parameter_names, arrays, numbers, None)
    d = _Columns([INITIAL + n for n in system.state_names], arrays, numbers, 0.0)
    measured = np.where(record.counted, record.position, np.nan)
    y = np.empty((count if readings else 0, segment.readings))
    squares = np.empty(count)
    at = segment.addresses

    def piece(first: int, sets: int) -> None:
        run(
            first, sets, segment.length.size, at.length, cut.ctypes.data, at.time, at.drive,
            at.slope, at.channels, at.channel_slopes, at.reading, p.addresses, p.steps,
            d.addresses, d.steps, y.shape[1], y.ctypes.data if readings else None,
            measured.ctypes.data, squares.ctypes.data,
        )  # fmt: skip

    blocks = -(-count // WIDTH)
    pieces = min(blocks, _PIECES * threads)
    ends = [min(count, WIDTH * (blocks * i // pieces)) for i in range(pieces)] + [count]
    threads = min(threads, pieces)
    with ThreadPoolExecutor(threads) as pool:
        for done in [pool.submit(piece, a, b - a) for a, b in pairwise(ends)]:
            done.result()
    return Many(y, squares, substeps, WIDTH, threads)


def _one_by_one(
    simulator: Simulator,
    arrays: Mapping[str, FloatArray],
    numbers: Mapping[str, float],
    count: int,
    readings: bool,
    threads: int,
) -> Many:
    record = simulator.record
    y = np.empty((count if readings else 0, len(record)))
    squares = np.empty(count)

    def one(index: int) -> None:
        reading = simulator.reading(_of(arrays, numbers, index))
        if readings:
            y[index] = reading
        with np.errstate(over="ignore"):
            squares[index] = np.sum((reading - record.position)[record.counted] ** 2)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(one, range(count)))
    return Many(y, squares, simulator.accuracy.substeps, 1, threads)
