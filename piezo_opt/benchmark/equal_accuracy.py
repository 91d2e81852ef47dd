"""The best scheme beside Runge-Kutta by hand at equal accuracy, by how fast the resonance is.

A resonance is linear: where it is moved by its exponential, only what is not linear decides how
short a sub-step is. Runge-Kutta has to follow every swing, and is unstable where a sub-step is
longer than 2.8 / omega (Hairer & Wanner 1996, Solving Ordinary Differential Equations II, IV.2).
So the ratio follows from the resonance over the sampling rate, and this measures it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.alternatives import EQUAL, MODEL, by_hand, ours
from piezo_opt.benchmark.table import table
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Substeps
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]
Way = Callable[[int], Callable[[], FloatArray]]

RATIOS: Final = (0.04, 0.2, 1.0, 2.0, 4.0, 5.0, 8.0, 16.0)
"""Natural frequencies over the sampling rate."""
_RATE: Final = 1e3
"""Samples a second [Hz]."""
_MOST: Final = 1024
"""Sub-steps a sample at most."""
_TRUTH: Final = 256
"""Sub-steps a sample of what errors are measured from."""


@final
@dataclass(frozen=True)
class Pace:
    """One resonance.

    Attributes:
        resonance: natural frequency over the sampling rate.
        substeps: sub-steps a sample at which the error is 1e-6 of the stroke at most: ours with
            the linear part exact, ours by Runge-Kutta, Runge-Kutta by hand.
        nanoseconds: for one sample, of the same.
    """

    resonance: float
    substeps: tuple[int, int, int]
    nanoseconds: tuple[float, float, float]

    @property
    def ratio(self) -> float:
        """Time by hand over that of the best of ours."""
        return self.nanoseconds[2] / min(self.nanoseconds[:2])


@final
@dataclass(frozen=True)
class EqualAccuracy:
    """All resonances.

    Attributes:
        paces: one by one.
        samples: of the record.
    """

    paces: tuple[Pace, ...]
    samples: int

    def to_dict(self) -> list[dict[str, Any]]:
        """Plain data."""
        return [{**p.__dict__, "ratio": p.ratio} for p in self.paces]

    def __str__(self) -> str:
        header = ("resonance/rate", "exact", "ns/sample", "Runge-Kutta", "ns/sample", "by hand",
                  "ns/sample", "times as fast")  # fmt: skip
        rows = [
            (f"{p.resonance:g}",
             *(cell for n, t in zip(p.substeps, p.nanoseconds, strict=True)
               for cell in (str(n), f"{t:.1f}")),
             f"{p.ratio:.1f}")
            for p in self.paces
        ]  # fmt: skip
        return (
            f"Sub-steps a sample at {EQUAL:g} of the stroke, and what they take:\n"
            f"{table(header, rows)}"
        )


def equal_accuracy(
    samples: int = 4000, repetitions: int = 9, ratios: Sequence[float] = RATIOS,
    progress: Callable[[str], object] = str,
) -> EqualAccuracy:  # fmt: skip
    """Find the fewest sub-steps of each scheme for each resonance, and what they take.

    Args:
        samples: of the record.
        repetitions: in turns; the fastest counts.
        ratios: natural frequencies over the sampling rate.
        progress: told what runs.

    Raises:
        PiezoOptError: there is no C compiler.
    """
    time = np.arange(samples) / _RATE
    drive = 75.0 + 75.0 * np.sin(2 * np.pi * time) * np.sin(2 * np.pi * 0.13 * time)
    record = Measurement(time=time, drive=drive, position=1e-7 * drive, name="pace")
    paces = []
    for ratio in ratios:
        progress(f"a resonance at {ratio:g} times the sampling rate")
        values = Values.nominal(MODEL).with_({"second_order.omega": 2 * np.pi * ratio * _RATE})
        truth = ours(record, values, Substeps(1.0 / _RATE / _TRUTH, 1e9, exact=True))()
        hand = by_hand(record, values, _RATE)
        ways = (_ours(record, values, True), _ours(record, values, False), hand)
        counts = [fewest(way, truth) for way in ways]
        runs = [way(n) for way, n in zip(ways, counts, strict=True)]
        least = [np.inf] * len(runs)
        for _ in range(repetitions):
            for i, run in enumerate(runs):
                begin = perf_counter()
                run()
                least[i] = min(least[i], (perf_counter() - begin) / samples * 1e9)
        paces.append(Pace(ratio, (counts[0], counts[1], counts[2]), (least[0], least[1], least[2])))
    return EqualAccuracy(tuple(paces), samples)


def _ours(record: Measurement, values: Values, exact: bool) -> Way:
    return lambda n: ours(record, values, Substeps(1.0 / _RATE / n, 1e9, exact=exact))


def fewest(way: Way, truth: FloatArray) -> int:
    """The fewest sub-steps a sample with which a way errs by :data:`EQUAL` at most.

    Doubled until they are enough, then halved towards those that are not.
    """
    stroke = float(np.ptp(truth))

    def enough(n: int) -> bool:
        with np.errstate(all="ignore"):
            return bool(np.abs(way(n)() - truth).max() <= EQUAL * stroke)

    high = 1
    while high < _MOST and not enough(high):
        high *= 2
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high
