"""How fast models are simulated, compared in one run on one machine.

Two measures that no composed model has a part in: loops written by hand for one model, with and
without derivatives (``by_hand.c``), and for every model the same instructions as one program of a
compiler (:mod:`.compiled_whole`). All take turns, and of each the fastest repetition counts, so
that what else the machine does falls on all of them alike.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from time import perf_counter
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import folded, named
from piezo_opt.benchmark.compiled_whole import compiled_whole
from piezo_opt.benchmark.table import table
from piezo_opt.effects import (
    BoucWen,
    Creep,
    Friction,
    Model,
    Offset,
    PiezoGain,
    SecondMode,
    SecondOrder,
    SensorLag,
)
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Identification, Start, objective, solve, starting
from piezo_opt.identification.solvers import levenberg_marquardt
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Simulator, Substeps, composed
from piezo_opt.simulation.compiler import load
from piezo_opt.simulation.library import catalogue
from piezo_opt.simulation.schedule import corners
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

SCHEMA: Final = "piezo_opt/speed/1"
RATE: Final = 1e4
"""Samples a second [Hz]."""
_CUT: Final = Substeps(1.0 / RATE, 1e9)
"""One sub-step a sample."""
_AGREE: Final = 1e-12
_BASE: Final = PiezoGain() + BoucWen()
MODELS: Final[tuple[Model, ...]] = (
    _BASE,
    _BASE + SecondOrder(),
    _BASE + Creep() + SecondOrder(),
    _BASE + Creep() + SecondOrder() + SensorLag(),
    _BASE + Creep() + SecondOrder() + SecondMode() + Friction(),
)
HAND: Final[Model] = _BASE + SecondOrder() + Offset()
"""The model that is written by hand, and fitted."""
_RESONANCES: Final = {
    "second_order.omega": 2.0 * np.pi * 400.0, "second_mode.omega": 2.0 * np.pi * 900.0,
}  # fmt: skip


@final
@dataclass(frozen=True)
class Pair:
    """A model's nanoseconds for one sample, ours and of what it is judged by.

    Attributes:
        name: the model.
        directions: derivatives that are simulated along.
        ours: the composed model.
        judge: the program that it is judged by.
    """

    name: str
    directions: int
    ours: float
    judge: float

    @property
    def ratio(self) -> float:
        """Ours over the judge's."""
        return self.ours / self.judge


@final
@dataclass(frozen=True)
class Library:
    """The library of all effects, in a process of its own with an empty cache.

    Attributes:
        seconds: wall time of building it.
        processor: processor time of the compiler [s].
        loaded_mb: largest memory of a process that has loaded it and simulated one model [MB].
    """

    seconds: float
    processor: float
    loaded_mb: float


