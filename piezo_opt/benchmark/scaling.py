"""How the time of a simulation grows: with the parameters differentiated by, and with the sets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Final, final

import numpy as np

from piezo_opt.benchmark.table import table
from piezo_opt.effects import BoucWen, Creep, Friction, Model, PiezoGain, SecondMode, SecondOrder
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Simulator, Substeps, simulate_many
from piezo_opt.values import Values

RATE: Final = 1e4
"""Samples a second [Hz]."""
MODEL: Final[Model] = PiezoGain() + BoucWen() + Creep() + SecondOrder() + SecondMode() + Friction()
_RESONANCES: Final = {
    "second_order.omega": 2.0 * np.pi * 400.0, "second_mode.omega": 2.0 * np.pi * 900.0,
}  # fmt: skip
_CUT: Final = Substeps(1.0 / RATE, 1e9)
"""One sub-step a sample."""
SETS: Final = (1, 16, 128, 1024, 8192)


@final
@dataclass(frozen=True)
class Scaling:
    """Nanoseconds for one sample of one set.

    Attributes:
        directions: by the number of parameters differentiated by.
        sets: by the number of sets, in lanes on one core.
        alone: a set by itself, as ``simulate`` does.
    """

    directions: Mapping[int, float]
    sets: Mapping[int, float]
    alone: float

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "directions": {str(k): ns for k, ns in self.directions.items()},
            "sets": {str(k): ns for k, ns in self.sets.items()}, "alone": self.alone,
        }  # fmt: skip

    def __str__(self) -> str:
        first = self.directions[0]
        by = [(str(k), f"{ns:.1f}", f"{ns / first:.2f}") for k, ns in self.directions.items()]
        sets = [(str(k), f"{ns:.2f}", f"{self.alone / ns:.1f}") for k, ns in self.sets.items()]
        return "\n\n".join((
            table(("derivatives", "ns/sample", "over none"), by),
            table(("sets", "ns/sample and set", "times as fast as one by one"), sets),
        ))  # fmt: skip


def measure_scaling(
    samples: int = 8000, repetitions: int = 15, sets: Sequence[int] = SETS,
    progress: Callable[[str], object] = str,
) -> Scaling:  # fmt: skip
    """Simulate one model of six effects with ever more derivatives, and for ever more sets.

    Args:
        samples: of the record; sets run on an eighth of it.
        repetitions: of each; the fastest counts.
        sets: numbers of sets.
        progress: told what runs.
    """
    record, values = _record(samples), Values.nominal(MODEL).with_(_RESONANCES)
    free = tuple(n for n, p in MODEL.parameters.items() if not p.fixed)
    counts = [k for k in (0, 1, 2, 4, 8) if k < len(free)] + [len(free)]
    progress("derivatives")
    simulators = [
        Simulator(MODEL, record, values, directions=free[:k], substeps=_CUT) for k in counts
    ]
    runs = [
        _run(simulator, values, k > 0) for simulator, k in zip(simulators, counts, strict=True)
    ]  # fmt: skip
    by = [t / samples for t in fastest(runs, repetitions)]
    brief = _record(samples // 8)
    alone = Simulator(MODEL, brief, values, substeps=_CUT)
    generator = np.random.default_rng(0)
    many = []
    for count in sets:
        progress(f"{count} sets")
        arrays = {n: values[n] * generator.uniform(0.95, 1.05, count) for n in free}
        many.append(_batch(arrays, brief, values))
    *took, single = fastest([*many, lambda: alone.reading(values)], max(3, repetitions // 3))
    per_set = [t / (len(brief) * k) for t, k in zip(took, sets, strict=True)]
    return Scaling(
        dict(zip(counts, by, strict=True)), dict(zip(sets, per_set, strict=True)),
        single / len(brief),
    )  # fmt: skip


def _run(simulator: Simulator, values: Values, moved: bool) -> Callable[[], object]:
    return lambda: simulator.with_sensitivities(values) if moved else simulator.reading(values)


def _batch(arrays: Mapping[str, Any], record: Measurement, values: Values) -> Callable[[], object]:
    given = {**values, **arrays}
    return lambda: simulate_many(MODEL, given, record, substeps=_CUT, readings=False, threads=1)


def fastest(runs: Sequence[Callable[[], object]], repetitions: int) -> list[float]:
    """Nanoseconds of each, the fastest of repetitions in turns; once before to warm up."""
    best = [np.inf] * len(runs)
    for repetition in range(repetitions + 1):
        for i, run in enumerate(runs):
            begin = perf_counter()
            run()
            if repetition:
                best[i] = min(best[i], 1e9 * (perf_counter() - begin))
    return best


def _record(samples: int) -> Measurement:
    time = np.arange(samples) / RATE
    drive = 75.0 + 75.0 * np.sin(2 * np.pi * 10.0 * time) * np.sin(2 * np.pi * 1.3 * time)
    return Measurement(time=time, drive=drive, position=1e-7 * drive, name="scaling")
