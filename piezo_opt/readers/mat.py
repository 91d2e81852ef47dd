"""MATLAB files: version 5 to 7.2 through scipy, version 7.3 as the HDF5 file that it is.

MATLAB keeps no units, so the caller says them: ``drive="u [V]"``, ``position="y [um]"``; a
variable with an obvious name (t, time; u, v, voltage; y, x, displacement) is found without being
named only when its unit stands in a string variable beside it, as in ``u_unit = 'V'``.
Fields of a structure are called by their path, ``record.u``.
"""

from __future__ import annotations

import math
import os
import warnings
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy

from piezo_opt.errors import InputError
from piezo_opt.readers.columns import Column, Table
from piezo_opt.readers.files import checked, refuse_rows
from piezo_opt.readers.hdf5 import table_from_hdf5
from piezo_opt.readers.headers import known_unit
from piezo_opt.readers.mat_structure import check_structure


def table_from_mat(path: str | os.PathLike[str]) -> Table:
    """The vectors of a MATLAB file as columns; `InputError` for a damaged file."""
    file = checked(path)
    if h5py.is_hdf5(file):
        return table_from_hdf5(file)
    check_structure(file)
    variables = _flattened(_variables(file))
    columns: list[Column] = []
    for name, value in variables.items():
        if not _is_signal(value):
            continue
        refuse_rows(file, value.size)
        unit = variables.get(f"{name}_unit")
        if isinstance(unit, str):
            known_unit(str(file), name, unit)
        numbers = np.asarray(value, dtype=np.float64).reshape(-1)
        columns.append(Column(name, unit if isinstance(unit, str) else None, numbers))
    return Table(str(file), tuple(columns), lambda index: f"element {index + 1}")


def _variables(file: Path) -> dict[str, Any]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # Sizes first: a small compressed file can unfold to more than the memory holds.
            for _, shape, _ in scipy.io.whosmat(file):
                refuse_rows(file, math.prod(shape))
            return dict(scipy.io.loadmat(file, simplify_cells=True))
    except InputError:
        raise
    except Exception as error:  # a damaged file surfaces as any of the library's many errors
        raise InputError(
            f"{file}: is not a whole MATLAB file: save it again, for example with save -v7 "
            f"({(str(error).splitlines() or [type(error).__name__])[0][:120]})"
        ) from error


def _flattened(variables: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in variables.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict):
            flat |= _flattened(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def _is_signal(value: object) -> bool:
    return (
        isinstance(value, np.ndarray)
        and value.dtype.kind in "fiu"
        and value.size > 1
        and max(value.shape) == value.size
    )
