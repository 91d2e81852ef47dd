"""Counting, tracing, showing and stopping: what every solver reports to."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.identification.outcome import Evaluations, Trace

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Progress:
    """What a solver tells while it works.

    Attributes:
        iteration: its number, from 1.
        rms: root mean square of the residuals there [m].
        elapsed_s: seconds since the start.
        readings: modelled reading of each record there [m]; empty where the solver has none.
    """

    iteration: int
    rms: float
    elapsed_s: float
    readings: tuple[FloatArray, ...] = ()


ProgressCallback = Callable[[Progress], None]


@final
class Monitor:
    """Collects iterates and counts; remembers the best point, so an interrupt loses nothing."""

    def __init__(self, names: tuple[str, ...], callback: ProgressCallback | None = None) -> None:
        self._names = names
        self._callback = callback
        self._began = time.perf_counter()
        self._values: list[FloatArray] = []
        self._rms: list[float] = []
        self.simulations = 0
        self.with_sensitivities = 0
        self.best: FloatArray | None = None
        self.best_cost = np.inf

    def iterate(self, theta: FloatArray, rms: float, readings: tuple[FloatArray, ...] = ()) -> None:
        """Record one iterate and show it."""
        self._values.append(np.array(theta))
        self._rms.append(rms)
        if self._callback is not None:
            self._callback(Progress(len(self._rms), rms, self.elapsed_s, readings))

    def saw(self, theta: FloatArray, cost: float) -> None:
        """Remember the best of all evaluated points."""
        if cost < self.best_cost:
            self.best, self.best_cost = np.array(theta), cost

    @property
    def elapsed_s(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self._began

    @property
    def trace(self) -> Trace:
        """All iterates."""
        values = np.array(self._values).reshape(len(self._values), len(self._names))
        return Trace(self._names, values, np.array(self._rms))

    @property
    def evaluations(self) -> Evaluations:
        """Simulations spent so far."""
        return Evaluations(self.simulations, self.with_sensitivities)
