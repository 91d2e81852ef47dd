"""What a text table looks like, concluded from its first lines.

Where its rows begin, which line above them holds the names and which the units, and what the
other lines say.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

from piezo_opt.errors import InputError
from piezo_opt.readers.dialect import THOUSANDS, USED, Dialect, dialect_of
from piezo_opt.readers.headers import header_cell, unit_row

HEADER_EXAMPLE: Final = "time [s],voltage [V],displacement [um]"
BY_NUMBER: Final = "time='1 [s]', drive='2 [V]', position='3 [um]'"
_COMMENT = re.compile(r"^\s*(?:#|%|//|!)+\s*")
_SEEN = 200
"""Rows that decide what the columns hold."""


@final
@dataclass(frozen=True)
class Line:
    """One line that is not empty: its number in the file, from 1, and its text."""

    number: int
    text: str

    @property
    def comment(self) -> bool:
        """Whether it is a comment, wherever it stands."""
        return self.text.startswith("#")


@final
@dataclass(frozen=True)
class Head:
    """The lines above the rows: cells above the names, names, units, and the last line's number.

    ``units`` are those of a row of their own, which is ``below`` as it is written, and line
    ``unit_row`` of the file.
    """

    row: int
    names: tuple[str, ...] | None = None
    units: tuple[str | None, ...] | None = None
    unit_row: int = 0
    below: tuple[str, ...] = ()
    above: tuple[tuple[str, ...], ...] = ()


@final
@dataclass(frozen=True)
class Layout:
    """How a text table is written.

    Attributes:
        dialect: its signs.
        head: what stands above the rows.
        columns: name and unit of every column.
        first: cells of the first row.
        samples: one cell of each column, empty where none was found that is not.
        pattern: what each column holds: n(umbers), c(locks), q(uantities), t(ext), e(mpty).
        thousands: whether commas group digits.
        notes: what was concluded, in sentences.
    """

    dialect: Dialect
    head: Head
    columns: tuple[tuple[str, str | None], ...]
    first: tuple[str, ...]
    samples: tuple[str, ...]
    pattern: str
    thousands: bool
    notes: tuple[str, ...]


def layout_of(
    file: str, lines: Sequence[Line], *, decimal: str | None = None, numbered: bool = False
) -> Layout:
    """The layout of a table.

    Args:
        file: what messages call it.
        lines: its first lines that are not empty.
        decimal: sign of decimals, where the caller knows it.
        numbered: whether the caller calls columns by number, so that no header is needed.

    Raises:
        InputError: there is no table, or two readings of it are possible.
    """
    plain = [line for line in lines if not line.comment]
    if not plain:
        raise InputError(
            f"{file}: has no rows: a record is a header such as '{HEADER_EXAMPLE}' and numbers "
            "below it"
        )
    latter = [line.text for line in plain[len(plain) // 2 :][-_SEEN:]]
    dialect, pattern = dialect_of(latter, decimal=decimal)
    if pattern is None:
        raise InputError(f"{file}: row {plain[0].number} is a header without rows: export it again")
    start = _first_row(plain, dialect, pattern)
    rows = plain[start : start + _SEEN]
    thousands = _thousands(file, rows, dialect, decimal)
    head = _head(lines, plain, start, dialect, len(pattern))
    if head.names is None and not numbered:
        raise InputError(
            f"{file}: row {plain[start].number} has numbers where the header should be: add a "
            f"first line such as '{HEADER_EXAMPLE}', or say which column is which, {BY_NUMBER}"
        )
    first = tuple(dialect.cells(plain[start].text))
    columns = _columns(file, head, len(pattern))
    if len(columns) == len(pattern) - 1 and _counts(rows, dialect):
        columns = (("", None), *columns)
    notes = _notes(head, dialect, thousands, columns)
    samples = _samples([dialect.cells(row.text) for row in reversed(rows)], len(columns))
    return Layout(dialect, head, columns, first, samples, pattern, thousands, notes)


def _samples(rows: Sequence[Sequence[str]], width: int) -> tuple[str, ...]:
    """A cell of each column that is not empty, of the first row that has one."""
    return tuple(
        next((row[k] for row in rows if k < len(row) and row[k]), "") for k in range(width)
    )


def _first_row(plain: Sequence[Line], dialect: Dialect, pattern: str) -> int:
    """Index of the first row; a line with a wrong cell or two is one, too."""
    useful = [k for k, kind in enumerate(pattern) if kind in USED]

    def matches(line: Line) -> bool:
        own = dialect.pattern(dialect.cells(line.text))
        return len(own) == len(pattern) and all(own[k] == pattern[k] for k in useful)

    def spoiled(line: Line) -> bool:
        own = dialect.pattern(dialect.cells(line.text))
        right = [k for k in useful if k < len(own) and own[k] == pattern[k]]
        return bool(right) and right[0] == useful[0] and 2 * len(right) >= len(useful)

    start = next((k for k, line in enumerate(plain) if matches(line)), len(plain) - 1)
    while start > 0 and spoiled(plain[start - 1]):
        start -= 1
    return start


def _thousands(file: str, rows: Sequence[Line], dialect: Dialect, said: str | None) -> bool:
    """Whether commas group digits; asks where they may as well be signs of decimals."""
    if dialect.separator == "," or (dialect.decimal == "." and not dialect.grouped):
        return False
    found = [c for line in rows for c in dialect.cells(line.text) if "," in c]
    if not found or not all(THOUSANDS.fullmatch(cell) for cell in found):
        return False
    if said is None:
        raise InputError(
            f"{file}: row {rows[0].number}: {found[0]!r} is {found[0].replace(',', '.')} with a "
            f"comma for decimals and {found[0].replace(',', '')} with a comma for thousands: say "
            "which, decimal=',' or decimal='.'"
        )
    return said == "."


def _head(
    lines: Sequence[Line], plain: Sequence[Line], start: int, dialect: Dialect, width: int
) -> Head:
    above = plain[:start]
    quotes = Dialect(dialect.separator, quoted=True)
    if not above:
        return _from_comment(lines, plain[start].number, dialect, width)
    texts = [_COMMENT.sub("", line.text, count=1) for line in above]
    cells = [quotes.cells(text) for text in texts]
    # A line of dashes or of nothing sets off the rows.
    while len(cells) > 1 and not any(cell.strip("-=_ ") for cell in cells[-1]):
        cells.pop()
    # Names may be separated by another sign than the numbers below them.
    for k in range(max(0, len(cells) - 2), len(cells)):
        cells[k] = _as_wide(texts[k], cells[k], width)
    units = unit_row(cells[-1]) if len(cells) > 1 and len(cells[-2]) > 1 else None
    names = cells[-1] if units is None else cells[-2]
    told = tuple(tuple(one) for one in cells[: -1 if units is None else -2])
    return Head(
        row=above[-1].number,
        unit_row=above[len(cells) - 1].number,
        names=tuple(cell.strip('"') for cell in names),
        units=None if units is None else tuple(units),
        below=() if units is None else tuple(cells[-1]),
        above=told,
    )


def _as_wide(text: str, cells: list[str], width: int) -> list[str]:
    """The cells of a line in the one way that gives as many as a row has; else as they are."""
    if len(cells) >= width:
        return cells
    others = [Dialect(sign, quoted=True).cells(text) for sign in (",", ";", "\t", "|")]
    fitting = [one for one in others if len(one) == width and all(one)]
    return fitting[0] if len(fitting) == 1 else cells


def _from_comment(lines: Sequence[Line], first: int, dialect: Dialect, width: int) -> Head:
    """Names behind a comment sign, where numpy.savetxt writes them."""
    said = [line for line in lines if line.comment and line.number < first]
    if not said:
        return Head(first - 1)
    text = _COMMENT.sub("", said[-1].text, count=1)
    own = dialect.separator if dialect.separator and dialect.separator in text else None
    for separator in (own, ","):
        names = Dialect(separator, quoted=True).cells(text)
        if len(names) == width and ("[" in text or (all(names) and width > 1)):
            return Head(said[-1].number, tuple(names))
    return Head(first - 1)


def _columns(file: str, head: Head, width: int) -> tuple[tuple[str, str | None], ...]:
    """Name and unit of each column; as many as a row has cells, once empty ends are cut."""
    if head.names is None:
        return tuple((str(k + 1), None) for k in range(width))
    columns = [header_cell(file, name) for name in head.names]
    if head.units is not None:
        spare = [*head.units, *[None] * len(columns)]
        columns = [(name, unit or spare[k]) for k, (name, unit) in enumerate(columns)]
    while len(columns) > width and columns[-1] == ("", None):
        columns.pop()
    return tuple(columns)


def _counts(rows: Sequence[Line], dialect: Dialect) -> bool:
    """Whether the first cells count the rows: a column that needs no name, as R leaves it out."""
    counts = [dialect.cells(row.text)[0].strip('"') for row in rows]
    if not all(count.isdecimal() for count in counts) or len(counts) < 2:
        return False
    return [int(count) - int(counts[0]) for count in counts] == list(range(len(counts)))


def _notes(
    head: Head, dialect: Dialect, thousands: bool, columns: Sequence[tuple[str, str | None]]
) -> tuple[str, ...]:
    notes = []
    if head.above:
        many = len(head.above) > 1
        notes.append(
            f"{len(head.above)} line{'s' if many else ''} above the table "
            f"{'were' if many else 'was'} skipped."
        )
    if head.names is None:
        notes.append("The table has no header; its columns are called by number.")
    if head.units is not None:
        notes.append(f"The units are those of row {head.unit_row}.")
    elif any(unit is not None for _, unit in columns) and not any(
        "[" in name for name in head.names or ()
    ):
        read = ", ".join(f"{name!r} in {unit}" for name, unit in columns if unit is not None)
        notes.append(f"The units were read from the names: {read}.")
    if thousands:
        notes.append("Commas were read as signs of thousands.")
    elif dialect.decimal == ",":
        notes.append("Decimals are written with a comma.")
    return tuple(notes)
