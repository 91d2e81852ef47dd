"""LabVIEW's binary files (TDMS) through npTDMS: channels with their units and their clock."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.readers.columns import Column, Table
from piezo_opt.readers.conventions import column_of
from piezo_opt.readers.extras import needed
from piezo_opt.readers.files import checked, refuse_rows
from piezo_opt.readers.instants import seconds_from_stamps
from piezo_opt.readers.preamble import Steps


def table_from_tdms(path: str | os.PathLike[str]) -> Table:
    """The channels of a TDMS file as columns, called ``channel``, or ``group/channel`` of several.

    The clock is a channel of time, or the increment that LabVIEW keeps beside a waveform.

    Raises `InputError` where npTDMS is missing or the file is damaged.
    """
    file = checked(path)
    library = needed("nptdms", extra="tdms", what="TDMS files")
    columns: list[Column] = []
    clocks: set[tuple[float, float]] = set()
    try:
        with library.TdmsFile.open(file) as content:
            groups = content.groups()
            for group in groups:
                for channel in group.channels():
                    refuse_rows(file, len(channel))
                    several = len(groups) > 1
                    name = f"{group.name}/{channel.name}" if several else channel.name
                    column, clock = _column(str(file), name, channel)
                    columns += [column] if column is not None else []
                    clocks |= {clock} if clock is not None else set()
    except InputError:
        raise
    except Exception as error:  # a damaged file surfaces as any of the library's many errors
        raise InputError(
            f"{file}: is not a whole TDMS file: copy or export it again "
            f"({(str(error).splitlines() or [type(error).__name__])[0][:120]})"
        ) from error
    notes = []
    if len(clocks) > 1:
        notes.append("The channels have different clocks; those of the same clock belong together.")
    return Table(
        str(file),
        tuple(columns),
        lambda index: f"sample {index + 1}",
        notes=tuple(notes),
        steps=_steps(next(iter(clocks))) if len(clocks) == 1 else None,
    )


def _column(file: str, name: str, channel: Any) -> tuple[Column | None, tuple[float, float] | None]:
    values = np.asarray(channel[:])
    step = channel.properties.get("wf_increment")
    clock = None
    if isinstance(step, int | float | np.number) and float(step) > 0.0 and values.size:
        clock = float(channel.properties.get("wf_start_offset", 0.0)), float(step)
    if values.dtype.kind == "M" and values.size:
        return Column(name, "s", seconds_from_stamps(values)), None
    if values.dtype.kind not in "fiu" or values.size == 0:
        return None, None
    unit = str(channel.properties.get("unit_string", "")).strip()
    column, _ = column_of(file, name, values, {"unit": unit} if unit else {})
    return column, clock


def _steps(clock: tuple[float, float]) -> Steps:
    start, step = clock
    said = f"The file has no column of time; it was made from 'wf_increment': {step:g} s."
    return Steps(start, step, said)
