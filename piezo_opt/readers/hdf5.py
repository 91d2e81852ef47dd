"""HDF5: every number and every word of one or several records, and nothing else.

The layout that `write_hdf5` writes and `campaign_from_hdf5` reads without loss:

    /                       attributes  format = "piezo_opt records", version = 1
    /record_0000            attributes  name, between ("linear", "held", "bandlimited"), source,
                                        startup [s], allow_saturated, and period [s] if there is one
    /record_0000/time       float64 (N,), attribute unit = "s"
    /record_0000/drive      float64 (N,), attribute unit, for example "V"
    /record_0000/position   float64 (N,), attribute unit, for example "m"
    /record_0000/left_out   float64 (N,), 1 where a reading is none; only where there is such a one
    /record_0000/channels/channel_0000   float64 (N,), attributes name and unit
    /record_0001 ...

Signals are compressed without loss (shuffle, deflate) and carry a checksum, and so does all else:
the file has the format of HDF5 1.10, whose metadata are checked, and text of fixed length.

In any other HDF5 file, and in netCDF-4 files, which are such, data sets of one or two dimensions
are taken as columns; what their attributes mean is in ``conventions.py``.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.files import checked, refuse_rows, replacing
from piezo_opt.measurement import Between, Campaign, FloatArray, Measurement
from piezo_opt.readers.columns import Column, Table
from piezo_opt.readers.conventions import column_of
from piezo_opt.readers.headers import known_unit
from piezo_opt.readers.memory import hdf5_in_memory
from piezo_opt.readers.preamble import steps_of
from piezo_opt.readers.probe import OWN, survives

_VERSION = 1
_WIDEST = 64
"""Signals that a matrix may hold."""


def campaign_from_hdf5(path: str | os.PathLike[str]) -> Campaign | None:
    """The records of a file in this package's layout; None for a file in another layout.

    Raises `InputError` for a file that is no HDF5, is cut short, or breaks the layout.
    """
    file = checked(path)
    with opened(file) as content:
        if text_of(content.attrs.get("format", "")) != OWN:
            return None
        version = content.attrs.get("version")
        if version != _VERSION:
            raise InputError(
                f"{file}: has layout version {version}, this package reads {_VERSION}: update it"
            )
        # A file of a fit has the group "fit" beside its records.
        records = tuple(_record(file, content[name]) for name in sorted(content) if name != "fit")
    try:
        return Campaign(records)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error


def table_from_hdf5(path: str | os.PathLike[str]) -> Table:
    """The signals of any HDF5 or netCDF-4 file as columns, unpacked as their attributes say.

    Vectors, matrices along their shorter side and the fields of tables; a column is called by the
    path of its data set, with ``(:,2)`` or ``.field`` behind it.

    Raises:
        InputError: all there is are arrays with more axes, as of stages with several drives.
    """
    file = checked(path)
    columns: list[Column] = []
    notes: list[str] = []
    told: list[tuple[str, str]] = []
    arrays: list[str] = []
    with opened(file) as content:

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.size == 1 and item.dtype.kind in "fiu":
                told.append((name.rpartition("/")[2], repr(float(np.asarray(item[()]).item()))))
            elif isinstance(item, h5py.Dataset) and 0 < len(item.shape or ()) <= 2:
                attributes = dict(item.attrs)
                told.extend(_clock_words(attributes))
                for own, values in _signals(file, name, item):
                    column, said = column_of(str(file), own, values, attributes)
                    columns.append(column)
                    notes.extend(said)
            elif isinstance(item, h5py.Dataset) and len(item.shape or ()) > 2:
                arrays.append(f"{name!r} with {len(item.shape)}")

        told.extend(_clock_words(content.attrs))
        content.visititems(visit)
    if arrays and not columns:
        raise InputError(
            f"{file}: holds arrays and no columns ({arrays[0]} axes): a stage with several drives "
            "and positions is identified with 'piezo-opt axes fit'; else save time, drive and "
            "position of one axis as columns"
        )
    steps = steps_of((), (), [(key, value) for key, value in told])
    rows = "index {}".format
    return Table(str(file), tuple(columns), rows, notes=tuple(notes), steps=steps)


def _clock_words(attributes: Any) -> list[tuple[str, str]]:
    """Attributes that hold one number, where a rate or an increment may stand."""
    return [
        (str(key), repr(float(value)))
        for key, value in attributes.items()
        if np.ndim(value) == 0 and isinstance(value, int | float | np.integer | np.floating)
    ]


def _signals(file: Path, name: str, item: Any) -> Iterator[tuple[str, Any]]:
    """The numbers of a data set, column by column; none of one that holds something else."""
    shape = item.shape
    longest = max(shape)
    if item.dtype.names is not None and len(shape) == 1 and longest > 1:
        refuse_rows(file, longest)
        stored = item[()]
        for field in item.dtype.names:
            if stored[field].dtype.kind in "fiu" and stored[field].ndim == 1:
                yield f"{name}.{field}", stored[field]
    elif item.dtype.kind in "fiu" and longest > 1 and item.size // longest <= _WIDEST:
        refuse_rows(file, longest)
        stored = np.asarray(item[()])
        if item.size == longest:
            yield name, stored.reshape(-1)
        elif shape[0] >= shape[1]:
            yield from ((f"{name}(:,{k + 1})", stored[:, k]) for k in range(shape[1]))
        else:
            yield from ((f"{name}({k + 1},:)", stored[k]) for k in range(shape[0]))
    elif longest > 1:
        yield name, np.zeros(0)  # what it holds is no number: it is named, and cannot be chosen


def write_hdf5(
    records: Measurement | Iterable[Measurement] | Campaign,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
) -> None:
    """Write records without loss, in one step: all of the file or none of it."""
    campaign = Campaign.of(records)
    for record in campaign:
        for text in (record.name, record.source, *record.channels):
            if "\0" in text or any("\ud800" <= sign <= "\udfff" for sign in text):
                raise InputError(f"{path}: {text!r} cannot be stored as text: rename it")
    with (
        replacing(path, overwrite=overwrite) as temporary,
        hdf5_in_memory(temporary) as content,
    ):
        content.attrs["format"] = _stored(OWN)
        content.attrs["version"] = _VERSION
        for number, record in enumerate(campaign):
            _write_record(content.create_group(f"record_{number:04d}"), record)


def _write_record(group: Any, record: Measurement) -> None:
    group.attrs["name"] = _stored(record.name)
    group.attrs["between"] = _stored(record.between.value)
    group.attrs["source"] = _stored(record.source)
    group.attrs["startup"] = np.float64(record.startup)
    group.attrs["allow_saturated"] = np.bool_(record.allow_saturated)
    if record.period is not None:
        group.attrs["period"] = np.float64(record.period)
    if record.left_out.any():
        _write_signal(group, "left_out", record.left_out.astype(np.float64), "1")
    _write_signal(group, "time", record.time, "s")
    _write_signal(group, "drive", record.drive, record.drive_unit)
    _write_signal(group, "position", record.position, record.position_unit)
    for number, (name, values) in enumerate(record.channels.items()):
        where = f"channels/channel_{number:04d}"
        _write_signal(group, where, values, record.channel_units[name])
        group[where].attrs["name"] = _stored(name)


def _write_signal(group: Any, name: str, values: FloatArray, unit: str) -> None:
    stored = group.create_dataset(
        name, data=values, compression="gzip", compression_opts=9, shuffle=True, fletcher32=True
    )
    stored.attrs["unit"] = _stored(unit)


@contextmanager
def opened(file: Path) -> Iterator[Any]:
    """The file, opened; whatever the library does with a damaged one is an `InputError`."""
    damaged = f"{file}: is not a whole HDF5 file: copy or export it again"
    if not survives(file):
        raise InputError(f"{damaged} (the library that reads it does not get to its end)")
    try:
        with h5py.File(file, "r") as content:
            yield content
    except InputError:
        raise
    except PermissionError as error:
        raise InputError(f"{file}: may not be read: change its permissions") from error
    except Exception as error:  # a damaged file surfaces as any of the library's many errors
        raise InputError(f"{damaged} ({_first_line(error)})") from error


def _record(file: Path, group: Any) -> Measurement:
    where = group.name
    if not isinstance(group, h5py.Group):
        raise InputError(f"{file}: {where} is not a record: export the file again")
    for name in ("time", "drive", "position"):
        if not isinstance(group.get(name), h5py.Dataset):
            raise InputError(f"{file}: {where} has no signal {name!r}: export the file again")
    attributes = dict(group.attrs)
    further = group.get("channels", {})
    channels = {text_of(further[one].attrs["name"]): further[one] for one in sorted(further)}
    try:
        return Measurement(
            time=_numbers(file, group["time"]),
            drive=_numbers(file, group["drive"]),
            position=_numbers(file, group["position"]),
            channels={name: _numbers(file, stored) for name, stored in channels.items()},
            channel_units={name: _unit(file, stored) for name, stored in channels.items()},
            name=text_of(attributes["name"]),
            drive_unit=_unit(file, group["drive"]),
            position_unit=_unit(file, group["position"]),
            between=Between(text_of(attributes["between"])),
            period=float(attributes["period"]) if "period" in attributes else None,
            startup=float(attributes["startup"]),
            source=text_of(attributes["source"]),
            allow_saturated=bool(attributes["allow_saturated"]),
            left_out=(_numbers(file, group["left_out"]) if "left_out" in group else np.zeros(0))
            > 0,
        )
    except InputError as error:
        already = str(error).startswith(str(file))
        raise InputError(str(error) if already else f"{file}: {error}") from error
    except KeyError as error:
        raise InputError(f"{file}: {where} lacks {error}: export the file again") from error


def _unit(file: Path, stored: Any) -> str:
    unit = text_of(stored.attrs.get("unit", ""))
    return known_unit(str(file), stored.name, unit)


def _numbers(file: Path, stored: Any) -> FloatArray:
    refuse_rows(file, int(stored.size))
    if stored.dtype.kind not in "fiu":
        raise InputError(f"{file}: {stored.name} does not hold real numbers: export it again")
    return np.asarray(stored[()], dtype=np.float64).reshape(-1)


def _stored(text: str) -> Any:
    """Text of fixed length. Text of any length would lie in a heap without a checksum, where
    one wrong byte can send the library into an endless loop."""
    encoded = text.encode("utf-8")
    return np.array(encoded, dtype=h5py.string_dtype("utf-8", max(1, len(encoded))))


def text_of(value: object) -> str:
    """An attribute as text."""
    return value.decode("utf-8") if isinstance(value, bytes) else str(value)


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]
