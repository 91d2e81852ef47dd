"""A finite box around the start, for solvers that search a region."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.identification.objective import Objective

FloatArray = NDArray[np.float64]

_REACH = 3.0
"""Sizes by which the box reaches to either side of the start, where the bounds allow it."""
_DECADES = 1.0
"""Decades by which it reaches, for a quantity that cannot be 0 or negative."""


@final
@dataclass(frozen=True, eq=False)
class Box:
    """The unit cube laid over a finite region of the unknowns.

    A declared bound says what is possible, not what is likely: a box over all of it would be
    mostly empty. Unknowns that must be positive are spread by ratio, the others evenly.

    Attributes:
        low, high: corners in SI units, within the bounds.
        by_ratio: which unknowns are spread logarithmically.
    """

    low: FloatArray
    high: FloatArray
    by_ratio: NDArray[np.bool_]

    @staticmethod
    def around(objective: Objective, start: FloatArray) -> Box:
        """The box that belongs to a start within the bounds."""
        unknowns = objective.unknowns
        low, high = unknowns.low, unknowns.high
        by_ratio = (low > 0) & (start > 0)
        size = _REACH * np.maximum(np.abs(start), unknowns.scale)
        ratio = 10.0**_DECADES
        lower = np.where(by_ratio, start / ratio, start - size)
        upper = np.where(by_ratio, start * ratio, start + size)
        return Box(np.maximum(low, lower), np.minimum(high, upper), by_ratio)

    def outside(self, inside: FloatArray) -> FloatArray:
        """SI values of a point of the unit cube."""
        cube = np.clip(inside, 0.0, 1.0)
        even = self.low + cube * (self.high - self.low)
        safe_low = np.where(self.by_ratio, self.low, 1.0)
        safe_high = np.where(self.by_ratio, self.high, 1.0)
        spread = safe_low * (safe_high / safe_low) ** cube
        return np.clip(np.where(self.by_ratio, spread, even), self.low, self.high)

    def inside(self, theta: FloatArray) -> FloatArray:
        """The point of the unit cube that belongs to SI values."""
        held = np.clip(theta, self.low, self.high)
        even = (held - self.low) / (self.high - self.low)
        safe_low = np.where(self.by_ratio, self.low, 1.0)
        safe_high = np.where(self.by_ratio, self.high, 2.0)
        spread = np.log(np.where(self.by_ratio, held, 1.0) / safe_low) / np.log(
            safe_high / safe_low
        )
        return np.clip(np.where(self.by_ratio, spread, even), 0.0, 1.0)
