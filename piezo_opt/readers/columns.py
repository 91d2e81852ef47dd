"""Which column is the time, which the drive, which the position: by unit, name or number."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement import FloatArray
from piezo_opt.measurement.arrays import BoolArray
from piezo_opt.readers.preamble import Steps
from piezo_opt.units import parse_header, same_dimension, to_si


@final
@dataclass(frozen=True)
class Column:
    """One column of a file: its name, its unit when the file says one, and its numbers.

    A column of text or without cells has no numbers; it keeps its place, and ``sample`` is one of
    its cells; ``sparse`` is one of empty cells with numbers among them. ``missing`` marks the
    samples that the file itself says were not taken.
    """

    name: str
    unit: str | None
    values: FloatArray
    missing: BoolArray | None = None
    sample: str = ""
    sparse: bool = False

    @property
    def header(self) -> str:
        """As it is written in a file: ``voltage [V]``."""
        return self.name if self.unit is None else f"{self.name} [{self.unit}]"


@final
@dataclass(frozen=True)
class Table:
    """The columns of one file, how a row is called in it, and what was concluded about it.

    Attributes:
        file: what messages call it.
        columns: all of them, in the file's order.
        row: the name of the n-th row, from 0.
        metadata: what a file of this package says about its record.
        notes: what was concluded, in sentences.
        steps: the clock of a file without a column of time.
    """

    file: str
    columns: tuple[Column, ...]
    row: Callable[[int], str]
    metadata: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    steps: Steps | None = None

    def listing(self) -> str:
        """What there is to choose from, as the end of a sentence, at most a dozen columns."""
        shown = [repr(column.header) for column in self.columns if column.values.size]
        others = [
            f"{column.header!r} has empty cells: fill them, or save what was sampled more slowly "
            "as a file of its own"
            if column.sparse
            else f"{column.header!r} holds no numbers"
            + (f" ({column.sample[:40]!r})" if column.sample else "")
            for column in self.columns
            if column.name and not column.values.size
        ]
        if not shown:
            return "; ".join(["there are no columns of numbers", *_few(others)])
        return "; ".join([f"the columns are {', '.join(_few(shown))}", *_few(others)])


def _few(parts: list[str]) -> list[str]:
    more = [f"{len(parts) - _LISTED} more"] if len(parts) > _LISTED else []
    return [*parts[:_LISTED], *more]


@final
@dataclass(frozen=True)
class Role:
    """What a column can be: its word, a unit of its kind, an example, and usual names."""

    word: str
    unit: str
    example: str
    names: frozenset[str]

    @property
    def usual(self) -> str:
        """The unit of the example."""
        return parse_header(self.example)[1] or self.unit


_LISTED: Final = 12
TIME: Final = Role("time", "s", "time [s]", frozenset({"t", "time", "seconds", "zeit"}))
DRIVE: Final = Role(
    "drive",
    "V",
    "voltage [V]",
    frozenset({"u", "v", "voltage", "drive", "input", "command", "volt", "volts", "spannung"}),
)
POSITION: Final = Role(
    "position",
    "m",
    "displacement [um]",
    frozenset({"y", "x", "displacement", "position", "reading", "output", "disp", "weg"}),
)


def choose(
    table: Table,
    role: Role,
    said: str | None,
    *,
    fits: Callable[[str], bool] | None = None,
    taken: frozenset[int] = frozenset(),
) -> tuple[int, Column]:
    """Place and column of a role.

    Args:
        table: the columns.
        role: what is looked for.
        said: name, ``"u [V]"``, number from 1 or ``"2 [V]"``, when the caller says one.
        fits: whether a unit is one of this role; by default what the role's own unit measures.
        taken: places that are another role's already.

    Raises:
        InputError: no column fits, or several do; the options are written out.
    """
    if said is not None:
        return _named(table, role, said)
    fits = fits or (lambda unit: same_dimension(unit, role.unit))
    fitting = candidates(table, fits, taken)
    liked = [(i, column) for i, column in fitting if column.name.strip().lower() in role.names]
    if len(fitting) == 1:
        return fitting[0]
    if len(liked) == 1:
        return liked[0]
    # Oscilloscopes write the clock beside every channel.
    if fitting and role is TIME and all(same_clock(fitting[0][1], one) for _, one in fitting):
        return fitting[0]
    if fitting:
        headers = [column.header for _, column in fitting]
        # Columns of one name are told apart by their numbers.
        calls = headers if len({*headers}) == len(headers) else [str(i + 1) for i, _ in fitting]
        raise InputError(
            f"{table.file}: more than one column could be the {role.word}: "
            f"{', '.join(map(repr, _few(headers)))}; choose with "
            + " or ".join(f"{role.word}='{call}'" for call in calls[:4])
        )
    for column in table.columns:
        if column.values.size and column.name.strip().lower() in role.names:
            if column.unit is None:
                raise InputError(f"{table.file}: {_without_unit(table)}")
            sensor = role is POSITION and same_dimension(column.unit, "V")
            raise InputError(
                f"{table.file}: column {column.header!r} is no {role.word}, its unit must "
                f"measure what {role.unit} does: correct the unit, or "
                + (
                    "give what the sensor's volts are, scale='2.5 um/V'"
                    if sensor
                    else f"name the column with {role.word}='...'"
                )
            )
    rate = ", or give the sampling rate, rate='1 kHz'" if role is TIME else ""
    raise InputError(
        f"{table.file}: no column is the {role.word}: {table.listing()}; name "
        f"one like {role.example!r} or choose with {role.word}='...'{rate}"
    )


def same_clock(one: Column, other: Column) -> bool:
    """Whether two columns hold the same instants in the same unit."""
    return one.unit == other.unit and np.array_equal(one.values, other.values)


def _without_unit(table: Table) -> str:
    """Every column whose name tells its role and whose unit nobody tells, with what to say."""
    bare = [
        (column.name, role)
        for role in (TIME, DRIVE, POSITION)
        for column in table.columns
        if column.values.size and column.unit is None and column.name.strip().lower() in role.names
    ]
    one = len(bare) == 1
    return (
        f"{'column' if one else 'columns'} {' and '.join(repr(name) for name, _ in bare)} "
        f"{'has' if one else 'have'} no unit: write it in the file, or say it, for example "
        + " ".join(f"{role.word}='{name} [{role.usual}]'" for name, role in bare)
    )


def candidates(
    table: Table, fits: Callable[[str], bool], taken: frozenset[int] = frozenset()
) -> list[tuple[int, Column]]:
    """Columns with numbers and a unit of this kind."""
    return [
        (index, column)
        for index, column in enumerate(table.columns)
        if column.unit is not None
        and column.values.size
        and index not in taken
        and fits(column.unit)
    ]


def by_number(said: str | None) -> bool:
    """Whether a column is called by its number: ``"2"`` or ``"2 [V]"``."""
    return said is not None and said.partition("[")[0].strip().isdecimal()


def _named(table: Table, role: Role, said: str) -> tuple[int, Column]:
    wanted_name, wanted_unit = said.strip(), None
    matches = [(i, c) for i, c in enumerate(table.columns) if c.header == wanted_name]
    if not matches:
        if "[" in wanted_name:
            wanted_name, wanted_unit = parse_header(wanted_name)
        matches = [(i, c) for i, c in enumerate(table.columns) if c.name == wanted_name]
    if not matches and by_number(wanted_name) and 1 <= int(wanted_name) <= len(table.columns):
        place = int(wanted_name) - 1
        matches = [(place, table.columns[place])]
    if not matches:
        raise InputError(f"{table.file}: has no column {said!r}: {table.listing()}")
    if len(matches) > 1:
        raise InputError(
            f"{table.file}: has {len(matches)} columns {said!r}: give them different names, or "
            f"say which by number, {role.word}='{matches[0][0] + 1}'"
        )
    index, column = matches[0]
    if not column.values.size:
        raise InputError(f"{table.file}: column {column.header!r} holds no numbers: choose another")
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
    if role is TIME and not same_dimension(unit, "s"):
        raise InputError(f"{table.file}: column {column.header!r} is no time: use [s] or [ms]")
    return index, replace(column, unit=unit)


def in_si(table: Table, column: Column) -> tuple[FloatArray, str]:
    """The numbers of a column in SI, and the SI unit; refuses what is not finite by its row."""
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
