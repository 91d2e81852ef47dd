"""What a least-squares solver is: an object with choices, and one method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.identification.objective import Linearised, Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.simulation import Accuracy

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solver ended, how, and a sentence of why."""

    theta: FloatArray
    ending: Ending
    sentence: str
    accuracy: tuple[Accuracy, ...] = ()
    """Sub-steps of each record that were enough at the end; empty where nobody looked."""
    point: Linearised | None = None
    """Residual and Jacobian at ``theta`` on those sub-steps, where they are known."""
    promised: float | None = None
    """Share of the cost that a full Gauss-Newton step would leave, were the reading linear; None
    where nobody asked."""


class ResidualSolver(Protocol):
    """Minimises the objective of single shooting."""

    @property
    def name(self) -> str:
        """Name in tables."""

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum; reports to ``objective.monitor``."""
