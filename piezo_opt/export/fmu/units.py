"""Units as exponents of the SI's base units, which is how FMI declares them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from typing import Final

from piezo_opt.errors import InputError

_BASE: Final[Mapping[str, Mapping[str, int]]] = {
    "1": {}, "m": {"m": 1}, "s": {"s": 1}, "kg": {"kg": 1}, "A": {"A": 1}, "K": {"K": 1},
    "rad": {"rad": 1}, "Hz": {"s": -1}, "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "N": {"kg": 1, "m": 1, "s": -2}, "C": {"A": 1, "s": 1}, "Pa": {"kg": 1, "m": -1, "s": -2},
    "F": {"A": 2, "s": 4, "kg": -1, "m": -2}, "mol": {"mol": 1}, "cd": {"cd": 1},
}  # fmt: skip


def exponents(unit: str) -> dict[str, int]:
    """``{"m": 1, "s": -1}`` of ``"m/s"``: names with powers, multiplied and divided.

    Raises:
        InputError: a name that is no SI unit.
    """
    total: Counter[str] = Counter()
    for sign, name, power in re.findall(r"([*/]?)\s*([A-Za-z]+|1)(?:\^(-?\d+))?", unit):
        if name not in _BASE:
            raise InputError(f"unit {unit!r}: {name} cannot be said in a unit of FMI")
        times = int(power or 1) * (-1 if sign == "/" else 1)
        for base, exponent in _BASE[name].items():
            total[base] += times * exponent
    order = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
    return {base: total[base] for base in order if total[base]}
