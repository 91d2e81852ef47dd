"""Names and units as people write them above a column.

    voltage [V]   Voltage (V)   voltage {V}   [V] voltage   voltage / V   voltage, V   voltage_V

and a row of units alone: ``s,V,um``, ``[s];[V]``, ``(ms),(V)``, ``Second,Volt``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from piezo_opt.errors import InputError
from piezo_opt.units import si_unit

_BRACKETS = re.compile(r"\s*([^\[\]]*?)\s*\[([^\[\]]*)\]\s*")
_BEFORE = re.compile(r"\[([^\[\]]*)\]\s*([^\[\]]*\S)\s*")
_PARENTHESES = re.compile(r"\s*(.*?)\s*(?:\(([^()]*)\)|\{([^{}]*)\}|<([^<>]*)>)\s*")
_TAIL = re.compile(r"\s*(.*\S)\s*(?:/|,)\s*(\S+)\s*")
_UNDERSCORE = re.compile(r"\s*(.*[^\W_])_([^\W_]+)\s*")
_WORDS: Final = {
    **dict.fromkeys(("second", "seconds", "sec", "secs", "sekunde", "sekunden"), "s"),
    **dict.fromkeys(("millisecond", "milliseconds", "msec"), "ms"),
    **dict.fromkeys(("microsecond", "microseconds", "usec"), "us"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("millivolt", "millivolts"), "mV"),
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("micrometer", "micrometers", "micrometre", "micrometres"), "um"),
    **dict.fromkeys(("micron", "microns"), "um"),
    **dict.fromkeys(("nanometer", "nanometers", "nanometre", "nanometres"), "nm"),
    **dict.fromkeys(("ampere", "amperes", "amp", "amps"), "A"),
    **dict.fromkeys(("newton", "newtons"), "N"),
    **dict.fromkeys(("hertz",), "Hz"),
}
# Without brackets only these: a column called "dx/dt" has no decitonnes.
_SURE: Final = frozenset(
    [prefix + unit for unit in ("s", "V", "m", "N", "A", "Hz") for prefix in ("", "m", "u", "n")]
    + ["µs", "µV", "µm", "µN", "µA", "μs", "μV", "μm", "kV", "kN", "kHz", "MHz", "pm", "mK"]
    + ["K", "degC", "°C", "Pa", "kPa", "MPa", "bar", "rad", "mrad", "urad", "µrad", "deg", "%"]
    + ["m/s", "mm/s", "um/s", "nm/s", "µm/s", "m/s^2", "m/s²", "V/s", "C", "nC", "uC", "µC"]
)
_SHORT: Final = frozenset({"s", "m", "N", "A", "K", "C"})
_LONG_NAMES: Final = frozenset(
    {"time", "zeit", "displacement", "position", "stroke", "travel", "distance", "force", "current"}
    | {"temperature", "charge"}
)


def header_cell(file: str, cell: str) -> tuple[str, str | None]:
    """Name and unit of a column; no unit where none is written.

    Raises `InputError` for a unit in square brackets that is none: they hold nothing else.
    """
    text = cell.strip().strip("\"'").strip()
    if match := _BRACKETS.fullmatch(text):
        return match[1], known_unit(file, text, match[2].strip())
    if match := _BEFORE.fullmatch(text):
        return match[2], known_unit(file, text, match[1].strip())
    if match := _PARENTHESES.fullmatch(text):
        inside = next(part for part in match.groups()[1:] if part is not None)
        # A number in parentheses counts channels.
        unit = None if inside.strip().isdecimal() else unit_word(inside)
        return (text, None) if unit is None or not match[1] else (match[1], unit)
    if match := _TAIL.fullmatch(text):
        if (unit := sure_unit(match[2])) is not None:
            return match[1], unit
    elif match := _UNDERSCORE.fullmatch(text):
        unit = sure_unit(match[2])
        # y_m may be y in metres or y as it was measured; displacement_m is the former.
        if unit is not None and (
            match[2] not in _SHORT or match[1].rpartition("_")[2].lower() in _LONG_NAMES
        ):
            return match[1], unit
    return text, None


def unit_row(cells: Sequence[str]) -> list[str | None] | None:
    """The units that a row holds, None where a cell holds none; None for another row.

    At least half of the cells that are neither empty nor numbers are units, and at least two,
    or one that stands in brackets.
    """
    units: list[str | None] = []
    found = other = 0
    marked = False
    for cell in cells:
        text = cell.strip().strip('"').strip()
        inner = text[1:-1] if len(text) > 2 and text[0] + text[-1] in ("[]", "()") else text
        unit = unit_word(inner) if inner != text else sure_unit(inner)
        units.append(unit)
        found += unit is not None
        other += unit is None and bool(text) and not _is_plain_number(text)
        marked |= unit is not None and inner != text
    return units if found >= other and (found >= 2 or (found == 1 and marked)) else None


def unit_word(text: str) -> str | None:
    """A unit as people abbreviate or spell it; None when it is none."""
    unit = text.strip()
    if not unit or len(unit) > 40:
        return None
    if (word := _WORDS.get(unit.lower().rstrip("."))) is not None:
        return word
    try:
        si_unit(unit)
    except InputError:
        return None
    return unit


def known_unit(file: str, header: str, unit: str) -> str:
    """The unit itself when it is known; `InputError` naming file and column when not."""
    if (word := _WORDS.get(unit.lower().rstrip("."))) is not None:
        return word
    try:
        si_unit(unit)
    except InputError as error:
        raise InputError(f"{file}: column {header!r}: {error}") from error
    return unit


def sure_unit(text: str) -> str | None:
    """A unit that nobody takes for a name; None for other text."""
    word = text.strip()
    return word if word in _SURE else _WORDS.get(word.lower().rstrip("."))


def _is_plain_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True
