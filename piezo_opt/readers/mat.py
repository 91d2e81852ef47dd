"""MATLAB files: version 5 to 7.2 through scipy, version 7.3 as the HDF5 file that it is.

MATLAB keeps no units, so the caller says them: ``drive="u [V]"``, ``position="y [um]"``; a
variable with an obvious name (t, time; u, v, voltage; y, x, displacement) is found without being
named only when its unit stands in a string variable beside it, as in ``u_unit = 'V'``. A number
called ``fs`` or ``dt`` is the clock where no variable is one.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from piezo_opt.errors import InputError
from piezo_opt.files import checked, refuse_rows
from piezo_opt.readers.columns import Table
from piezo_opt.readers.mat_structure import check_structure
from piezo_opt.readers.mat_tree import columns_of
from piezo_opt.readers.preamble import steps_of

_OBJECTS = (
    "is an object (a timeseries, Dataset, table or other class), which only MATLAB unfolds: save "
    "its numbers, as in t = x.Time; y = x.Data; save('file.mat', 't', 'y')"
)


def table_from_mat(path: str | os.PathLike[str]) -> Table:
    """The signals of a MATLAB file as columns; `InputError` for a damaged file."""
    file = checked(path)
    with file.open("rb") as content:
        head = content.read(1024)
    if b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520]):
        from piezo_opt.readers.mat73 import variables_from_mat73

        variables, objects = variables_from_mat73(file)
    else:
        contents = check_structure(file)
        # Sizes first: a small compressed file can unfold to more than the memory holds.
        for size in contents.sizes.values():
            refuse_rows(file, size)
        objects = list(contents.objects)
        variables = _variables(file, contents.sizes)
    columns, notes = columns_of(str(file), variables)
    if objects and not columns:
        raise InputError(f"{file}: {_quoted(objects)} {_OBJECTS}")
    if objects:
        notes.append(f"{_quoted(objects)}: an object is left out, only MATLAB unfolds it.")
    return Table(
        str(file),
        tuple(columns),
        lambda index: f"element {index + 1}",
        notes=tuple(notes),
        steps=steps_of((), (), _scalars(variables)),
    )


def _scalars(variables: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Variables that hold one number, where a rate (``fs``) or an increment (``dt``) may stand."""
    return [
        (name, repr(float(np.asarray(value).item())))
        for name, value in variables.items()
        if isinstance(value, int | float | np.number | np.ndarray)
        and np.size(value) == 1
        and np.asarray(value).dtype.kind in "fiu"
    ]


def _quoted(names: Collection[str]) -> str:
    return ", ".join(repr(name) for name in names) or "a variable"


def _variables(file: Path, names: Collection[str]) -> dict[str, Any]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = scipy.io.loadmat(file, simplify_cells=True, variable_names=list(names))
            return dict(found)
    except Exception as error:  # a damaged file surfaces as any of the library's many errors
        raise InputError(
            f"{file}: is not a whole MATLAB file: save it again, for example with save -v7 "
            f"({(str(error).splitlines() or [type(error).__name__])[0][:120]})"
        ) from error
