"""The border between what a person writes ("20 nm", ``voltage [V]``) and SI floats.

Inside the package every number is an SI float. This file is the only one that knows the units
library; its registry is private and made on first use, because building it takes a while.
"""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.errors import InputError

if TYPE_CHECKING:
    import pint

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(.*)", re.DOTALL)
_HEADER = re.compile(r"\s*([^\[\]]*?)\s*\[([^\[\]]*)\]\s*")
# A unit is names with small powers, multiplied and divided. Anything else never reaches the
# units library, whose parser would happily compute 9**9**9.
_FACTOR = r"(?:1|[^\W\d_][^\W\d]*|°[CF]|%)(?:(?:\^|\*\*)?-?\d{1,2}|[²³])?"
_UNIT = re.compile(rf"{_FACTOR}(?:\s*(?:[*/·]|\s)\s*{_FACTOR})*")
_LONGEST_UNIT = 40

# The SI units with names of their own that a record of an actuator may need.
_NAMED = (
    *("s", "m", "V", "K", "N", "A", "Hz", "Pa", "W", "J", "C", "F", "ohm", "kg", "rad"),
    *("H", "T", "Wb", "S", "mol", "cd"),
)
_PREFIXES = {
    **{-15: "f", -12: "p", -9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"},
}
_NEVER_LARGE = frozenset({"s", "K"})
_NEVER_PREFIXED = frozenset({"1", "kg", "K", "rad"})
# What nearly every record is written in. Loading the units library takes longer than reading one.
_PLAIN: Final = {
    prefix + symbol: (factor, symbol)
    for symbol in ("s", "m", "V", "N", "A", "Hz")
    for prefix, factor in (
        *(("", 1.0), ("k", 1e3), ("m", 1e-3), ("n", 1e-9), ("p", 1e-12)),
        *((micro, 1e-6) for micro in ("u", "\u00b5", "\u03bc")),
    )
}


@cache
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    return pint.UnitRegistry(cache_folder=None, on_redefinition="ignore")


@cache
def _parse(unit: str) -> Any:
    """The library's unit for ``unit``; `InputError` when it is none."""
    text = unit.strip()
    if not text:
        raise InputError("the unit is missing: write it out, for example [V], [um] or [s]")
    if text in ("1", "-"):
        return _registry().dimensionless
    unknown = f"unknown unit {text!r}: write a unit such as V, mV, um, nm, s, ms, K or degC"
    if len(text) > _LONGEST_UNIT or not _UNIT.fullmatch(text):
        raise InputError(unknown)
    spelled = text.replace("°C", "degC").replace("°F", "degF").replace("·", "*")
    spelled = spelled.replace("²", "**2").replace("³", "**3").replace("%", "percent")
    try:
        return _registry().parse_units(spelled)
    except Exception as error:  # the library raises half a dozen unrelated types for a bad name
        raise InputError(unknown) from error


@cache
def _named_by_dimension() -> dict[Any, str]:
    named: dict[Any, str] = {}
    for symbol in reversed(_NAMED):
        named[_parse(symbol).dimensionality] = symbol
    # An angle and a ratio both have no dimension; angles are recognised before this is asked.
    named[_registry().dimensionless.dimensionality] = "1"
    return named


def _si_of_factor(factor: Any) -> str | None:
    """The named SI unit of one factor; angles apart from ratios, which share their dimension."""
    in_base = _registry().Quantity(1.0, factor).to_base_units().units
    if in_base == _parse("rad"):
        return "rad"
    if in_base == _parse("rad/s"):
        return "rad/s"
    return _named_by_dimension().get(factor.dimensionality)


@cache
def si_unit(unit: str) -> str:
    """The SI unit that measures what ``unit`` measures: ``"um/ms"`` gives ``"m/s"``.

    Raises `InputError` for an unknown or missing unit.
    """
    if unit in _PLAIN:
        return _PLAIN[unit][1]
    parsed = _parse(unit)
    above: list[str] = []
    below: list[str] = []
    for name, power in parsed._units.items():
        factor = _registry().Unit(name)
        symbol = _si_of_factor(factor)
        if symbol is None:
            return f"{_registry().Quantity(1.0, parsed).to_base_units().units:~C}"
        if symbol == "1":
            continue
        exponent = f"{abs(power):g}"
        (above if power > 0 else below).append(symbol + (f"^{exponent}" if exponent != "1" else ""))
    return "/".join(["*".join(above) or "1", *below])


def same_dimension(unit: str, other: str) -> bool:
    """Whether two units measure the same thing. Raises `InputError` for an unknown unit."""
    if unit in _PLAIN and other in _PLAIN:
        return _PLAIN[unit][1] == _PLAIN[other][1]
    return bool(_parse(unit).dimensionality == _parse(other).dimensionality)


def to_si(values: ArrayLike, unit: str) -> tuple[NDArray[np.float64], str]:
    """Values in ``unit`` as SI floats of the same shape, and the SI unit's name.

    An offset temperature is absolute: ``to_si([20.0], "degC")`` is ``([293.15], "K")``.
    Raises `InputError` for an unknown or missing unit.
    """
    target = si_unit(unit)
    numbers = np.asarray(values, dtype=np.float64)
    if unit in _PLAIN:
        return numbers * _PLAIN[unit][0], target
    import pint

    if _parse(unit) == _parse(target):
        return numbers.copy(), target
    try:
        converted = _registry().Quantity(numbers, _parse(unit)).to(_parse(target))
    except pint.PintError as error:
        raise InputError(f"unit {unit!r} cannot be turned into SI: {error}") from error
    return np.asarray(converted.magnitude, dtype=np.float64), target


def quantity(value: str | float, unit: str) -> float:
    """One number in ``unit``: ``quantity("20 nm", "m")`` is ``2e-08``; a float already is.

    Raises `InputError` when there is no number, no unit, an unknown unit, or one of another
    dimension.
    """
    if not isinstance(value, str):
        try:
            if isinstance(value, bool):
                raise TypeError("a truth is no number")
            number = float(value)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(
                f"{value!r} is no number and no text: write '20 {unit}', say"
            ) from error
        if not math.isfinite(number):
            raise InputError(f"{number} is not a number in {unit}: give a finite value")
        return number
    example = f"write for example '{'20' if unit == '1' else f'20 {unit}'}'"
    match = _NUMBER.fullmatch(value)
    if match is None:
        raise InputError(f"{value!r} does not start with a number: {example}")
    number, written = float(match[1]), match[2].strip()
    if written in _PLAIN and _PLAIN.get(unit) == (1.0, _PLAIN[written][1]):
        return _finite(number * _PLAIN[written][0], value, unit)
    import pint

    target = _parse(unit)
    if not written and target != _registry().dimensionless:
        raise InputError(f"{value!r} has no unit: {example}")
    source = _parse(written or "1")
    if source.dimensionality != target.dimensionality:
        kind = "a plain number" if unit == "1" else f"a quantity in {unit}"
        raise InputError(f"{value!r} is not {kind}: {example}")
    try:
        converted = float(_registry().Quantity(number, source).to(target).magnitude)
    except pint.PintError as error:
        raise InputError(f"{value!r} cannot be turned into {unit}: {error}") from error
    return _finite(converted, value, unit)


def _finite(number: float, value: str, unit: str) -> float:
    if not math.isfinite(number):
        raise InputError(f"{value!r} is too large for a number in {unit}")
    return number


def factor(value: str) -> tuple[float, str]:
    """A number with any unit, in SI: ``factor("2.5 um/V")`` is ``(2.5e-06, "m/V")``.

    Raises `InputError` when there is no number or the unit is unknown.
    """
    match = _NUMBER.fullmatch(value)
    if match is None:
        raise InputError(f"{value!r} does not start with a number: write for example '2.5 um/V'")
    unit = match[2].strip() or "1"
    converted, target = to_si([float(match[1])], unit)
    return _finite(float(converted[0]), value, target), target


def parse_header(text: str) -> tuple[str, str]:
    """Name and unit of a column: ``"voltage [V]"`` gives ``("voltage", "V")``.

    Raises `InputError` when the brackets are missing or hold no known unit.
    """
    match = _HEADER.fullmatch(text)
    if match is None:
        raise InputError(
            f"column {text.strip()!r} has no unit: write it in brackets, as in 'voltage [V]'"
        )
    name, unit = match[1], match[2].strip()
    try:
        si_unit(unit)
    except InputError as error:
        raise InputError(f"column {text.strip()!r}: {error}") from error
    return name, unit


def show(value: float, unit: str) -> str:
    """An SI number for people: ``show(2e-8, "m")`` is ``"20 nm"``; four significant digits."""
    head = re.split(r"[*/]", unit, maxsplit=1)[0]
    tail = unit[len(head) :]
    label = "" if unit == "1" else f" {unit}"
    if not math.isfinite(value) or value == 0.0:
        return f"{value:g}{label}"
    if head in _NEVER_PREFIXED or "^" in head:
        return f"{value:.4g}{label}"
    # Rounding first keeps 999.99 nm from being printed as 1000 nm.
    rounded = float(f"{value:.4g}")
    exponent = 3 * math.floor(math.log10(abs(rounded)) / 3 + 1e-12)
    if exponent not in _PREFIXES or (exponent > 0 and head in _NEVER_LARGE):
        return f"{value:.4g}{label}"
    return f"{rounded / 10.0**exponent:.4g} {_PREFIXES[exponent]}{head}{tail}"
