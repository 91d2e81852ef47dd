"""From the columns of a file to a record."""

from __future__ import annotations

import itertools
import os
from dataclasses import replace

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, FloatArray, Measurement
from piezo_opt.measurement.arrays import BoolArray, IndexArray
from piezo_opt.measurement.checks import DROWNED
from piezo_opt.readers.columns import (
    DRIVE,
    POSITION,
    TIME,
    Column,
    Table,
    candidates,
    choose,
    in_si,
    same_clock,
)
from piezo_opt.readers.drives import DriveSignal
from piezo_opt.readers.restarts import restarts
from piezo_opt.readers.wanted import Wanted, treated
from piezo_opt.units import quantity, same_dimension, show

LEFT_OUT = "left out"
"""Column of a written file: 1 where a reading is none."""
_RESERVED = ("time", "drive", "position")


def measurement_from(table: Table, name: str, wanted: Wanted) -> Measurement:
    """The record in a table; `InputError` names the file, the row or column, and the remedy."""
    own = table.metadata.get("columns", {})
    place, time, clock_notes = _time(table, wanted, own.get("time"))
    begin, end = wanted.stretch
    if begin is not None or end is not None:
        table, time, trimmed = _trimmed(table, time, begin, end)
        clock_notes = [*clock_notes, trimmed]
    drive_at, drive = choose(
        table, DRIVE, wanted.drive or own.get("drive"), taken=_given(table, wanted.position)
    )
    position_at, position = choose(
        table,
        POSITION,
        wanted.position or own.get("position"),
        fits=lambda unit: same_dimension(wanted.scaled_unit(unit), "m"),
        taken=frozenset({drive_at}) if wanted.factor is not None else frozenset(),
    )
    taken = frozenset({drive_at, position_at} | ({place} if place is not None else set()))
    if len(taken) < (2 if place is None else 3):
        raise InputError(
            f"{table.file}: one column cannot serve twice: choose one each as time, drive and "
            f"position; {table.listing()}"
        )
    for column in (drive, position):
        if column.values.size != time.size:
            raise InputError(
                f"{table.file}: {column.header!r} has {column.values.size} samples but the clock "
                f"{time.size}: choose columns of one record, with time='...', drive='...' and "
                "position='...'"
            )
    missing = [one.missing for one in (drive, position) if one.missing is not None]
    if missing:
        gone = np.any(missing, axis=0)
        table, time, clock_notes = _without(table, time, gone, clock_notes)
        drive = replace(table.columns[drive_at], unit=drive.unit)
        position = replace(table.columns[position_at], unit=position.unit)
    driven, drive_unit = in_si(table, drive)
    read, position_unit = in_si(table, position)
    if place is not None and wanted.rate is None:
        _check_order(table, table.columns[place], time)
    channels, channel_units, second = _channels(table, taken, place)
    clock_notes = [*clock_notes, *second]
    said = table.metadata
    # A file that this package wrote says which readings are none.
    left_out = channels.pop(LEFT_OUT, np.zeros(0)) if own else np.zeros(0)
    period = wanted.period if wanted.period is not None else said.get("period")
    startup = wanted.startup if wanted.startup is not None else said.get("startup", 0.0)
    try:
        record = Measurement(
            time=time,
            drive=driven,
            position=read,
            channels=channels,
            channel_units=channel_units,
            name=str(said.get("name", name)),
            drive_unit=drive_unit,
            position_unit=position_unit,
            between=wanted.between or said.get("between", Between.UNKNOWN),
            period=None if period is None else quantity(period, "s"),
            startup=quantity(startup, "s"),
            source=str(said.get("source", os.path.basename(table.file))),
            allow_saturated=wanted.allow_saturated or bool(said.get("allow_saturated", False)),
            left_out=left_out > 0,
            notes=(*table.notes, *clock_notes),
        )
        return treated(record, wanted)
    except InputError as error:
        already = str(error).startswith(table.file)
        raise InputError(str(error) if already else f"{table.file}: {error}") from error


