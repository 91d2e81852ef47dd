"""Cells that carry their unit, ``0.5 V`` or ``999 nm``, as meters and spreadsheets write them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from piezo_opt.readers.headers import sure_unit
from piezo_opt.units import si_unit, to_si

_CELL: Final = {
    ".": re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d_]\S*|°\S+|%)"),
    ",": re.compile(r"([+-]?(?:\d+(?:,\d*)?|,\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d_]\S*|°\S+|%)"),
}


def unit_in(cell: str, decimal: str = ".") -> str | None:
    """The unit behind the one number of a cell; None where it is no number with a unit.

    Only units that nobody takes for a name: ``3rd`` is no radian.
    """
    match = _CELL[decimal].fullmatch(cell.strip())
    return None if match is None else sure_unit(match[2])


def si_reader() -> Callable[[str], float]:
    """A function from such a cell to its number in SI; every cell may have a prefix of its own.

    The function raises `ValueError` for another cell, and for a unit that measures something else
    than that of the first cell did.
    """
    scales: dict[str, tuple[float, float]] = {}
    measured: list[str] = []

    def number_of(cell: str) -> float:
        match = _CELL["."].fullmatch(cell.strip())
        unit = None if match is None else sure_unit(match[2])
        if match is None or unit is None:
            raise ValueError(f"{cell[:40]!r} is not a number with its unit")
        if unit not in scales:
            measured.append(si_unit(unit))
            if measured[-1] != measured[0]:
                raise ValueError(f"{cell[:40]!r} is not in {measured[0]} as the rows above")
            # A temperature has an offset.
            zero, one = to_si([0.0, 1.0], unit)[0].tolist()
            scales[unit] = zero, one - zero
        zero, step = scales[unit]
        return zero + step * float(match[1])

    return number_of
