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


def kept_mask(mask: object, size: int, record: str) -> BoolArray:
    """A read-only copy of a mask (N,) of samples; one that marks nothing fits any length.

    Raises:
        InputError: it is no mask of that length.
    """
    array = np.array(mask)
    if not array.any():
        array = np.zeros(size, dtype=np.bool_)
    if array.dtype != np.bool_ or array.shape != (size,):
        raise InputError(
            f"{record}: left_out is {array.dtype} of shape {array.shape}: give one True or False "
            f"for each of the {size} samples"
        )
    array.flags.writeable = False
    return array
