"""Text tables: a header with units in brackets, then one row for each instant.

    # a comment
    time [s],voltage [V],displacement [um]
    0,0,0.000
    1,5,0.690

Separators are comma, semicolon, tab or blanks; the decimal sign is a point. After a first line
``# piezo_opt record``, comments such as ``# period: 1 s``, ``# startup: 0.5 s``,
``# between: held``, ``# name: ...`` and ``# source: ...`` say what the record is. `write_csv`
writes them, and every digit, so that its file reads back as the same record.
"""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, FloatArray, Measurement
from piezo_opt.readers.columns import Column, Table, known_unit
from piezo_opt.readers.files import MOST_ROWS, checked, refuse_rows, replacing

_SIGNATURE = "# piezo_opt record"
_WRITTEN = ("time", "drive", "position")
_HEADER_EXAMPLE = "time [s],voltage [V],displacement [um]"
_BLANK_SEPARATED = re.compile(r"[^\s\[\]]*\s*\[[^\[\]]*\]|\S+")
_HEADER_CELL = re.compile(r"\s*([^\[\]]*?)\s*\[([^\[\]]*)\]\s*")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.I)


def table_from_csv(path: str | os.PathLike[str]) -> Table:
    """The columns of a text file. Raises `InputError` naming file, row, column and remedy."""
    file = checked(path)
    _refuse_binary(file)
    try:
        with file.open(encoding="utf-8-sig") as lines:
            return _table(file, lines)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{file}: is not UTF-8 text (byte {error.object[error.start]:#04x}): save it as "
            "CSV in UTF-8"
        ) from error
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror or error}") from error


def write_csv(
    record: Measurement, path: str | os.PathLike[str], *, overwrite: bool = False
) -> None:
    """Write a record in SI units with all digits, in one step: all of the file or none of it."""
    columns: dict[str, FloatArray] = {
        "time [s]": record.time,
        f"drive [{record.drive_unit}]": record.drive,
        f"position [{record.position_unit}]": record.position,
    }
    for name, values in record.channels.items():
        columns[f"{name} [{record.channel_units[name]}]"] = values
    for text in (*columns, record.name, record.source):
        if not text.isprintable():
            raise InputError(f"{path}: {text!r} cannot stand in a line of text: rename it")
    for header in columns:
        foreign = any(sign in header for sign in ',;#"') or header != header.strip()
        if foreign or header.count("[") > 1 or header.count("]") > 1:
            raise InputError(f"{path}: column {header!r} cannot stand in a CSV header: rename it")
    about = [
        _SIGNATURE,
        f"# name: {record.name}",
        f"# between: {record.between.value}",
        *([] if record.period is None else [f"# period: {record.period!r} s"]),
        f"# startup: {record.startup!r} s",
        f"# allow_saturated: {str(record.allow_saturated).lower()}",
        f"# source: {record.source}",
        ",".join(columns),
    ]
    with (
        replacing(path, overwrite=overwrite) as temporary,
        temporary.open("x", encoding="utf-8", newline="\n") as lines,
    ):
        lines.write("\n".join(about) + "\n")
        for row in zip(*(values.tolist() for values in columns.values()), strict=True):
            lines.write(",".join(map(repr, row)) + "\n")


def _refuse_binary(file: Path) -> None:
    with file.open("rb") as content:
        head = content.read(65536)
    if b"\0" in head:
        raise InputError(
            f"{file}: is binary, not text: read .mat and .h5 files under their own suffix, or "
            "export CSV"
        )


