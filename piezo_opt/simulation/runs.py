"""What a run of a scheme is told and what it returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Ceiling:
    """How far readings may miss a measurement before nobody wants to know the rest of them.

    Attributes:
        measured: (N,) [m]; what is NaN does not count.
        squares: sum of the squares of the readings minus it [m^2], from which on a run may be
            given up.
    """

    measured: FloatArray
    squares: float


@final
@dataclass(frozen=True, eq=False)
class Run:
    """What a run returns.

    Attributes:
        reading: (N,) [m]; NaN from where it was given up, and nothing else of the run means
            anything then.
        sensitivities: (N, k) derivative of the reading by each direction.
        states: (N, n) at the readings, None unless asked for.
        last: (n,) states at the end.
        last_sensitivities: (n, k) derivative of the last states by each direction.
    """

    reading: FloatArray
    sensitivities: FloatArray
    states: FloatArray | None
    last: FloatArray
    last_sensitivities: FloatArray
