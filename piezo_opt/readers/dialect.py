"""How the cells of a text table are separated and their decimals written."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

from piezo_opt.readers.instants import is_instant
from piezo_opt.readers.quantities import unit_in

_BLANK_SEPARATED = re.compile(r"\"[^\"]*\"|[^\s\[\]()]*\s*[\[(][^\[\]()]*[\])]|\S+")
_NUMBER = {
    ".": re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.I),
    ",": re.compile(r"[+-]?(?:\d+(?:,\d+)?|,\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.I),
}
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d+)?")
"""A number whose digits commas group."""


@final
@dataclass(frozen=True)
class Dialect:
    """The signs of a text table.

    Attributes:
        separator: between cells; None for blanks.
        decimal: sign of decimals.
        quoted: whether cells may stand in quotation marks.
        grouped: whether commas may group digits.
    """

    separator: str | None
    decimal: str = "."
    quoted: bool = False
    grouped: bool = False

    def cells(self, text: str) -> list[str]:
        """The cells of a line, without what surrounds them."""
        if self.separator is None:
            return [cell.strip('"') for cell in _BLANK_SEPARATED.findall(text)] or [""]
        if self.quoted and '"' in text:
            return [cell.strip() for cell in next(csv.reader([text], delimiter=self.separator))]
        return [cell.strip() for cell in text.split(self.separator)]

    def number(self, cell: str) -> bool:
        """Whether a cell is one number."""
        if self.grouped and self.separator != "," and THOUSANDS.fullmatch(cell):
            return True
        return _NUMBER[self.decimal].fullmatch(cell) is not None

    def pattern(self, cells: Sequence[str]) -> str:
        """A letter for each cell: n(umber), c(lock), q(uantity with unit), e(mpty), t(ext)."""
        return "".join(map(self._kind, cells))

    def _kind(self, cell: str) -> str:
        if not cell:
            return "e"
        if self.number(cell):
            return "n"
        if is_instant(cell):
            return "c"
        return "t" if unit_in(cell, self.decimal) is None else "q"


USED: Final = "ncq"
"""Kinds of cells that are numbers, or become them."""


_TRIED: Final[tuple[tuple[str | None, str], ...]] = (
    *(("\t", "."), (";", "."), (",", "."), ("|", ".")),
    *(("\t", ","), (";", ","), ("|", ","), (None, "."), (None, ",")),
)


def dialect_of(texts: Sequence[str], *, decimal: str | None) -> tuple[Dialect, str | None]:
    """The dialect in which most lines are rows of numbers, and the pattern of such a row.

    Args:
        texts: lines that are mostly rows.
        decimal: sign of decimals, where the caller knows it.

    The pattern is None when no line has a number.
    """
    quoted = any('"' in text for text in texts)
    best: tuple[tuple[float, float], Dialect, str] | None = None
    for separator, sign in (*_TRIED, (",", ",")) if quoted else _TRIED:
        if decimal is not None and sign != decimal:
            continue
        tried = Dialect(separator, sign, quoted, decimal == ".")
        counted = Counter(tried.pattern(tried.cells(text)) for text in texts)
        pattern, times = counted.most_common(1)[0]
        useful = sum(map(pattern.count, USED))
        merit = (min(useful, 2), (useful - pattern.count("t")) * times / len(texts))
        if useful and (best is None or merit > best[0]):
            best = (merit, tried, pattern)
    return (Dialect(None), None) if best is None else best[1:]