def _table(file: Path, lines: TextIO) -> Table:
    header, header_row, comments = "", 0, list[str]()
    first_data: str | None = None
    for number, line in enumerate(lines, start=1):
        text = line.strip()
        if not text:
            continue
        if text.startswith("#"):
            comments.append(text)
        elif not header and not _is_number(_cells(text, _separator(text))[0]):
            header, header_row = text, number
        else:
            first_data = line
            break
    if not header:
        # numpy.savetxt writes its header as a comment.
        if first_data is not None and comments and "[" in comments[-1]:
            header = comments[-1].lstrip("#").strip()
        elif first_data is not None:
            raise InputError(
                f"{file}: row {number} has numbers where the header should be: add a first line "
                f"such as '{_HEADER_EXAMPLE}'"
            )
        else:
            raise InputError(
                f"{file}: has no rows: a record is a header such as '{_HEADER_EXAMPLE}' and "
                "numbers below it"
            )
    separator = _separator(header)
    columns = [_header_cell(file, cell) for cell in _cells(header, separator)]
    if first_data is None:
        raise InputError(f"{file}: row {header_row} is a header without rows: export it again")
    try:
        rows = np.loadtxt(
            _with_data(itertools.chain([first_data], lines)),
            delimiter=separator,
            comments="#",
            ndmin=2,
            max_rows=MOST_ROWS + 1,
        )
    except UnicodeDecodeError:
        raise
    except ValueError as error:
        raise InputError(_first_bad_row(file, header_row, separator, columns, error)) from error
    refuse_rows(file, rows.shape[0])
    if rows.shape[1] != len(columns):
        raise InputError(_first_bad_row(file, header_row, separator, columns, None))
    return Table(
        file=str(file),
        columns=tuple(
            Column(name, unit, np.ascontiguousarray(rows[:, index]))
            for index, (name, unit) in enumerate(columns)
        ),
        row=_row_namer(file, header_row),
        metadata=_metadata(file, comments, [name for name, _ in columns]),
    )


def _with_data(lines: Iterable[str]) -> Iterator[str]:
    """The lines that hold cells. The fast parser skips others too, but warns about each."""
    for line in lines:
        text = line.lstrip()
        if text and not text.startswith("#"):
            yield line


def _separator(text: str) -> str | None:
    for separator in ("\t", ";", ","):
        if separator in text:
            return separator
    return None


def _cells(text: str, separator: str | None) -> list[str]:
    if separator is None:
        return [cell.strip() for cell in _BLANK_SEPARATED.findall(text)] or [""]
    return [cell.strip() for cell in text.split(separator)]


def _header_cell(file: Path, cell: str) -> tuple[str, str | None]:
    text = cell.strip().strip('"').strip()
    match = _HEADER_CELL.fullmatch(text)
    if match is None:
        return text, None
    return match[1], known_unit(str(file), text, match[2].strip())


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None


def _data_rows(file: Path, header_row: int) -> Iterator[tuple[int, str]]:
    with file.open(encoding="utf-8-sig") as lines:
        for number, line in enumerate(lines, start=1):
            text = line.split("#", 1)[0].strip("\r\n")
            if number > header_row and text.strip():
                yield number, text


def _first_bad_row(
    file: Path,
    header_row: int,
    separator: str | None,
    columns: list[tuple[str, str | None]],
    error: Exception | None,
) -> str:
    """The sentence about the first row that is not one number for each column."""
    for number, text in _data_rows(file, header_row):
        cells = [cell.strip() for cell in text.split(separator)]
        if len(cells) != len(columns):
            hint = (
                "write decimals with a point and separate columns with one sign"
                if separator == ","
                else "complete or remove the row"
            )
            return (
                f"{file}: row {number} has {len(cells)} cells but the header has "
                f"{len(columns)}: {hint}"
            )
        for (name, unit), cell in zip(columns, cells, strict=True):
            if not _is_number(cell):
                header = name if unit is None else f"{name} [{unit}]"
                what = f"{cell[:40]!r} is not a number" if cell else "is empty"
                remedy = (
                    "write decimals with a point"
                    if re.fullmatch(r"[+-]?\d+,\d+", cell)
                    else "correct or remove the row"
                )
                return f"{file}: row {number}, column {header!r}: {what}: {remedy}"
    return f"{file}: is not a table of numbers: {error}: export it again as CSV"


def _row_namer(file: Path, header_row: int) -> Callable[[int], str]:
    """Names the n-th data row by its line in the file, which is read again only for an error."""

    def row(index: int) -> str:
        number, _ = next(itertools.islice(_data_rows(file, header_row), index, None))
        return f"row {number}"

    return row


def _metadata(file: Path, comments: list[str], names: list[str]) -> dict[str, Any]:
    if not comments or comments[0] != _SIGNATURE:
        return {}
    said: dict[str, Any] = {}
    if names[:3] == list(_WRITTEN):
        # The columns of a written file have these names and may have any unit.
        said["columns"] = {role: role for role in _WRITTEN}
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
