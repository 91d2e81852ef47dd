"""Text tables: names and units, then one row for each instant.

    # a comment
    time [s],voltage [V],displacement [um]
    0,0,0.000
    1,5,0.690

What a table looks like is concluded from its first lines (`layout_of`) and said in notes. After a
first line ``# piezo_opt record``, comments such as ``# period: 1 s``, ``# startup: 0.5 s``,
``# between: held``, ``# name: ...`` and ``# source: ...`` say what the record is.
"""

from __future__ import annotations

import itertools
import os
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final, TextIO

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.files import MOST_ROWS, checked, refuse_rows
from piezo_opt.measurement import Between, FloatArray
from piezo_opt.readers.cleaning import cleaned
from piezo_opt.readers.columns import Column, Table
from piezo_opt.readers.dialect import USED
from piezo_opt.readers.instants import dated, seconds_reader, since_first
from piezo_opt.readers.layout import Layout, Line, layout_of
from piezo_opt.readers.preamble import steps_of
from piezo_opt.readers.quantities import si_reader, unit_in
from piezo_opt.readers.text import encoding_of
from piezo_opt.units import same_dimension, si_unit

SIGNATURE: Final = "# piezo_opt record"
WRITTEN: Final = ("time", "drive", "position")
_COMMENT = re.compile(r"(?:^|\s)\s*#.*", re.DOTALL)
_HEAD = 2000
"""Lines that the layout is concluded from."""
_FOLDED = 8
"""Lines that a cell in quotation marks may go on in."""
_KINDS: Final = {
    "n": "a number",
    "c": "a time",
    "q": "a number with a unit of the same kind as above",
}
"""What the cells of a column are."""


def table_from_csv(
    path: str | os.PathLike[str], *, decimal: str | None = None, numbered: bool = False
) -> Table:
    """The columns of a text file.

    Args:
        path: the file.
        decimal: sign of decimals, "." or ","; by default what the numbers show.
        numbered: whether columns are called by number, so that no header is needed.

    Raises:
        InputError: names file, row, column and remedy.
    """
    file = checked(path)
    try:
        encoding, said = encoding_of(file)
        with file.open(encoding=encoding) as lines:
            return _table(file, lines, encoding, said, decimal, numbered)
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: is not whole text: export it again as CSV in UTF-8") from error
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from error


def _table(
    file: Path,
    lines: TextIO,
    encoding: str,
    said: str | None,
    decimal: str | None,
    numbered: bool,
) -> Table:
    head = list(_whole(itertools.islice(lines, _HEAD)))
    layout = layout_of(str(file), head, decimal=decimal, numbered=numbered)
    names = [name for name, _ in layout.columns]
    comments = [line.text for line in head if line.comment and line.number <= layout.head.row + 1]
    rows = _numbers(file, layout, encoding)
    columns, left_out = _columns(str(file), layout, rows)
    return Table(
        file=str(file),
        columns=columns,
        row=_row_namer(file, layout, encoding),
        metadata=_metadata(file, comments, names),
        notes=(*(() if said is None else (said,)), *layout.notes, *left_out),
        steps=steps_of(names, (layout.head.below, layout.first), layout.head.above),
    )


def _whole(lines: Iterable[str]) -> Iterator[Line]:
    """Lines that are not empty; a cell in quotation marks may go on in the next ones."""
    open_, begun = "", 0
    for number, text in enumerate(map(cleaned, lines), start=1):
        joined = f"{open_} {text.strip()}" if open_ else text.strip()
        inside = joined.count('"') % 2 == 1 and joined.startswith('"')
        if inside and (not open_ or number - begun < _FOLDED):
            open_, begun = joined, begun if open_ else number
        elif joined:
            open_ = ""
            yield Line(number, joined)
    if open_:
        yield Line(begun, open_)


def _numbers(file: Path, layout: Layout, encoding: str) -> FloatArray:
    """(rows, used columns) of numbers; clocks are seconds, quantities in SI."""
    plain = set(layout.pattern) == {"n"} and not layout.dialect.quoted and not layout.thousands
    if plain and layout.dialect.decimal == "." and len(layout.columns) == len(layout.pattern):
        rows = _fast(file, layout, encoding)
        if rows is not None:
            return rows
    with file.open(encoding=encoding) as lines:
        data = itertools.islice(lines, layout.head.row, None)
        return _careful(file, layout, data, encoding)


