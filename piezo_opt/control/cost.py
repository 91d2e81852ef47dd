"""What a loop costs, and how the cost changes with its error: exact, and smooth where it may be.

The error is taken as linear between samples. The integral of its absolute value over a period T
from a to b is then

    T (|a| + |b|) / 2                      where both have the same sign
    T (a^2 + b^2) / (2 (|a| + |b|))        where it crosses zero on the way

which has continuous derivatives wherever not both are zero: nothing is smoothed, and an optimiser
sees no corner.
"""

from __future__ import annotations

from enum import Enum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]


class Criterion(Enum):
    """What is made small: the integral of |e|, e^2, or t |e|."""

    IAE = "iae"
    ISE = "ise"
    ITAE = "itae"


def integral(
    criterion: Criterion, error: FloatArray, period: float
) -> tuple[float, FloatArray]:  # fmt: skip
    """A criterion of an error (N,) [m], and its derivatives (N,) by the samples."""
    a, b = error[:-1], error[1:]
    slope = np.zeros_like(error)
    if criterion is Criterion.ISE:
        # Of a line from a to b: T (a^2 + a b + b^2) / 3.
        value = period * float(np.sum(a * a + a * b + b * b)) / 3.0
        slope[:-1] += period * (2.0 * a + b) / 3.0
        slope[1:] += period * (a + 2.0 * b) / 3.0
        return value, slope
    weight = np.full(a.size, period)
    if criterion is Criterion.ITAE:
        weight = period * period * (np.arange(a.size) + 0.5)
    size = np.abs(a) + np.abs(b)
    crossing = a * b < 0.0
    safe = np.where(size > 0.0, size, 1.0)
    square = a * a + b * b
    value = float(np.sum(weight * np.where(crossing, square / (2.0 * safe), size / 2.0)))
    for part, to in ((a, slope[:-1]), (b, slope[1:])):
        crossed = part / safe - np.sign(part) * square / (2.0 * safe * safe)
        to += weight * np.where(crossing, crossed, np.sign(part) / 2.0)
    return value, slope


def variation(drive: FloatArray, rest: float) -> tuple[float, FloatArray]:
    """Sum of the squared moves of a drive (N,) from rest [V^2], and its derivatives."""
    moves = np.diff(drive, prepend=rest)
    slope = 2.0 * moves
    slope[:-1] -= 2.0 * moves[1:]
    return float(moves @ moves), slope