def drive_from(table: Table, wanted: Wanted) -> DriveSignal:
    """The drive in a table, which needs no reading beside it.

    Raises:
        InputError: no column is the drive or the time, or the clock is out of order.
    """
    place, time, _ = _time(table, wanted, None)
    _, column = choose(table, DRIVE, wanted.drive)
    if column.values.size != time.size or time.size < 2:
        raise InputError(
            f"{table.file}: {column.header!r} has {column.values.size} samples and the clock "
            f"{time.size}: a drive needs two or more, and one instant for each"
        )
    values, unit = in_si(table, column)
    if place is not None and wanted.rate is None:
        _check_order(table, table.columns[place], time)
    held = wanted.between or Between.LINEAR
    return DriveSignal(time, values, unit, held, table.file)


def runs(table: Table, wanted: Wanted) -> tuple[Table, ...]:
    """The table, or its parts where the clock begins anew; a given rate makes one run of all."""
    place, time, _ = _time(table, wanted, table.metadata.get("columns", {}).get("time"))
    at = restarts(time) if place is not None and wanted.rate is None else np.zeros(0, np.intp)
    if at.size == 0:
        return (table,)
    note = (
        f"The clock begins anew at {table.row(int(at[0]))}: the file was read as {at.size + 1} "
        "records."
    )
    ends = [0, *at.tolist(), time.size]
    return tuple(
        replace(_rows(table, time.size, np.arange(a, b)), notes=(*table.notes, note))
        for a, b in itertools.pairwise(ends)
    )


def _given(table: Table, said: str | None) -> frozenset[int]:
    """The place of a column that the caller gives to another role, where others are left."""
    if said is None:
        return frozenset()
    given = frozenset({choose(table, POSITION, said)[0]})
    others = candidates(table, lambda unit: same_dimension(unit, DRIVE.unit), given)
    return given if others else frozenset()


def _time(
    table: Table, wanted: Wanted, own: str | None
) -> tuple[int | None, FloatArray, list[str]]:
    """The place of the column of time, the instants [s], and what was concluded about them."""
    said = wanted.time or own
    has_column = said is not None or bool(candidates(table, lambda u: same_dimension(u, "s")))
    if (hertz := wanted.hertz) is not None:
        count = max((column.values.size for column in table.columns), default=0)
        note = f"The clock is even, at the {hertz:g} Hz that were given"
        place = None
        if has_column:
            place, column = choose(table, TIME, said)
            count = column.values.size
            note += f"; column {column.header!r} was not used"
        return place, np.arange(count) / hertz, [f"{note}."]
    if not has_column and table.steps is not None and wanted.rate is None:
        count = max((column.values.size for column in table.columns), default=0)
        steps = table.steps
        instants = np.arange(count, dtype=np.float64) * steps.step + steps.start
        return None, instants, [steps.said]
    place, column = choose(table, TIME, said)
    time, _ = in_si(table, column)
    if wanted.rate == "even" and time.size > 1:
        if not time[-1] > time[0]:
            raise InputError(
                f"{table.file}: column {column.header!r} does not end after it begins, so there "
                "is no even clock between its ends: give the rate, rate='1 kHz'"
            )
        step = (time[-1] - time[0]) / (time.size - 1)
        note = f"The clock is even between the ends of {column.header!r}: {step:g} s a sample."
        return place, np.linspace(time[0], time[-1], time.size), [note]
    if _drowns(time):
        # Before it becomes seconds: whole milliseconds of an epoch lose digits there.
        time, _ = in_si(table, replace(column, values=column.values - column.values[0]))
        first = f"{column.values[0]:.15g}"
        return place, time, [f"Column {column.header!r} is counted from its first value, {first}."]
    return place, time, []


def _drowns(time: FloatArray) -> bool:
    """Whether a clock that counts from another age has steps too small beside its numbers."""
    steps = np.diff(time)
    shortest = float(steps[steps > 0.0].min(initial=np.inf))
    return bool(shortest < DROWNED * float(np.max(np.abs(time), initial=0.0)))


def _trimmed(
    table: Table, time: FloatArray, begin: float | None, end: float | None
) -> tuple[Table, FloatArray, str]:
    """The rows with begin <= time < end, each called as before."""
    slack = 1e-9 * float(np.ptp(time)) / max(time.size, 1)
    inside = time >= (-np.inf if begin is None else begin) - slack
    inside &= time < (np.inf if end is None else end) - slack
    kept = np.flatnonzero(inside)
    if kept.size == 0:
        raise InputError(
            f"{table.file}: nothing lies in the stretch that was asked, the record runs from "
            f"{time.min():g} s to {time.max():g} s: choose another with trim='...'"
        )
    note = f"Samples {kept[0] + 1} to {kept[-1] + 1} of {time.size} were kept."
    return _rows(table, time.size, kept), time[kept], note


