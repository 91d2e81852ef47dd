"""Which column is the time, which the drive, which the position: by unit and by name."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, FloatArray, Measurement
from piezo_opt.units import parse_header, quantity, same_dimension, si_unit, to_si


@final
@dataclass(frozen=True)
class Column:
    """One column of a file: its name, its unit when the file says one, and its numbers."""

    name: str
    unit: str | None
    values: FloatArray

    @property
    def header(self) -> str:
        """As it is written in a file: ``voltage [V]``."""
        return self.name if self.unit is None else f"{self.name} [{self.unit}]"


@final
@dataclass(frozen=True)
class Table:
    """The columns of one file, and how a row is called in it."""

    file: str
    columns: tuple[Column, ...]
    row: Callable[[int], str]
    metadata: Mapping[str, Any]

    def listing(self) -> str:
        """The columns as a sentence shows them."""
        return ", ".join(repr(column.header) for column in self.columns) or "none"


@final
@dataclass(frozen=True)
class Wanted:
    """What a user said about a file: names of columns, and what the record is."""

    time: str | None = None
    drive: str | None = None
    position: str | None = None
    between: Between | None = None
    period: float | str | None = None
    startup: float | str | None = None
    allow_saturated: bool = False


@final
@dataclass(frozen=True)
class _Role:
    word: str
    unit: str
    example: str
    names: frozenset[str]


_TIME = _Role("time", "s", "time [s]", frozenset({"t", "time", "seconds"}))
_DRIVE = _Role(
    "drive",
    "V",
    "voltage [V]",
    frozenset({"u", "v", "voltage", "drive", "input", "command", "volt", "volts"}),
)
_POSITION = _Role(
    "position",
    "m",
    "displacement [um]",
    frozenset({"y", "x", "displacement", "position", "reading", "output", "disp"}),
)


def measurement_from(table: Table, name: str, wanted: Wanted) -> Measurement:
    """The record in a table; `InputError` names the file, the row or column, and the remedy."""
    own = table.metadata.get("columns", {})
    chosen = {
        "time": _choose(table, _TIME, wanted.time or own.get("time")),
        "drive": _choose(table, _DRIVE, wanted.drive or own.get("drive")),
        "position": _choose(table, _POSITION, wanted.position or own.get("position")),
    }
    indices = [index for index, _ in chosen.values()]
    if len(set(indices)) < len(indices):
        raise InputError(
            f"{table.file}: one column cannot serve twice: choose time, drive and position from "
            f"{table.listing()}"
        )
    converted = {role: _in_si(table, column) for role, (_, column) in chosen.items()}
    time = converted["time"][0]
    _check_order(table, chosen["time"][1], time)
    channels, channel_units = _channels(table, frozenset(indices), len(time))
    said = table.metadata
    period = wanted.period if wanted.period is not None else said.get("period")
    startup = wanted.startup if wanted.startup is not None else said.get("startup", 0.0)
    try:
        return Measurement(
            time=time,
            drive=converted["drive"][0],
            position=converted["position"][0],
            channels=channels,
            channel_units=channel_units,
            name=str(said.get("name", name)),
            drive_unit=converted["drive"][1],
            position_unit=converted["position"][1],
            between=wanted.between or said.get("between", Between.LINEAR),
            period=None if period is None else quantity(period, "s"),
            startup=quantity(startup, "s"),
            source=str(said.get("source", os.path.basename(table.file))),
            allow_saturated=wanted.allow_saturated or bool(said.get("allow_saturated", False)),
        )
    except InputError as error:
        raise InputError(f"{table.file}: {error}") from error


def _choose(table: Table, role: _Role, said: str | None) -> tuple[int, Column]:
    if said is not None:
        return _named(table, role, said)
    fitting = [
        (index, column)
        for index, column in enumerate(table.columns)
        if column.unit is not None and same_dimension(column.unit, role.unit)
    ]
    liked = [(i, column) for i, column in fitting if column.name.strip().lower() in role.names]
    if len(fitting) == 1:
        return fitting[0]
    if len(liked) == 1:
        return liked[0]
    if fitting:
        raise InputError(
            f"{table.file}: more than one column could be the {role.word}: "
            f"{', '.join(repr(column.header) for _, column in fitting)}; choose with "
            f"{role.word}='{fitting[0][1].header}'"
        )
    for column in table.columns:
        if column.name.strip().lower() in role.names:
            if column.unit is None:
                raise InputError(
                    f"{table.file}: column {column.header!r} has no unit: write it in the file, "
                    f"or say {role.word}='{column.name} [{role.unit}]'"
                )
            raise InputError(
                f"{table.file}: column {column.header!r} is no {role.word}, its unit must "
                f"measure what {role.unit} does: correct the unit, or name the column with "
                f"{role.word}='...'"
            )
    raise InputError(
        f"{table.file}: no column is the {role.word}: the columns are {table.listing()}; name "
        f"one like {role.example!r} or choose with {role.word}='...'"
    )


def _named(table: Table, role: _Role, said: str) -> tuple[int, Column]:
    wanted_name, wanted_unit = said.strip(), None
    matches = [(i, c) for i, c in enumerate(table.columns) if c.header == wanted_name]
    if not matches:
        if "[" in wanted_name:
            wanted_name, wanted_unit = parse_header(wanted_name)
        matches = [(i, c) for i, c in enumerate(table.columns) if c.name == wanted_name]
    if not matches:
        raise InputError(f"{table.file}: has no column {said!r}: the columns are {table.listing()}")
    if len(matches) > 1:
        raise InputError(
            f"{table.file}: has {len(matches)} columns {said!r}: give them different names"
        )
    index, column = matches[0]
    if wanted_unit is not None and column.unit is not None and wanted_unit != column.unit:
        raise InputError(
            f"{table.file}: column {column.header!r} has its own unit, not [{wanted_unit}]: "
            f"say {role.word}='{column.header}'"
        )
    unit = column.unit or wanted_unit
    if unit is None:
        raise InputError(
            f"{table.file}: column {column.name!r} has no unit: say "
            f"{role.word}='{column.name} [{role.unit}]'"
        )
    # Any drive or position is legal when named (a force, an angle), but time is time.
    if role is _TIME and not same_dimension(unit, "s"):
        raise InputError(f"{table.file}: column {column.header!r} is no time: use [s] or [ms]")
    return index, Column(column.name, unit, column.values)


def _in_si(table: Table, column: Column) -> tuple[FloatArray, str]:
    bad = np.flatnonzero(~np.isfinite(column.values))
    if bad.size:
        raise InputError(
            f"{table.file}: {table.row(int(bad[0]))}, column {column.header!r}: "
            f"{column.values[bad[0]]} is no reading: remove the row, gaps in time are allowed"
        )
    assert column.unit is not None
    try:
        with np.errstate(over="ignore"):
            return to_si(column.values, column.unit)
    except InputError as error:
        raise InputError(f"{table.file}: column {column.header!r}: {error}") from error


def _check_order(table: Table, column: Column, time: FloatArray) -> None:
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        index = int(late[0]) + 1
        kind = "repeats that of" if time[index] == time[index - 1] else "is before that of"
        raise InputError(
            f"{table.file}: {table.row(index)}, column {column.header!r}: the time "
            f"{column.values[index]:.12g} {kind} {table.row(index - 1)} "
            f"({column.values[index - 1]:.12g}): sort the rows and keep one for each instant"
        )


def _channels(
    table: Table, taken: frozenset[int], length: int
) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """The other columns with a unit, in SI; a column without one is not a signal."""
    channels: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    for index, column in enumerate(table.columns):
        if index in taken or column.unit is None or column.values.size != length:
            continue
        if column.name in channels:
            raise InputError(
                f"{table.file}: has two columns {column.name!r}: give them different names"
            )
        channels[column.name], units[column.name] = _in_si(table, column)
    return channels, units


def known_unit(file: str, header: str, unit: str) -> str:
    """The unit itself when it is known; `InputError` naming file and column when not."""
    try:
        si_unit(unit)
    except InputError as error:
        raise InputError(f"{file}: column {header!r}: {error}") from error
    return unit