@final
@dataclass(frozen=True)
class Speed:
    """What :func:`measure` found.

    Attributes:
        samples, repetitions: length of the record, and runs of each, in turns.
        whole: composed models beside programs compiled whole, without and with derivatives.
        hand: the model that is written by hand, without and with derivatives.
        first_ms: for each model from ``Model`` to its first reading, the library loaded [ms].
        fit_ms: a whole fit of 7 parameters, start values included [ms].
        fit_simulations: simulations with derivatives that it would pay for.
        fit_core, fit_algebra: shares of its time in the core's loop, and in the normal equations
            and steps; the rest is Python's.
        lengths: nanoseconds a sample with derivatives, by the record's length.
        peak_mb: largest memory of this process so far [MB].
        library: how it was built; None where that was not asked.
        disagreement: largest difference of ours and a judge's readings over the range.
    """

    samples: int
    repetitions: int
    whole: tuple[Pair, ...]
    hand: tuple[Pair, ...]
    first_ms: Mapping[str, float]
    fit_ms: float
    fit_simulations: float
    fit_core: float
    fit_algebra: float
    lengths: Mapping[int, float]
    peak_mb: float
    library: Library | None
    disagreement: float

    def to_dict(self) -> dict[str, Any]:
        """Plain data with a ``schema`` key."""

        def pairs(of: Sequence[Pair]) -> list[dict[str, Any]]:
            return [{**one.__dict__, "ratio": one.ratio} for one in of]

        return {
            "schema": SCHEMA, **self.__dict__, "whole": pairs(self.whole),
            "hand": pairs(self.hand), "first_ms": dict(self.first_ms),
            "lengths": {str(n): ns for n, ns in self.lengths.items()},
            "library": None if self.library is None else dict(self.library.__dict__),
        }  # fmt: skip

    def __str__(self) -> str:
        def told(of: Sequence[Pair], judge: str) -> str:
            header = ("model", "derivatives", "ns/sample", judge, "ratio")
            return table(header, [
                (p.name, str(p.directions), f"{p.ours:.1f}", f"{p.judge:.1f}", f"{p.ratio:.2f}")
                for p in of
            ])  # fmt: skip

        parts = [
            f"{self.samples} samples, one sub-step a sample, fastest of {self.repetitions}; "
            f"readings agree to {self.disagreement:.0e} of the range",
            told(self.whole, "compiled whole"), told(self.hand, "by hand"),
            table(("from Model to its first reading", "ms"),
                  [(n, f"{ms:.1f}") for n, ms in self.first_ms.items()]),
            f"A fit of 7 parameters takes {self.fit_ms:.1f} ms, as long as "
            f"{self.fit_simulations:.0f} simulations with derivatives: {self.fit_core:.0%} in the "
            f"core's loop, {self.fit_algebra:.0%} in normal equations and steps, "
            f"{1.0 - self.fit_core - self.fit_algebra:.0%} elsewhere.",
            table(("samples", "ns/sample with derivatives"),
                  [(f"{n:.0e}", f"{ns:.1f}") for n, ns in self.lengths.items()]),
            f"This process took {self.peak_mb:.0f} MB at most.",
        ]  # fmt: skip
        if self.library is not None:
            parts.append(
                f"The library of all effects took {self.library.seconds:.1f} s to build, "
                f"{self.library.processor:.1f} s of processor time; a process with it and one "
                f"simulated model takes {self.library.loaded_mb:.0f} MB."
            )
        return "\n\n".join(parts)


