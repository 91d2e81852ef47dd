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
    # What is an array and nothing more needs no masked arrays, which take a while to load.
    special = isinstance(values, np.ndarray) and type(values) is not np.ndarray
    if special and isinstance(values, np.ma.MaskedArray) and np.ma.getmaskarray(values).any():
        many = int(np.ma.getmaskarray(values).sum())
        raise InputError(
            f"{record}: {channel} has {many} masked values: remove those samples, or fill them and "
            "say left_out=mask where they are readings"
        )
    try:
        given = np.asarray(values)
        if given.dtype.kind in "cMm":
            raise InputError(
                f"{record}: {channel} is of the kind {given.dtype}, which is no real number: give "
                "the real part, or seconds"
            )
        array = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
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
