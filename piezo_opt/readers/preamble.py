"""The clock of an instrument that writes a start and an increment instead of a column of time.

As columns of one number each (``X,CH1,CH2,Start,Increment``), or as lines above the table
(``Sample interval,1.0E-03,s``, ``Sampling rate: 10 kHz``).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import final

from piezo_opt.readers.headers import header_cell, unit_word
from piezo_opt.units import same_dimension, to_si

_INTERVAL = re.compile(
    r"(?:sampl(?:e|ing)[ _]?(?:interval|period|time)"
    r"|(?:time[ _]?)?(?:step|increment|incr|resolution)"
    r"|x[ _]?(?:incr|increment|interval)|delta[ _]?[xt]|d[xt]|t_?s|h(?:orizontal)?[ _]?resolution"
    r"|abtastintervall)",
    re.I,
)
_RATE = re.compile(
    r"(?:sampl(?:e|ing)[ _]?(?:rate|frequency)|fs|f_s|rate|abtastrate|abtastfrequenz)", re.I
)
_START = re.compile(r"(?:start|x[ _]?(?:zero|offset|origin|start)|t0|trigger[ _]?offset)", re.I)
_FIGURE = re.compile(r"([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*(\S*)")


@final
@dataclass(frozen=True)
class Steps:
    """An even clock: first instant and step [s], and where they stand in the file."""

    start: float
    step: float
    said: str


def steps_of(
    names: Sequence[str], rows: Iterable[Sequence[str]], above: Iterable[Sequence[str]]
) -> Steps | None:
    """Start and step of the clock; None where the file says neither a step nor a rate.

    Args:
        names: of the columns.
        rows: cells of the first rows below the names.
        above: cells of the lines above them.
    """
    told = [(name, row[k], "") for row in rows for k, name in enumerate(names) if k < len(row)]
    told += [(c[0], c[1], c[2] if len(c) > 2 else "") for c in above if len(c) > 1]
    told += [(*c[0].partition(sign)[::2], "") for c in above if c for sign in ":=" if sign in c[0]]
    start, found = 0.0, None
    for key, value, unit in told:
        name, own = header_cell("", key.strip()) if "[" not in key else _bracketed(key)
        number, written = _figure(value)
        if number is None:
            continue
        said = unit_word(written) or unit_word(unit) or own
        if _START.fullmatch(name):
            start = number * _factor(said, "s")
        elif found is None and number > 0.0 and _INTERVAL.fullmatch(name):
            found = number * _factor(said, "s"), name
        elif found is None and number > 0.0 and _RATE.fullmatch(name):
            found = 1.0 / (number * _factor(said, "Hz")), name
    if found is None or not 0.0 < found[0] < float("inf"):
        return None
    sentence = f"The file has no column of time; it was made from {found[1]!r}: {found[0]:g} s."
    return Steps(start, found[0], sentence)


def _bracketed(key: str) -> tuple[str, str | None]:
    name, _, rest = key.partition("[")
    return name.strip(), unit_word(rest.partition("]")[0])


def _figure(text: str) -> tuple[float | None, str]:
    match = _FIGURE.match(text.strip())
    if match is None:
        return None, ""
    return float(match[1].replace(",", ".")), match[2]


def _factor(unit: str | None, of: str) -> float:
    """What one of a unit is in SI; 1 where none of this kind is written."""
    if unit is None or not same_dimension(unit, of):
        return 1.0
    return float(to_si([1.0], unit)[0][0])
