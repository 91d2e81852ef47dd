"""Parquet files through pyarrow, and frames of pandas, polars or any other library."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.files import checked, refuse_rows
from piezo_opt.readers.columns import Column, Table
from piezo_opt.readers.conventions import column_of
from piezo_opt.readers.extras import needed
from piezo_opt.readers.instants import seconds_from_stamps


def table_from_parquet(path: str | os.PathLike[str]) -> Table:
    """The columns of a Parquet file; units stand in the names or in the fields' metadata.

    Raises `InputError` where pyarrow is missing or the file is damaged.
    """
    file = checked(path)
    library = needed("pyarrow.parquet", extra="parquet", what="Parquet files")
    try:
        stored = library.ParquetFile(file)
        refuse_rows(file, int(stored.metadata.num_rows))
        content = stored.read()
        columns = []
        notes: list[str] = []
        for field in content.schema:
            metadata = {k.decode(): v for k, v in (field.metadata or {}).items()}
            values = content.column(field.name).to_numpy()
            columns += _column(str(file), field.name, values, metadata, notes)
    except InputError:
        raise
    except Exception as error:  # a damaged file surfaces as any of the library's many errors
        raise InputError(
            f"{file}: is not a whole Parquet file: copy or export it again "
            f"({(str(error).splitlines() or [type(error).__name__])[0][:120]})"
        ) from error
    return Table(str(file), tuple(columns), lambda k: f"row {k + 1}", notes=tuple(notes))


def is_frame(given: object) -> bool:
    """Whether it is a frame: named columns that are asked for by name."""
    return hasattr(given, "columns") and hasattr(given, "__getitem__") and hasattr(given, "shape")


def table_from_frame(frame: Any) -> Table:
    """The columns of a frame; units stand in their names, ``"voltage [V]"``.

    An index of times, of decimals, or with a name counts as a column.
    """
    columns: list[Column] = []
    notes: list[str] = []
    index: Any = getattr(frame, "index", None)
    kind = getattr(getattr(index, "dtype", None), "kind", "")
    if kind in ("M", "m", "f") or getattr(index, "name", None):
        values = _array(index)
        columns += _column("frame", str(index.name or "index"), values, {}, notes)
    names = [str(name) for name in frame.columns]
    if len(set(names)) < len(names):
        raise InputError("frame: has columns of the same name: give them different names")
    for name, label in zip(names, frame.columns, strict=True):
        columns += _column("frame", name, _array(frame[label]), {}, notes)
    return Table("frame", tuple(columns), lambda k: f"row {k}", notes=tuple(notes))


def _array(values: Any) -> np.ndarray:
    """The values as an array; instants of a time zone as those of UTC."""
    zoned = getattr(getattr(values, "dtype", None), "tz", None) is not None
    return np.asarray(values.to_numpy(dtype="datetime64[ns]") if zoned else values)


def _column(
    file: str, name: str, values: np.ndarray, told: Mapping[str, Any], notes: list[str]
) -> list[Column]:
    """The column in a list; an empty list, and a sentence, for what holds no numbers."""
    if values.dtype.kind in ("M", "m"):
        notes.append(f"Column {name!r} holds clock times; they are counted from the first.")
        return [Column(name, "s", seconds_from_stamps(values))]
    if values.dtype.kind == "O":
        # Missing values turn numbers into objects.
        with contextlib.suppress(TypeError, ValueError):
            values = values.astype(np.float64)
    if values.dtype.kind not in "fiu" or values.ndim != 1:
        notes.append(f"Column {name!r} holds no numbers and was left out.")
        return [Column(name, None, np.zeros(0))]
    column, said = column_of(file, name, values, told)
    notes += said
    return [column]