def measure(
    samples: int = 8000,
    repetitions: int = 15,
    lengths: Sequence[int] = (10_000, 100_000, 1_000_000),
    *,
    library: bool = True,
    progress: Callable[[str], object] = str,
) -> Speed:
    """Measure all of it.

    Args:
        samples: length of the record.
        repetitions: runs of each, in turns.
        lengths: of the records that show whether time is linear in samples.
        library: whether the library of all effects is built anew, in an empty folder.
        progress: told what is measured next.

    Raises:
        PiezoOptError: there is no C compiler, or the results do not agree.
        ModelError: this machine has no machine code for composed models.
    """
    record = _record(samples)
    simulate_once = Simulator(_BASE + Offset(), record, _values(_BASE + Offset()), substeps=_CUT)
    simulate_once.reading(_values(_BASE + Offset()))  # the library is loaded
    first_ms, pairs, off = {}, [], 0.0
    for model in MODELS:
        name = " + ".join(model.names)
        progress(name)
        first_ms[name] = _first(model, record)
        for directions in ((), _free(model)):
            ours, judge = (_engine(model, record, directions, whole) for whole in (False, True))
            off = max(off, _difference(ours()[0], judge()[0]))
            best = _fastest([ours, judge], repetitions, samples)
            pairs.append(Pair(name, len(directions), *best))
    progress("by hand")
    hand, more = _hand(record, repetitions)
    off = max(off, more)
    if not off <= _AGREE:
        raise PiezoOptError(f"Readings differ by {off:.1e} of the range: report it.")
    progress("fit")
    fit = _fit(samples, max(3, repetitions // 3))
    by_length = {}
    for length in lengths:
        progress(f"{length} samples")
        run = _engine(HAND, _record(length), _free(HAND), False)
        by_length[length] = _fastest([run], 3, length)[0]
    if library:
        progress("library")
    return Speed(
        samples, repetitions, tuple(pairs), hand, first_ms, *fit, by_length, _peak(),
        _built() if library else None, off,
    )  # fmt: skip


def _peak() -> float:
    """Largest memory of this process [MB]."""
    status = Path("/proc/self/status")
    if status.exists():  # what the system counts includes that of the process that started this one
        line = next(one for one in status.read_text().splitlines() if one.startswith("VmHWM"))
        return int(line.split()[1]) / 1024.0
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (1024.0**2 if sys.platform == "darwin" else 1024.0)


def _record(samples: int) -> Measurement:
    time = np.arange(samples) / RATE
    drive = 75.0 + 75.0 * np.sin(2 * np.pi * 10.0 * time) * np.sin(2 * np.pi * 1.3 * time)
    return Measurement(time=time, drive=drive, position=1e-7 * drive, name="speed")


def _values(model: Model) -> Values:
    nominal = Values.nominal(model)
    return nominal.with_({k: v for k, v in _RESONANCES.items() if k in nominal})


def _free(model: Model) -> tuple[str, ...]:
    return tuple(n for n, p in model.parameters.items() if not p.fixed)


def _first(model: Model, record: Measurement) -> float:
    """Milliseconds from a model that nobody has asked for to its first reading, best of three."""
    short, best = record.slice(None, float(record.time[10])), float("inf")
    for k in range(3):
        # With another nominal gain it is a model that nothing is remembered of.
        gain = PiezoGain(nominal=1e-7 * (1.0 + 0.1 * k))
        fresh = [gain if isinstance(one, PiezoGain) else one for _, one in model]
        begin = perf_counter()
        asked = Model.of(*fresh)
        values = _values(asked)
        Simulator(asked, short, values, substeps=_CUT).reading(values)
        best = min(best, 1e3 * (perf_counter() - begin))
    return best


def _engine(
    model: Model, record: Measurement, directions: tuple[str, ...], whole: bool
) -> Callable[[], tuple[FloatArray, FloatArray]]:
    """Runs a model, composed or compiled whole: readings and derivatives."""
    system, values = named(model, folded(model)), _values(model)
    made = composed.program(system, False)
    if made is None:
        raise PiezoOptError("The speed of compiled code needs a C compiler: install gcc or clang.")
    runner = composed.ComposedEngine(made, directions)
    p = values.vector(system.parameter_names)
    axis = corners(record, system.channel_names).sampled
    cut = _CUT.of(axis)
    x, s = runner.start(axis, p, np.zeros(len(system.state_names)))
    held = compiled_whole(runner, s) if whole else None

    def run(_: object = held) -> tuple[FloatArray, FloatArray]:
        done = runner.run(axis, cut, p, x, s)
        return done.reading, done.sensitivities

    return run


def _fastest(runs: Sequence[Callable[[], object]], repetitions: int, samples: int) -> list[float]:
    """Nanoseconds a sample of each, the fastest of repetitions in turns."""
    best = [float("inf")] * len(runs)
    for _ in range(repetitions):
        for i, run in enumerate(runs):
            begin = perf_counter()
            run()
            best[i] = min(best[i], (perf_counter() - begin) / samples * 1e9)
    return best


def _difference(found: FloatArray, expected: FloatArray) -> float:
    """Largest difference over the range of what is expected, column by column."""
    size = np.maximum(np.abs(expected).max(axis=0), np.finfo(float).tiny)
    return float((np.abs(found - expected).max(axis=0) / size).max(initial=0.0))


def _hand(record: Measurement, repetitions: int) -> tuple[tuple[Pair, ...], float]:
    text = resources.files(__package__).joinpath("by_hand.c").read_text()
    library = load(text)
    if library is None:
        raise PiezoOptError("The speed of compiled code needs a C compiler: install gcc or clang.")
    names = _free(HAND)
    p = _values(HAND).vector(names)
    drive = np.ascontiguousarray(record.drive)
    pointer = ctypes.c_void_p
    for function, more in ((library.po_run, 0), (library.po_run_moved, 1)):
        function.restype = None
        function.argtypes = [ctypes.c_long, ctypes.c_int, ctypes.c_double, *[pointer] * (3 + more)]

    def by_hand(function: Any, columns: int) -> Callable[[], tuple[FloatArray, FloatArray]]:
        def run() -> tuple[FloatArray, FloatArray]:
            y, j = np.empty(drive.size), np.empty((drive.size, columns))
            out = (y.ctypes.data, j.ctypes.data) if columns else (y.ctypes.data,)
            function(drive.size, 1, 1.0 / RATE, drive.ctypes.data, p.ctypes.data, *out)
            return y, j

        return run

    pairs, off = [], 0.0
    for directions, function in (((), library.po_run), (names, library.po_run_moved)):
        ours, judge = _engine(HAND, record, directions, False), by_hand(function, len(directions))
        (y, j), (y_hand, j_hand) = ours(), judge()
        off = max(off, _difference(y, y_hand), 1e-2 * _difference(j, j_hand))
        best = _fastest([ours, judge], repetitions, drive.size)
        pairs.append(Pair(" + ".join(HAND.names), len(directions), *best))
    return tuple(pairs), off


@contextmanager
def _watched(*places: tuple[Any, str]) -> Iterator[list[float]]:
    """Seconds that functions take as long as it lasts; they are put back at its end."""
    spent = [0.0] * len(places)
    known = [getattr(where, name) for where, name in places]

    def watch(i: int) -> Callable[..., Any]:
        def timed(*given: Any) -> Any:
            begin = perf_counter()
            try:
                return known[i](*given)
            finally:
                spent[i] += perf_counter() - begin

        return timed

    for i, (where, name) in enumerate(places):
        setattr(where, name, watch(i))
    try:
        yield spent
    finally:
        for (where, name), one in zip(places, known, strict=True):
            setattr(where, name, one)


def _shares(run: Callable[[], object], repetitions: int) -> tuple[float, float]:
    """Shares of a run's time in the core's loop, and in normal equations and steps; the median."""
    library = catalogue()
    if library is None:
        raise PiezoOptError("The speed of compiled code needs a C compiler: install gcc or clang.")
    shares = []
    places = (
        (library.loaded, "po_run"),
        (objective, "normal_equations"),
        (objective, "inner"),
        (levenberg_marquardt, "_step"),
        (starting, "_linear_step"),
    )
    for _ in range(repetitions):
        with _watched(*places) as spent:
            begin = perf_counter()
            run()
            whole = perf_counter() - begin
        shares.append((spent[0] / whole, sum(spent[1:]) / whole))
    core, steps = np.median(shares, axis=0).tolist()
    return core, steps


def _fit(samples: int, repetitions: int) -> tuple[float, float, float, float]:
    """Of a fit of the model that is written by hand.

    Milliseconds, simulations for the same, shares in the core's loop and in linear algebra.
    """
    record = _record(samples)
    truth = _values(HAND).with_({"second_order.omega": 2.0 * np.pi * 180.0})
    clean = Simulator(HAND, record, truth).reading(truth)
    noise = np.random.default_rng(1).normal(scale=2e-3 * float(np.ptp(clean)), size=samples)
    question = Identification(HAND, record.with_(position=clean + noise), start=Start.REST)
    fit = solve(question)
    one = Simulator(
        HAND, record, fit.values, directions=fit.names, substeps=fit.accuracy[0].substeps
    )
    whole, single = _fastest(
        [lambda: solve(question), lambda: one.with_sensitivities(fit.values)], repetitions, 1
    )
    return 1e-6 * whole, whole / single, *_shares(lambda: solve(question), repetitions)


_BUILD: Final = """
import json, resource, time
begin = time.perf_counter()
from piezo_opt.simulation.library import catalogue
assert catalogue() is not None
seconds = time.perf_counter() - begin
compiler = resource.getrusage(resource.RUSAGE_CHILDREN)
from piezo_opt.benchmark import speed
record = speed._record(8000)
speed._engine(speed.HAND, record, speed._free(speed.HAND), False)()
print(json.dumps([seconds, compiler.ru_utime + compiler.ru_stime, speed._peak()]))
"""


def _built() -> Library:
    """Build the library in an empty folder by a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        told = subprocess.run(
            [sys.executable, "-c", _BUILD], capture_output=True, text=True, check=True,
            env={**os.environ, "PIEZO_OPT_CACHE": folder},
        )  # fmt: skip
    return Library(*json.loads(told.stdout))