def _without(
    table: Table, time: FloatArray, gone: BoolArray, notes: list[str]
) -> tuple[Table, FloatArray, list[str]]:
    """The rows whose readings the file does not mark as missing."""
    kept = np.flatnonzero(~gone)
    if kept.size == 0:
        raise InputError(f"{table.file}: marks every reading as missing: export it again")
    first = table.row(int(np.flatnonzero(gone)[0]))
    note = (
        f"{np.count_nonzero(gone)} of {gone.size} samples are marked as missing in the file and "
        f"were left out, the first at {first}."
    )
    return _rows(table, time.size, kept), time[kept], [*notes, note]


def _rows(table: Table, count: int, kept: IndexArray) -> Table:
    """Some rows of a table, each called as before."""

    def part(column: Column) -> Column:
        if column.values.size != count:
            return column
        missing = None if column.missing is None else column.missing[kept]
        return replace(column, values=column.values[kept], missing=missing)

    whole = table.row
    columns = tuple(part(column) for column in table.columns)
    return replace(table, columns=columns, row=lambda index: whole(int(kept[index])))


def _check_order(table: Table, column: Column, time: FloatArray) -> None:
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size == 0:
        return
    index = int(late[0]) + 1
    again = time[index] == time[index - 1]
    rows = f"{table.row(index - 1)} ({column.values[index - 1]:.12g})"
    where = f"{table.file}: {table.row(index)}, column {column.header!r}: the time"
    if again and not np.any(np.diff(time) < 0) and late.size > 0.2 * time.size:
        raise InputError(
            f"{where} {column.values[index]:.12g} repeats that of {rows}, and so does that of "
            f"{late.size} rows: the clock is printed with too few digits; give the rate, "
            "rate='1 kHz', or rate='even' for an even clock between its ends"
        )
    kind = "repeats that of" if again else "is before that of"
    remedy = (
        "remove one of the two rows"
        if late.size == 1 and again
        else f"the clock begins anew there, so these are {count} records: take all with "
        "record='all' (read_campaign in Python) or one of them with record='1'; where only the "
        "clock jumped, make one record of them with the rate, rate='1 kHz'"
        if (count := restarts(time).size + 1) > 1
        else "put the rows in the order of time, or give the rate, rate='1 kHz', where the clock "
        "is wrong"
    )
    raise InputError(f"{where} {column.values[index]:.12g} {kind} {rows}: {remedy}")


def _channels(
    table: Table, taken: frozenset[int], clock: int | None
) -> tuple[dict[str, FloatArray], dict[str, str], list[str]]:
    """The other columns with a unit, in SI, and sentences; a column without one is no signal.

    The clock again, as oscilloscopes write it beside every channel, is none either, but for a file
    of this package; another clock is told, because what stands beside it may have been sampled by
    it.
    """
    channels: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    notes: list[str] = []
    length = max((table.columns[index].values.size for index in taken), default=0)
    own = None if clock is None else table.columns[clock]
    for index, column in enumerate(table.columns):
        if index in taken or column.unit is None or column.values.size != length:
            continue
        if own is not None and same_dimension(column.unit, "s"):
            if same_clock(own, column) and not table.metadata:
                continue
            notes += _other_clock(table, own, column)
        if column.name in channels:
            raise InputError(
                f"{table.file}: has two columns {column.name!r}: give them different names"
            )
        # A set point beside the measurement may have the name that the measurement has here.
        name = f"{column.name} column" if column.name in _RESERVED else column.name
        channels[name], units[name] = in_si(table, column)
    return channels, units, notes


def _other_clock(table: Table, own: Column, other: Column) -> list[str]:
    """A sentence where a second column of time keeps time with the first one, but is not it."""
    first, second = in_si(table, own)[0], in_si(table, other)[0]
    off = np.abs(second - first)
    if not (np.diff(second) > 0.0).all() or not off.max() < 0.5 * float(np.ptp(first)):
        return []
    return [
        f"Column {other.header!r} is a clock as well, off by up to {show(float(off.max()), 's')} "
        f"from {own.header!r}, which was taken for all signals."
    ]
