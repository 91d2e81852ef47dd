"""One signal of a record: an array of real numbers that nobody can write to any more."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError

FloatArray: TypeAlias = NDArray[np.float64]
ComplexArray: TypeAlias = NDArray[np.complex128]
BoolArray: TypeAlias = NDArray[np.bool_]
IndexArray: TypeAlias = NDArray[np.intp]


def frozen(values: object, channel: str, record: str) -> FloatArray:
    """A copy of the samples (N,) that is read-only.

    Raises:
        InputError: they are not numbers, or not one signal.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{record}: {channel} is not an array of numbers") from error
    if array.ndim != 1:
        raise InputError(
            f"{record}: {channel} has shape {array.shape}, expected (N,): give one signal"
        )
    array.flags.writeable = False
    return array
