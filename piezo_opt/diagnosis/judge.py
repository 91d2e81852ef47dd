"""What a fit predicts of data that it has not seen: a record of the user's, or each block in turn.

Every sample is fitted. What a block of samples b would read without its own say follows from the
fit to all of them, exactly for a linear model,

    e_b = r_b + Q_b (I - Q_b' Q_b)^-1 Q_b' r_b

with r the residual and Q an orthonormal basis of its Jacobian. Where an eigenvalue of Q_b' Q_b is
one, only this block shows that direction (a late event, a state at the start): it is left alone.

Source: Cook & Weisberg (1982), Residuals and Influence in Regression, sec. 2.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit
from piezo_opt.measurement import Measurement
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

BLOCKS = 10
"""Of which each is predicted from the others: the usual number (Kohavi 1995, IJCAI 14, 1137)."""
_ALONE = 0.99
"""Eigenvalue from which a direction is seen by one block alone: the others know it ten times worse
than that block does."""


@final
@dataclass(frozen=True, eq=False)
class Judge:
    """Where fits are judged.

    Attributes:
        record: a record that is not fitted; None judges by blocks of those that are.
    """

    record: Measurement | None = None

    @property
    def sentence(self) -> str:
        """The choice in words."""
        if self.record is None:
            return (
                f"All data are fitted; held out: each of {BLOCKS} blocks as predicted from the "
                "others."
            )
        return f"Judged on the record '{self.record.name}', which is not fitted."

    def error(self, fit: Fit) -> float:
        """Error on what is judged on [m]; infinite where the fit cannot be simulated there."""
        try:
            if self.record is None:
                return _left_out(fit)
            error = (self.record.position - fit.predict(self.record, refine=False))[
                self.record.counted
            ]
        except (PiezoOptError, ArithmeticError):
            return math.inf
        return float(np.sqrt(np.mean(np.square(error)))) if np.isfinite(error).all() else math.inf


def worded(error: float | None) -> str:
    """A held-out error [m] in words; nothing where it is not known."""
    if error is None:
        return ""
    return show(error, "m") if math.isfinite(error) else "not finite"


def _left_out(fit: Fit) -> float:
    """Error of blocks, each as the others predict it [m]."""
    point = BasePoint(fit)
    total = 0.0
    for rows in np.array_split(np.arange(point.samples), BLOCKS):
        basis, residual = point.basis[rows], point.residual[rows]
        known, axes = np.linalg.eigh(basis.T @ basis)
        own = known < _ALONE
        lever = axes[:, own] / (1.0 - known[own]) @ (axes[:, own].T @ (basis.T @ residual))
        total += float(np.sum(np.square(residual + basis @ lever)))
    return float(np.sqrt(total / point.samples))
