"""When a record was sampled: its instants, how even they are, where they are interrupted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from piezo_opt.measurement.arrays import BoolArray, FloatArray

_NEAR = 5
"""Stamps before and after a wide interval, whose medians tell whether the clock went on late."""


@final
@dataclass(frozen=True, eq=False)
class Clock:
    """The instants of N samples.

    Args:
        time: (N,) instants [s], strictly increasing; the steps may differ.
    """

    time: FloatArray

    def __len__(self) -> int:
        return int(self.time.size)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def uniform(self) -> bool:
        """Whether every sample lies within 1 % of a step of an even grid."""
        even = np.linspace(self.time[0], self.time[-1], len(self))
        return bool(np.max(np.abs(self.time - even)) <= 0.01 * self.duration / (len(self) - 1))

    @cached_property
    def step(self) -> float:
        """Sampling interval [s]: the median one, or the exact one of a uniform record.

        Times printed with few digits make the median slightly wrong; over an even record the
        mean has no such error.
        """
        if self.uniform:
            return self.duration / (len(self) - 1)
        return float(np.median(np.diff(self.time)))

    @property
    def rate(self) -> float:
        """Samples a second [Hz]."""
        return 1.0 / self.step

    @cached_property
    def gaps(self) -> tuple[tuple[float, float], ...]:
        """(last instant before, first instant after) [s] of every interval over 1.5 steps.

        Where the next stamps make up for it, nothing was missing: the clock jitters.
        """
        intervals = np.diff(self.time)
        wide = np.flatnonzero(intervals > 1.5 * self.step)
        if wide.size == 0:
            return ()
        late = self.time - self.time[0] - self.step * np.arange(len(self))
        lasting = [
            i
            for i in wide
            if np.median(late[i + 1 : i + 1 + _NEAR])
            - np.median(late[max(0, i + 1 - _NEAR) : i + 1])
            > 0.5 * self.step
        ]
        return tuple((float(self.time[i]), float(self.time[i + 1])) for i in lasting)

    def after(self, startup: float) -> BoolArray:
        """(N,) mask of the samples from ``startup`` [s] after the first one on."""
        # Half a rounding error of slack, so that "40 s" means the sample printed as 40 s.
        mask: BoolArray = self.time >= self.time[0] + startup - 1e-9 * max(self.step, startup)
        mask.flags.writeable = False
        return mask
