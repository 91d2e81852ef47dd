"""What a data sheet says of a parameter, before anything was measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.errors import InputError


@final
@dataclass(frozen=True)
class Expected:
    """A value with a standard deviation, in SI units, and where it comes from.

    Raises:
        InputError: the value is not finite, or the deviation not positive.
    """

    value: float
    std: float
    reason: str = ""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and 0.0 < self.std < np.inf):
            raise InputError(
                f"expected {self.value:g} +- {self.std:g}: give a finite value and a positive "
                "standard deviation"
            )

    @staticmethod
    def within(value: float, tolerance: float, reason: str = "") -> Expected:
        """A stated tolerance, a share of the value: anywhere in value (1 +- tolerance) alike.

            std = tolerance |value| / sqrt(3)

        Raises:
            InputError: the tolerance is not a positive share.

        Source: JCGM 100:2008 (GUM), 4.3.7, rectangular distribution.
        """
        if not 0.0 < tolerance < np.inf:
            raise InputError(f"tolerance is {tolerance:g}; give a positive share, 0.1 for 10 %")
        return Expected(value, tolerance * abs(value) / float(np.sqrt(3.0)), reason)
