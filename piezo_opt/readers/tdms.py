"""LabVIEW's binary files (TDMS) through npTDMS: channels with their units and their clock."""

from __future__ import annotations

import logging
import os
from typing import Any

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.files import checked, refuse_rows
from piezo_opt.readers.columns import Column, Table
from piezo_opt.readers.conventions import column_of
from piezo_opt.readers.extras import needed
from piezo_opt.readers.instants import seconds_from_stamps
from piezo_opt.readers.preamble import Steps


def table_from_tdms(path: str | os.PathLike[str]) -> Table:
    """The channels of a TDMS file as columns, called ``channel``, or ``group/channel`` of several.

    The clock is a channel of time, or the increment that LabVIEW keeps beside a waveform.

    Raises `InputError` where npTDMS is missing or the file is damaged.
    """
    file = checked(path)
    library = needed("nptdms", extra="tdms", what="TDMS files")
    # What the library writes to the console of a cut file is said here in a note.
    needed("nptdms.log", extra="tdms", what="TDMS files").log_manager.set_level(logging.ERROR)
    columns: list[Column] = []
    clocks: set[tuple[float, float]] = set()
    notes: list[str] = []
    try:
        with file.open("rb") as raw, library.TdmsFile.open(raw) as content:
            groups = content.groups()
            channels = [channel for group in groups for channel in group.channels()]
            kept, said = _kept(content.file_status, channels)
            notes += said
            for channel in channels:
                refuse_rows(file, len(channel))
                own = channel.name if len(groups) == 1 else f"{channel.group_name}/{channel.name}"
                column, clock = _column(str(file), own, channel, kept[channel.path])
                columns += [column] if column is not None else []
                clocks |= {clock} if clock is not None else set()
    except InputError:
        raise
    except Exception as error:  # a damaged file surfaces as any of the library's many errors
        raise InputError(
            f"{file}: is not a whole TDMS file: copy or export it again "
            f"({(str(error).splitlines() or [type(error).__name__])[0][:120]})"
        ) from error
    if len(clocks) > 1:
        notes.append("The channels have different clocks; those of the same clock belong together.")
    return Table(
        str(file),
        tuple(columns),
        lambda index: f"sample {index + 1}",
        notes=tuple(notes),
        steps=_steps(next(iter(clocks))) if len(clocks) == 1 else None,
    )


def _kept(status: Any, channels: list[Any]) -> tuple[dict[str, int], list[str]]:
    """How many values of each channel are used, and what is said of a file that is cut short.

    The last block of such a file holds the first channels whole and the others in part; channels
    that were equally long are used as far as all of them go.
    """
    lengths = {channel.path: len(channel) for channel in channels}
    if not status.incomplete_final_segment:
        return lengths, []
    lost = {
        path: one.expected_length - one.read_length
        for path, one in (status.channel_statuses or {}).items()
    }
    meant = {path: length + lost.get(path, 0) for path, length in lengths.items()}
    kept = {
        path: min(lengths[other] for other in lengths if meant[other] == meant[path])
        for path in lengths
    }
    return kept, [
        "The file ends within its last block, as a copy does that was cut short or a log that was "
        "broken off. What was read is shorter than what was measured."
    ]


def _column(
    file: str, name: str, channel: Any, kept: int
) -> tuple[Column | None, tuple[float, float] | None]:
    values = np.asarray(channel[:kept])
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
