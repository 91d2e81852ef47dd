"""Running a model that is composed of compiled functions (see ``core.c``)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate
from typing import Any, Final, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.errors import ModelError
from piezo_opt.simulation.compose import Composition, NotComposable, Operation, compose
from piezo_opt.simulation.exponential import reach
from piezo_opt.simulation.library import (
    GENERIC,
    MACHINE,
    Address,
    Functions,
    Library,
    catalogue,
    functions_of,
)
from piezo_opt.simulation.memory import give_back
from piezo_opt.simulation.runs import Ceiling, Run
from piezo_opt.simulation.schedule import Addresses, Segment
from piezo_opt.simulation.scheme import INITIAL

_Array = TypeVar("_Array", bound=NDArray[Any])

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

_LISTS: Final = ("once", "weigh", "driven", "stage", "reading", "jump", "start")
_WHOLE: Final = ctypes.c_int64
_POINTER: Final = ctypes.c_void_p
_BYTE: Final = ctypes.c_char
_OTHER_CODE: Final = 2
"""What ``po_run`` returns where the machine code is for other sensitivities at the start."""


class _List(ctypes.Structure):
    _fields_ = [("first", _WHOLE), ("count", _WHOLE)]


class _Plan(ctypes.Structure):
    """``po_plan`` in ``core.c``."""

    _fields_ = [
        *((name, _POINTER) for name in (
            "operations", "slots", "constants", "constant", "moving", "rates", "jumping", "after",
            "ends", "blocks",
        )),
        *((name, _List) for name in _LISTS),
        *((name, _WHOLE) for name in (
            "count", "n_slots", "kept_plain", "kept_moved", "states", "parameters", "channels",
            "n_constants", "n_moving", "n_jumping", "n_ends", "n_blocks", "n_weights", "time",
            "drive", "slope", "channel", "channel_slope", "state", "parameter", "deviation",
            "length", "weights", "read",
        )),
    ]  # fmt: skip


class _Wanted(ctypes.Structure):
    _fields_ = [
        ("p", _POINTER), ("moves", _POINTER), ("clocks", _POINTER), ("d", ctypes.c_long),
        *((name, _POINTER) for name in ("x", "s", "y", "j", "xo", "m")), ("most", ctypes.c_double),
        ("code", _POINTER), ("at", _POINTER), ("begins", _POINTER),
    ]  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class Program:
    """A composed model, ready to run: the plan, and the arrays that it points to."""

    system: System
    composition: Composition
    plan: _Plan
    core: ctypes.CDLL
    held: tuple[Any, ...]

    @property
    def blocks(self) -> int:
        """Number of linear blocks."""
        return len(self.composition.blocks)

    def matrix(self, parameters: FloatArray) -> FloatArray:
        """The linear blocks L (n, n) [1/s]."""
        nowhere = np.zeros(
            (0, 3 + 2 * len(self.system.channel_names) + len(self.system.state_names))
        )
        return self._slopes(parameters, nowhere)[0]

    def slopes(self, instants: FloatArray, parameters: FloatArray) -> FloatArray:
        """Derivatives (m, n, n) [1/s] of the rates less their linear blocks by the states."""
        return self._slopes(parameters, np.ascontiguousarray(instants, dtype=float))[1]

    def _slopes(
        self, parameters: FloatArray, instants: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        n, m = len(self.system.state_names), instants.shape[0]
        checked(instants, m, 3 + 2 * len(self.system.channel_names) + n)
        matrix, slopes = np.zeros((n, n)), np.empty((m, n, n))
        p = np.ascontiguousarray(parameters, dtype=float)
        enough(self.core.po_slopes(
            ctypes.byref(self.plan), m, address(instants), address(p), address(matrix),
            address(slopes),
        ))  # fmt: skip
        return matrix, slopes

    def longest(self, parameters: FloatArray) -> float:
        """The longest sub-step [s] over which the blocks are as good as exact."""
        blocks = [(block.states, block.heard) for block in self.composition.blocks]
        return reach(self.matrix(parameters), blocks) if blocks else np.inf

    def at_rest(
        self, time: float, drive: float, channels: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """States (n,) at rest."""
        return self.start(np.array([time, drive, *channels]), parameters, None, None)[0]

    def start(
        self,
        at: FloatArray,
        parameters: FloatArray,
        deviation: FloatArray | None,
        begins: IntArray | None,
    ) -> tuple[FloatArray, FloatArray]:
        """States (n,) at rest plus a deviation, and their derivatives by directions (n, k).

        Args:
            at: (2 + c,) time, drive and channels.
            parameters: of the model.
            deviation: (n,), none unless given.
            begins: slot that each direction moves, none unless given.
        """
        system = self.system
        n, k = len(system.state_names), 0 if begins is None else begins.size
        # One behind the other: asking for the address of each takes longer than the start itself.
        sizes = 2 + len(system.channel_names), len(system.parameter_names), n, n, n * k
        _, p, d, x, s, end = accumulate((0, *sizes))
        numbers = np.zeros(end)
        numbers[:p] = checked(at, sizes[0])
        numbers[p:d] = checked(parameters, sizes[1])
        if deviation is not None:
            numbers[d:x] = checked(deviation, n)
        here = address(numbers)
        moved = None if begins is None else address(begins)
        enough(self.core.po_start(
            ctypes.byref(self.plan), here, here + 8, here + 16, here + 8 * p, here + 8 * d,
            moved, k, here + 8 * x, here + 8 * s,
        ))  # fmt: skip
        return numbers[x:s], numbers[s:].reshape(n, k)

    @property
    def delay(self) -> Callable[[FloatArray], float] | None:
        """How much the chain lags at given parameters [s]; None without a delay."""
        constant = self.composition.delay
        if constant is None:
            return None
        places = [self.system.parameter_names.index(n) for n in self.composition.clocks]
        return lambda parameters: constant + float(sum(parameters[i] for i in places))


def program(system: System, exact: bool) -> Program | None:
    """A model composed of compiled functions; None where it cannot be."""
    library = catalogue()
    return None if library is None else _program(system, exact, library)


@lru_cache(maxsize=4096)
def _program(system: System, exact: bool, library: Library) -> Program | None:
    found: dict[str, Functions] = {}
    try:
        for name, effect in system.model:
            runtime = frozenset(
                k for k, p in effect.parameters.items()
                if system.constants.get(f"{name}.{k}") != p.nominal
            )  # fmt: skip
            functions = functions_of(effect, runtime)
            if functions is None:
                return None
            found[name] = functions
        composition = compose(system, {n: f.form for n, f in found.items()}, exact)
    except (NotComposable, ModelError, NotImplementedError):
        return None  # the virtual machine does it, or the assembler says what is wrong
    addresses = {symbol: pair for f in found.values() for symbol, pair in f.addresses.items()}
    kept = {p.symbol: p.kept for f in found.values() for p in f.form.parts.values()}
    return _planned(system, composition, addresses, kept, library, found)


def _planned(
    system: System,
    composition: Composition,
    addresses: Mapping[str, tuple[Address, Address]],
    kept_by: Mapping[str, tuple[int, int]],
    library: Library,
    held: object,
) -> Program:
    give_back()
    core = library.loaded
    nothing = _address(core, "po_nothing")
    rows: list[tuple[int, ...]] = []
    slots: list[int] = []
    plain_numbers = moved_numbers = 0
    bounds = {}
    for name in _LISTS:
        operations: Sequence[Operation] = composition.lists[name]
        bounds[name] = _List(len(rows), len(operations))
        for one in operations:
            if one.symbol in GENERIC:
                itself = (nothing, _address(core, one.symbol), 0)
                pair, kept = (itself, itself), (0, 0)
            elif one.symbol in addresses:
                pair, kept = addresses[one.symbol], kept_by[one.symbol]
            else:
                pair, kept = library.address(one.symbol), (0, 0)
            (prepare, plain, words), (prepare_too, moved, words_too) = pair
            rows.append((
                prepare, plain, prepare_too, moved, words, words_too, len(slots), one.inputs,
                plain_numbers, moved_numbers,
            ))  # fmt: skip
            slots += one.slots
            plain_numbers += _WIDE * -(-kept[0] // _WIDE)
            moved_numbers += _WIDE * -(-kept[1] // _WIDE)
    state = composition.first["state"]
    among = {i for block in composition.blocks for i in block.states}
    blocks = []
    weights = 0
    for block in composition.blocks:
        size = len(block.states)
        blocks.append((
            size, *_filled([state + i for i in block.states], 2),
            *_filled([composition.rates[i] for i in block.states], 2), *_filled(block.quiet, 2),
            *_filled(block.matrix, 4), weights, 1, block.followed,
        ))  # fmt: skip
        weights += 6 * size * size
    moving = [state + i for i in composition.rates if i not in among]
    rates = {state + i: slot for i, slot in composition.rates.items()}
    moving = _unread(moving, rates)
    ints = {
        "slots": slots, "constants": list(composition.constants), "moving": moving,
        "rates": [rates[slot] for slot in moving],
        "jumping": [state + i for i in composition.after],
        "after": list(composition.after.values()), "ends": list(composition.driven),
    }  # fmt: skip
    arrays: dict[str, NDArray[Any]] = {k: np.array(v, dtype=np.int32) for k, v in ints.items()}
    arrays["operations"] = np.array(rows, dtype=np.int64)
    arrays["blocks"] = np.array(blocks, dtype=np.int64)
    arrays["constant"] = np.array(list(composition.constants.values()), dtype=float)
    counts = {
        "count": composition.count, "kept_plain": plain_numbers, "kept_moved": moved_numbers,
        "states": len(system.state_names), "parameters": len(system.parameter_names),
        "channels": len(system.channel_names), "n_constants": len(composition.constants),
        "n_moving": len(moving), "n_slots": len(slots),
        "n_jumping": len(ints["jumping"]), "n_ends": len(ints["ends"]), "n_blocks": len(blocks),
        "n_weights": weights, "read": composition.read, **composition.first,
    }  # fmt: skip
    plan = _Plan(**{k: a.ctypes.data for k, a in arrays.items()}, **bounds, **counts)
    return Program(system, composition, plan, _typed(core), (arrays, held))


_WIDE: Final = 8
"""Numbers of a cache line."""


def _unread(moving: Sequence[int], rates: Mapping[int, int]) -> list[int]:
    """States in an order in which none is moved before it is read as the rate of another one.

    Raises:
        NotComposable: they are the rates of each other.
    """
    order: list[int] = []
    left = list(moving)
    while left:
        free = [one for one in left if all(rates[o] != one for o in left if o != one)]
        if not free:
            raise NotComposable("states are the rates of each other")
        order += free
        left = [one for one in left if one not in free]
    return order


def _filled(numbers: Sequence[int], size: int) -> list[int]:
    return [*numbers, *[0] * (size - len(numbers))]


def _address(core: ctypes.CDLL, symbol: str) -> int:
    return ctypes.cast(getattr(core, symbol), ctypes.c_void_p).value or 0


def _typed(core: ctypes.CDLL) -> ctypes.CDLL:
    core.po_run.argtypes = [_POINTER, ctypes.c_long, _POINTER, _POINTER]
    core.po_start.argtypes = [*[_POINTER] * 7, ctypes.c_long, *[_POINTER] * 2]
    core.po_slopes.argtypes = [_POINTER, ctypes.c_long, *[_POINTER] * 4]
    core.po_translate.argtypes = [*[_POINTER] * 3, ctypes.c_long, *[_POINTER] * 3]
    core.po_translate.restype = _POINTER
    core.po_suits.argtypes = [_POINTER, _POINTER, ctypes.c_long]
    core.po_release.argtypes = [_POINTER]
    core.po_release.restype = None
    return core


class _CodeFields(ctypes.Structure):
    """``po_code`` in ``core.c``."""

    _fields_ = [
        *((name, _POINTER) for name in ("step", "reading", "several", "memory", "groups")),
        *((name, _WHOLE) for name in ("count", "bytes", "spills", "states", "first")),
    ]


INSTRUCTION: Final = np.dtype(
    [("op", "i4"), ("detail", "i4"), ("inputs", "i4", 3), ("place", "i4"), ("by", "f8")]
)
"""``po_instruction`` in ``assembler.h``."""
_MOST: Final = 40_000


@final
class Code:
    """Machine code of a plan with its directions; the memory is given back with it."""

    def __init__(self, core: ctypes.CDLL, address: int) -> None:
        self.core = core
        self.address = address

    def suits(self, sensitivities: FloatArray) -> bool:
        """Whether it leaves out no sensitivity that is other than zero at the start."""
        where, k = address(sensitivities), sensitivities.shape[1]
        return bool(self.core.po_suits(self.address, where, k))

    def replace(self, step: int, reading: int, several: int) -> None:
        """Let other functions at these addresses do what it does."""
        fields = _CodeFields.from_address(self.address)
        fields.step, fields.reading, fields.several = step, reading, several

    def __del__(self) -> None:
        self.core.po_release(self.address)


@final
class ComposedEngine:
    """A composed model with its directions, called through ctypes (which releases the lock).

    Args:
        program: the composed model.
        directions: of the sensitivities.
        machine: whether machine code is made of the whole sub-step, where the processor has the
            instructions; without it the functions are called one by one.
    """

    compiled = True

    def __init__(self, program: Program, directions: Sequence[str], machine: bool = True) -> None:
        self._machine = machine and MACHINE
        self._codes: tuple[Code, ...] = ()
        self._program = program
        self._core = program.core
        self._plan = ctypes.byref(program.plan)
        system, first = program.system, program.composition.first
        places = {name: first["parameter"] + i for i, name in enumerate(system.parameter_names)}
        starts = {
            INITIAL + name: first["deviation"] + i for i, name in enumerate(system.state_names)
        }
        known = places | starts
        for name in directions:
            if name not in known:
                raise ModelError(
                    f"'{name}' is neither a free parameter nor an initial state of the model; "
                    f"parameters: {', '.join(system.parameter_names)}."
                )
        self._begins = np.array([known[n] for n in directions], dtype=np.int32)
        self._moves = np.array([places.get(n, -1) for n in directions], dtype=np.int32)
        clocks = np.array([n in program.composition.clocks for n in directions], dtype=np.int32)
        self._clocks = clocks if clocks.any() else None
        self._begins_at = address(self._begins)
        self._where = self._moves.ctypes.data, clocks.ctypes.data if clocks.any() else None
        self._shape = len(system.state_names), len(directions)
        self._parameters = len(system.parameter_names)

    def start(
        self, segment: Segment, parameters: FloatArray, deviation: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """States (n,) and their sensitivities (n, k) at rest, plus a deviation (n,)."""
        return self._program.start(segment.begins, parameters, deviation, self._begins)

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
        rest = np.concatenate([segment.begins, checked(deviation, self._shape[0])])
        if self._machine and not self._codes:
            self.code(self.start(segment, parameters, deviation)[1])
        x, s = np.empty(self._shape[0]), np.empty(self._shape)
        return self._through(segment, substeps, parameters, x, s, states, ceiling, rest)

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
        """Simulate."""
        x = np.array(checked(start, self._shape[0]), dtype=float)
        s = np.array(checked(start_sensitivities, *self._shape), dtype=float, order="C")
        return self._through(segment, substeps, parameters, x, s, states, ceiling)

    def _through(
        self,
        segment: Segment,
        substeps: IntArray,
        parameters: FloatArray,
        x: FloatArray,
        s: FloatArray,
        states: bool,
        ceiling: Ceiling | None,
        rest: FloatArray | None = None,
    ) -> Run:
        """Simulate from a state and its sensitivities, which become those at the end.

        With ``rest`` (time, drive, channels and deviation at the start) from there.
        """
        count, (n, k) = segment.readings, self._shape
        p = np.ascontiguousarray(checked(parameters, self._parameters), dtype=float)
        cut = np.ascontiguousarray(checked(substeps, segment.length.size), dtype=np.int32)
        y, j = np.full(count, np.nan), np.empty((count, k))
        xs = np.empty((count, n)) if states else None
        measured, most = None, np.inf
        if ceiling is not None:
            measured, most = checked(ceiling.measured, count), ceiling.squares
        code = self.code(s) if rest is None else next(iter(self._codes), None)
        along = Addresses.from_buffer_copy(segment.addresses)
        along.substeps = address(cut)
        wanted = _Wanted(
            address(p), *self._where, k, address(x), address(s), address(y),
            address(j), None if xs is None else address(xs),
            None if measured is None else address(measured), most,
            None if code is None else code.address,
            *(None, None) if rest is None else (address(rest), self._begins_at),
        )  # fmt: skip
        call = self._plan, segment.length.size, ctypes.byref(along), ctypes.byref(wanted)
        failed = self._core.po_run(*call)
        if failed == _OTHER_CODE:
            wanted.at, code = None, self.code(s)
            wanted.code = None if code is None else code.address
            failed = self._core.po_run(*call)
        enough(failed)
        return Run(y, j, xs, x, s)

    def code(self, s: FloatArray) -> Code | None:
        """Machine code for runs that start with such sensitivities; None where there is none."""
        for known in self._codes:
            if known.suits(s):
                return known
        found = None
        if self._machine:
            found = self._translated(s, None, None)
            if found is None:
                self._machine = False  # nor would there be any the next time
            else:
                self._codes = (*self._codes, found)  # replaced as a whole: threads may race
        return found

    def instructions(self, s: FloatArray) -> tuple[NDArray[Any], ...]:
        """What machine code for such runs does in a sub-step, to take a reading, and for several
        samples at once, if it does that.

        Raises:
            ModelError: this machine has none.
        """
        lists = [np.empty(_MOST, INSTRUCTION) for _ in range(3)]
        where, counts = (_POINTER * 3)(*(a.ctypes.data for a in lists)), (ctypes.c_int * 3)()
        if not self._machine or self._translated(s, where, counts) is None:
            raise ModelError("No machine code can be made of a model on this machine.")
        return tuple(one[:count] for one, count in zip(lists, counts, strict=True))

    def _translated(self, s: FloatArray, where: Any, counts: Any) -> Code | None:
        address = self._core.po_translate(
            self._plan, *self._where, self._shape[1], s.ctypes.data, where, counts,
        )  # fmt: skip
        return None if address is None else Code(self._core, address)


def address(array: NDArray[Any]) -> int:
    """Where the numbers of a contiguous array lie; nowhere if there are none.

    Asked a few hundred times a fit: through the buffer it takes a fifth of ``array.ctypes.data``.
    """
    if not array.size:
        return 0
    if not array.flags.writeable:
        return int(array.ctypes.data)
    return ctypes.addressof(_BYTE.from_buffer(array.data))


def enough(failed: int) -> None:
    if failed:
        raise MemoryError("the simulation finds no memory")


def checked(given: _Array, *shape: int) -> _Array:
    """An array of that shape: a C program reads as far as it is told.

    Raises:
        ValueError: it has another one.
    """
    if given.shape != shape:
        raise ValueError(f"numbers of shape {shape} are needed, not of shape {given.shape}")
    return given
