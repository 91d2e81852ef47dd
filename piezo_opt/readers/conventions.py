"""What attributes beside stored numbers mean, in array files of every kind.

    value = scale_factor * stored + add_offset,    stored == _FillValue or missing_value: no reading

(netCDF Climate and Forecast conventions 1.11, sections 2.5.1, 3.1 and 8.1), and the unit in
``units`` or ``unit``; of a time such as "seconds since 2020-01-01" the first word.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement import FloatArray
from piezo_opt.readers.columns import Column
from piezo_opt.readers.headers import header_cell, unit_word

_UNITS: Final = ("units", "unit", "Units", "Unit", "unit_string")
_MARKS: Final = ("_FillValue", "missing_value")


def column_of(
    file: str, name: str, stored: np.ndarray, attributes: Mapping[str, Any]
) -> tuple[Column, list[str]]:
    """A column in its own unit, and sentences about what was applied to the stored numbers.

    Raises `InputError` for a unit, a scale or an offset that is none.
    """
    unit = next((text for key in _UNITS if (text := _text(attributes.get(key)))), None)
    said: list[str] = []
    dated = unit is not None and " since " in unit
    if unit is None:
        name, unit = header_cell(file, name)
    elif (known := unit_word(unit.partition(" since ")[0])) is None:
        said.append(f"The unit {unit[:40]!r} of {name!r} is not known.")
        unit = None
    else:
        unit = known
    missing = np.zeros(stored.size, dtype=np.bool_)
    for mark in _MARKS:
        if (value := _number(file, name, mark, attributes)) is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                missing |= np.isnan(stored) if np.isnan(value) else stored == value
    if dated and stored.dtype.kind in "iu" and stored.size:
        # Nanoseconds of an epoch are more digits than a float has.
        stored = (stored - stored[0]).astype(np.int64)
        said.append(f"{name!r} is counted from its first instant.")
    values: FloatArray = stored.astype(np.float64)
    scale, offset = (_number(file, name, key, attributes) for key in ("scale_factor", "add_offset"))
    if scale is not None or offset is not None:
        values = values * (1.0 if scale is None else scale) + (0.0 if offset is None else offset)
        pieces = [
            f"{key} {value:g}"
            for key, value in (("scale_factor", scale), ("add_offset", offset))
            if value is not None
        ]
        said.append(f"{name!r} was unpacked with {' and '.join(pieces)}.")
    return Column(name, unit, values, missing if missing.any() else None), said


def _text(value: Any) -> str | None:
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    if isinstance(value, np.ndarray) and value.size == 1:
        return _text(value.reshape(-1)[0])
    return value.strip() if isinstance(value, str) and value.strip() else None


def _number(file: str, name: str, key: str, attributes: Mapping[str, Any]) -> float | None:
    if key not in attributes:
        return None
    try:
        value = float(np.asarray(attributes[key]).item())
    except (TypeError, ValueError, IndexError):
        value = float("inf")
    if np.isinf(value) and key not in _MARKS:
        raise InputError(f"{file}: {name!r} has a {key} that is no number: correct the attribute")
    return None if np.isinf(value) else value
