"""LabVIEW measurement files (.lvm): text with a header for the file and one for each segment.

The headers say separator, decimal sign, units and the clock's start and step (National Instruments,
"Specification for the LabVIEW Measurement File (.lvm)"); `X_Columns` says whether the clock has a
column (One), one for each channel (Multi) or none (No).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.files import checked, refuse_rows
from piezo_opt.measurement import FloatArray
from piezo_opt.readers.columns import Column, Table
from piezo_opt.readers.headers import header_cell, unit_word
from piezo_opt.readers.preamble import Steps
from piezo_opt.readers.text import encoding_of

_END: Final = "***End_of_Header***"
_FIRST: Final = "LabVIEW Measurement"
_SEPARATORS: Final = {"tab": "\t", "comma": ","}


@final
@dataclass(frozen=True)
class _Segment:
    """What the header of a segment says, the names of its columns, and its rows."""

    said: dict[str, list[str]]
    names: list[str]
    rows: FloatArray
    first_row: int


def table_from_lvm(path: str | os.PathLike[str], *, decimal: str | None = None) -> Table:
    """The channels of a LabVIEW measurement file as columns.

    Raises `InputError` for a file that is none, a row that does not fit, or several segments whose
    clocks do not go on from one to the next.
    """
    file = checked(path)
    encoding, said = encoding_of(file)
    lines = file.read_text(encoding=encoding).splitlines()
    if not lines or not lines[0].startswith(_FIRST):
        raise InputError(
            f"{file}: does not begin with {_FIRST!r}: give it the suffix .txt to have it read as a "
            "table"
        )
    ends = [k for k, line in enumerate(lines) if line.startswith(_END)]
    if len(ends) < 2:
        raise InputError(f"{file}: has no segment with a header: export it again")
    whole = {key: values for key, *values in (_cells(x, None) for x in lines[: ends[0]])}
    separator = _SEPARATORS.get(_word(whole, "Separator").lower(), "\t")
    whole = {key: values for key, *values in (_cells(x, separator) for x in lines[: ends[0]])}
    sign = decimal or _word(whole, "Decimal_Separator") or "."
    segments = [
        _segment(file, lines, before, end, after, separator, sign)
        for before, end, after in zip(
            ends[:-1], ends[1:], [*_heads(lines, ends), len(lines)], strict=True
        )
    ]
    first = segments[0]
    for other in segments[1:]:
        if other.names != first.names:
            raise InputError(f"{file}: its segments have different channels: read one of them")
    rows = np.concatenate([one.rows for one in segments])
    refuse_rows(file, rows.shape[0])
    columns, steps, notes = _columns(whole, first, rows)
    if steps is not None and len(segments) > 1:
        raise InputError(
            f"{file}: holds {len(segments)} segments, each with a clock of its own: save one "
            "segment a file, or the clock in a column (X_Columns One)"
        )
    if said is not None:
        notes = [said, *notes]
    numbers = [k for one in segments for k in range(one.first_row, one.first_row + len(one.rows))]
    return Table(
        str(file),
        tuple(columns),
        lambda index: f"row {numbers[index]}",
        notes=tuple(notes),
        steps=steps,
    )


def _heads(lines: Sequence[str], ends: Sequence[int]) -> list[int]:
    """Where the second and every further segment's header begins."""
    begins = []
    for end in ends[2:]:
        at = end
        while at > 0 and not lines[at - 1].startswith("Channels"):
            at -= 1
        begins.append(at - 1)
    return begins


def _segment(
    file: Path,
    lines: Sequence[str],
    before: int,
    end: int,
    after: int,
    separator: str,
    sign: str,
) -> _Segment:
    said = {k: v for k, *v in (_cells(x, separator) for x in lines[before + 1 : end]) if k}
    body = [k for k in range(end + 1, after) if lines[k].strip()]
    if len(body) < 2:
        raise InputError(f"{file}: row {end + 1}: a segment without rows: export it again")
    names = _cells(lines[body[0]], separator)
    if "Comment" in names:
        names = names[: names.index("Comment")]
    width = len(names)
    rows = np.empty((len(body) - 1, width))
    for row, place in enumerate(body[1:]):
        cells = _cells(lines[place], separator)
        try:
            numbers = [float(c.replace(sign, ".")) if c else np.nan for c in cells[:width]]
        except ValueError:
            numbers = []
        if len(numbers) > width or not numbers:
            raise InputError(
                f"{file}: row {place + 1} is not one number for each of {', '.join(names)}: "
                "correct or remove the row"
            )
        rows[row] = [*numbers, *[np.nan] * (width - len(numbers))]
    return _Segment(said, names, rows, body[1] + 1)


def _columns(
    whole: dict[str, list[str]], first: _Segment, rows: FloatArray
) -> tuple[list[Column], Steps | None, list[str]]:
    """The columns with their units, the clock where it has no column, and what was concluded."""
    units = [unit_word(word) for word in first.said.get("Y_Unit_Label", [])]
    has_time = _word(first.said, "X_Dimension").lower() in ("", "time")
    columns: list[Column] = []
    channel = 0
    kind = _word(whole, "X_Columns").lower() or "one"
    for k, name in enumerate(first.names):
        own, unit = header_cell("", name) if "[" not in name else (name, None)
        if name.lower().startswith("x_value"):
            values, unit = rows[:, k], "s" if has_time else None
            again = any(np.array_equal(values, one.values) for one in columns if one.unit == "s")
            if kind == "no" or again or np.all(np.isnan(values)):
                continue
        else:
            unit = unit or (units[channel] if channel < len(units) else None)
            channel += 1
            values = rows[:, k]
        columns.append(Column(own, unit, np.ascontiguousarray(values)))
    notes = ["Names, units and clock are those of the file's LabVIEW headers."]
    if any(one.unit == "s" for one in columns) or not has_time:
        return columns, None, notes
    step = _figure(first.said, "Delta_X")
    if step is None or step <= 0.0:
        return columns, None, notes
    said = f"The file has no column of time; it was made from 'Delta_X': {step:g} s."
    return columns, Steps(_figure(first.said, "X0") or 0.0, step, said), notes


def _cells(line: str, separator: str | None) -> list[str]:
    """The cells of a line, at least one; None for what parts the lines of the first header."""
    parts = line.replace(",", "\t").split("\t") if separator is None else line.split(separator)
    return [part.strip() for part in parts]


def _word(said: dict[str, list[str]], key: str) -> str:
    return next((word for word in said.get(key, []) if word), "")


def _figure(said: dict[str, list[str]], key: str) -> float | None:
    try:
        return float(_word(said, key).replace(",", "."))
    except ValueError:
        return None
