"""MATLAB files of version 7.3: HDF5 with MATLAB's own conventions.

A structure is a group, a cell and a field of an array of structures are references to data sets in
``#refs#``, text is an array of 16-bit letters, an object points into ``#subsystem#``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from piezo_opt.files import refuse_rows
from piezo_opt.readers.hdf5 import opened, text_of

_DEEPEST: Final = 12
_MOST: Final = 64
"""Elements of a cell or an array of structures that are looked at."""


def variables_from_mat73(file: Path) -> tuple[dict[str, Any], list[str]]:
    """Variables by name as arrays, text, lists and dictionaries, and the names of objects.

    Raises `InputError` for a damaged file.
    """
    objects: list[str] = []
    with opened(file) as content:
        return _group(file, content, content, objects, _DEEPEST), objects


def _group(file: Path, top: Any, group: Any, objects: list[str], depth: int) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if depth == 0:
        return found
    for name in group:
        if name.startswith("#"):
            continue
        item = group[name]
        if isinstance(item, h5py.Group):
            found[name] = _structures(_group(file, top, item, objects, depth - 1))
        elif "MATLAB_object_decode" in item.attrs or "MATLAB_object_decode" in group.attrs:
            objects.append(name)
        else:
            found[name] = _data(file, top, item, objects, depth)
    return found


def _data(file: Path, top: Any, item: Any, objects: list[str], depth: int) -> Any:
    kind = text_of(item.attrs.get("MATLAB_class", ""))
    if "MATLAB_empty" in item.attrs or not item.shape:
        return None
    if h5py.check_ref_dtype(item.dtype) is not None:
        references = np.asarray(item[()]).reshape(-1)[:_MOST]
        return [_referred(file, top, one, objects, depth - 1) for one in references]
    refuse_rows(file, int(item.size))
    if item.dtype.kind not in "fiu":
        return None
    values = np.asarray(item[()])
    if kind == "char":
        return "".join(chr(c) for c in values.T.reshape(-1)[:1000])
    # MATLAB keeps columns together, HDF5 rows.
    return values.T


def _referred(file: Path, top: Any, reference: Any, objects: list[str], depth: int) -> Any:
    if not reference or depth <= 0:
        return None
    item = top[reference]
    if isinstance(item, h5py.Group):
        return _structures(_group(file, top, item, objects, depth))
    return _data(file, top, item, objects, depth)


def _structures(fields: dict[str, Any]) -> Any:
    """An array of structures where every field is a list of the same length; else a structure."""
    lengths = {len(value) if isinstance(value, list) else -1 for value in fields.values()}
    if len(lengths) != 1 or -1 in lengths or not fields:
        return fields
    return [{name: value[k] for name, value in fields.items()} for k in range(next(iter(lengths)))]