def _fast(file: Path, layout: Layout, encoding: str) -> FloatArray | None:
    """The rows of a table of plain numbers, parsed without a look at them; None where that fails.

    The parser does not name what it stumbles over as an editor would.
    """
    try:
        rows = _parsed(
            str(file.resolve()),
            delimiter=layout.dialect.separator,
            skiprows=layout.head.row,
            encoding=encoding,
            max_rows=_most_rows(file, layout),
        )
    except (ValueError, OSError):
        return None
    refuse_rows(file, rows.shape[0])
    return rows if rows.shape[0] and rows.shape[1] == len(layout.pattern) else None


def _most_rows(file: Path, layout: Layout) -> int:
    """Rows that a file may hold: a cell and its sign take two bytes, and room is made for all."""
    return min(MOST_ROWS + 1, file.stat().st_size // (2 * len(layout.pattern)) + 2)


def _parsed(source: str | Iterable[str], **how: Any) -> FloatArray:
    """Numbers of a file or of lines, without the parser's warnings about lines without cells."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        rows: FloatArray = np.loadtxt(source, comments=None, ndmin=2, **{"encoding": None, **how})
    return rows


def _careful(file: Path, layout: Layout, lines: Iterable[str], encoding: str) -> FloatArray:
    """The rows of any table, line by line; `InputError` names the first one that is none."""
    used = [k for k, kind in enumerate(layout.pattern) if kind in USED]
    wrong = len(layout.columns) < used[-1] + 1
    if wrong or _names_without_cells(layout):
        raise InputError(_first_bad_row(file, layout, encoding, None))
    spelled: dict[int | str, Callable[[str], float]] = {
        k: seconds_reader() if layout.pattern[k] == "c" else si_reader()
        for k in used
        if layout.pattern[k] != "n"
    }
    try:
        rows = _parsed(
            _prepared(lines, layout),
            delimiter="\t" if layout.dialect.quoted else layout.dialect.separator,
            usecols=None if len(used) == len(layout.pattern) else used,
            converters=spelled or None,
            max_rows=_most_rows(file, layout),
        )
    except UnicodeDecodeError:
        raise
    except ValueError as error:
        raise InputError(_first_bad_row(file, layout, encoding, error)) from error
    refuse_rows(file, rows.shape[0])
    if rows.shape[1] != len(used):
        raise InputError(_first_bad_row(file, layout, encoding, None))
    return rows


def _names_without_cells(layout: Layout) -> bool:
    """Whether the header has more names than a row has cells, other than at an empty end."""
    return len(layout.columns) > len(layout.pattern)


def _uncommented(line: str) -> str:
    """A line without its comment, which begins it or stands behind a blank: 1.#INF is a cell."""
    line = cleaned(line)
    return line if "#" not in line else _COMMENT.sub("", line)


def _prepared(lines: Iterable[str], layout: Layout) -> Iterator[str]:
    """The lines that hold cells, as the fast parser wants them.

    It skips other lines itself, but warns about each; and where it is told which columns to read
    it does not count the others.
    """
    dialect, width = layout.dialect, len(layout.pattern)
    counted = "t" in layout.pattern or "e" in layout.pattern
    separator = dialect.separator
    for line in map(_uncommented, lines):
        text = line.lstrip(" ")
        if not text.strip():
            continue
        if dialect.quoted:
            cells = dialect.cells(line.rstrip("\r\n"))
            text = "\t".join(cell.replace("\t", " ") for cell in cells)
            if counted and len(cells) != width:
                raise ValueError("another number of cells")
        elif counted and separator is not None and line.count(separator) != width - 1:
            raise ValueError("another number of cells")
        if layout.thousands:
            text = text.replace(",", "")
        elif dialect.decimal == ",":
            text = text.replace(",", ".")
        yield text


def _columns(file: str, layout: Layout, rows: FloatArray) -> tuple[tuple[Column, ...], list[str]]:
    """The columns with numbers, and sentences about what was made of them or left out."""
    columns: list[Column] = []
    said: list[str] = []
    used = 0
    for place, ((name, unit), kind) in enumerate(zip(layout.columns, layout.pattern, strict=False)):
        if kind in "te":
            if kind == "t":
                said.append(f"Column {name!r} holds text and was left out.")
            sample = layout.samples[place]
            columns.append(
                Column(name, unit, np.zeros(0), sample=sample, sparse=kind == "e" and bool(sample))
            )
            continue
        values = np.ascontiguousarray(rows[:, used])
        used += 1
        if kind == "c":
            values = since_first(values, with_dates=_dated(layout, name))
            unit = "s"
            said.append(f"Column {name!r} holds clock times; they are counted from the first.")
        elif kind == "q":
            unit = _unit_of_cells(file, layout, place)
            said.append(f"The cells of column {name!r} carry their units; it was read in {unit}.")
        columns.append(Column(name, unit, values))
    return tuple(columns), said


def _unit_of_cells(file: str, layout: Layout, place: int) -> str:
    """The SI unit of the cells in a column; `InputError` where its header says another kind."""
    header, head = layout.columns[place]
    cell = layout.first[place]
    unit = unit_in(cell, layout.dialect.decimal)
    assert unit is not None
    if head is not None and not same_dimension(head, unit):
        raise InputError(
            f"{file}: column {header!r} is headed [{head}], and its cells are written in another "
            f"kind of unit ({cell!r}): correct one of them"
        )
    return si_unit(unit)


def _dated(layout: Layout, name: str) -> bool:
    """Whether the clocks of a column have dates before them."""
    place = [own for own, _ in layout.columns].index(name)
    return place < len(layout.first) and dated(layout.first[place])


def _data_rows(file: Path, layout: Layout, encoding: str) -> Iterator[tuple[int, str]]:
    with file.open(encoding=encoding) as lines:
        for number, line in enumerate(lines, start=1):
            text = _uncommented(line).strip("\r\n")
            if number > layout.head.row and text.strip():
                yield number, text


def _first_bad_row(file: Path, layout: Layout, encoding: str, error: Exception | None) -> str:
    """The sentence about the first row that is not one number for each column."""
    dialect, width = layout.dialect, len(layout.columns)
    headers = [name if unit is None else f"{name} [{unit}]" for name, unit in layout.columns]
    measured: dict[str, str] = {}
    instants: dict[str, Callable[[str], float]] = {}
    for number, text in _data_rows(file, layout, encoding):
        cells = dialect.cells(text)
        if len(cells) != width and not (
            width < len(cells) == len(layout.pattern) and not any(cells[width:])
        ):
            hint = "complete or remove the row"
            if len(cells) == len(layout.pattern):
                hint = "give every column one name in the header"
            elif not set(dialect.pattern(cells)) & set(USED):
                hint = "it is no row of numbers: remove it"
            elif dialect.separator == ",":
                hint = "write decimals with a point and separate columns with one sign"
            many = f"{len(cells)} cell{'' if len(cells) == 1 else 's'}"
            return f"{file}: row {number} has {many} but the header has {width}: {hint}"
        for header, cell, kind in zip(headers, cells, layout.pattern, strict=False):
            if kind in "te" or (kind == "n" and dialect.number(cell)):
                continue
            if kind == "c" and _is_time(cell, instants.setdefault(header, seconds_reader())):
                continue
            unit = unit_in(cell, dialect.decimal) if kind == "q" else None
            if unit is not None and si_unit(unit) == measured.setdefault(header, si_unit(unit)):
                continue
            if cell in (header, header.partition(" [")[0]):
                return (
                    f"{file}: row {number} is a header again: remove it, or save every table as a "
                    "file of its own"
                )
            what = f"{cell[:40]!r} is not {_KINDS[kind]}"
            if not cell:
                what = "is empty"
            other = "," if dialect.decimal == "." else "."
            remedy = (
                f"write decimals with a {'point' if other == ',' else 'comma'}, as in the other "
                "rows"
                if re.fullmatch(rf"[+-]?\d+\{other}\d+", cell)
                else "correct or remove the row"
            )
            return f"{file}: row {number}, column {header!r}: {what}: {remedy}"
    return f"{file}: is not a table of numbers: {error}: export it again as CSV"


def _is_time(cell: str, seconds: Callable[[str], float]) -> bool:
    try:
        seconds(cell)
    except ValueError:
        return False
    return True


def _row_namer(file: Path, layout: Layout, encoding: str) -> Callable[[int], str]:
    """Names the n-th data row by its line in the file, which is read again only for an error."""

    def row(index: int) -> str:
        rows = _data_rows(file, layout, encoding)
        number, _ = next(itertools.islice(rows, index, None))
        return f"row {number}"

    return row


def _metadata(file: Path, comments: list[str], names: list[str]) -> dict[str, Any]:
    if not comments or comments[0] != SIGNATURE:
        return {}
    said: dict[str, Any] = {}
    if names[:3] == list(WRITTEN):
        # The columns of a written file have these names and may have any unit.
        said["columns"] = {role: role for role in WRITTEN}
    for comment in comments[1:]:
        key, separator, value = comment.lstrip("#").partition(":")
        if separator and key.strip() in ("name", "period", "startup", "source"):
            said[key.strip()] = value.strip()
        elif key.strip() == "allow_saturated":
            said["allow_saturated"] = value.strip() == "true"
        elif key.strip() == "between":
            try:
                said["between"] = Between(value.strip())
            except ValueError as error:
                raise InputError(
                    f"{file}: '{comment}': the drive is one of "
                    f"{', '.join(one.value for one in Between)} between samples"
                ) from error
    return said
