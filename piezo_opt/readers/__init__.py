"""Files to records and back: one verb to read, one to write, the suffix says how."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from piezo_opt.choosing import expected
from piezo_opt.errors import InputError
from piezo_opt.measurement import Between, Campaign, Measurement
from piezo_opt.readers.axes import read_axes
from piezo_opt.readers.columns import Table, by_number
from piezo_opt.readers.csv import table_from_csv
from piezo_opt.readers.csv_writing import write_csv
from piezo_opt.readers.drives import DriveSignal
from piezo_opt.readers.parquet import is_frame, table_from_frame
from piezo_opt.readers.records import drive_from, measurement_from, runs
from piezo_opt.readers.wanted import Wanted, treated
from piezo_opt.units import quantity

__all__ = [
    "HOLD_SEVERAL",
    "DriveSignal",
    "headers",
    "read",
    "read_axes",
    "read_campaign",
    "read_drive",
    "table_of",
    "write",
]

_TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc")
HOLD_SEVERAL = (".h5", ".hdf5")
"""Suffixes of files that hold several records as such."""
_MATLAB = (".mat",)
_NETCDF = (".nc", ".cdf")
_LVM = (".lvm",)
_TDMS = (".tdms",)
_PARQUET = (".parquet", ".pq")
_KNOWN = (*_TEXT, *HOLD_SEVERAL, *_MATLAB, *_NETCDF, *_LVM, *_TDMS, *_PARQUET)


def read(
    path: str | os.PathLike[str] | Any,
    *,
    time: str | None = None,
    drive: str | None = None,
    position: str | None = None,
    between: Between | None = None,
    period: float | str | None = None,
    startup: float | str | None = None,
    record: str | None = None,
    allow_saturated: bool = False,
    rate: float | str | None = None,
    trim: str | None = None,
    every: int = 1,
    gain: float | str | None = None,
    scale: float | str | None = None,
    decimal: str | None = None,
) -> Measurement:
    """One record from a file or a frame, in SI units; its ``notes`` say what was concluded.

    Args:
        path: .csv, .txt, .tsv, .dat, .asc (a header ``time [s],voltage [V],displacement [um]``),
            .h5, .hdf5, .nc, .mat, .lvm, .tdms (needs npTDMS) or .parquet (needs pyarrow); or a
            frame of pandas or polars, whose columns have such names.
        time, drive, position: columns, as ``"voltage"`` or ``"u [V]"``, or by number from 1,
            ``"2 [V]"``; by default the columns whose unit is a time, a voltage and a length. A
            named drive or position may have any unit, ``drive="force [N]"``. Further columns with
            a unit become channels.
        between: how the drive moves between samples; by default what the file says, else linear.
        period, startup: [s] or a quantity such as ``"40 ms"``; by default what the file says.
        record: which of several records in one file: its name in an HDF5 file, its number from 1
            where the clock of a file begins anew.
        allow_saturated: accept a reading stuck at its end.
        rate: [Hz] or ``"1 kHz"``, of an even clock, for a file without one or with a wrong one;
            ``"even"`` for one between the ends of the column of time.
        trim: ``"2 s:8 s"`` keeps that stretch of the record's clock; either end may be left out.
        every: 10 keeps every tenth sample, after a low-pass filter on drive and reading.
        gain: of the amplifier, where the drive was recorded before it.
        scale: of the reading, ``"2.5 um/V"`` for a sensor that was recorded in volts.
        decimal: "," or ".", where the numbers of a text file can be read in both ways.

    Raises:
        InputError: one sentence with file, row or column, and what to do.
    """
    wanted = Wanted(
        time, drive, position, between, period, startup, allow_saturated,
        rate, trim, every, gain, scale, decimal,
    )  # fmt: skip
    if is_frame(path):
        if record is not None:
            raise InputError(f"frame: holds one record: drop record={record!r}")
        return measurement_from(table_from_frame(path), "frame", wanted)
    expected((str, os.PathLike), path, "The file", "its path, or a frame of pandas or polars")
    file = Path(path)
    stored = _stored(file)
    if stored is not None:
        return _adjusted(file, _one_of(file, stored, record), wanted)
    table = table_of(file, wanted)
    if record is None:
        return measurement_from(table, _stem(file), wanted)
    parts = runs(table, wanted)
    if len(parts) == 1:
        raise InputError(f"{file}: holds one record, so record={record!r} means nothing: drop it")
    if record not in map(str, range(1, len(parts) + 1)):
        raise InputError(
            f"{file}: holds {len(parts)} records, numbered from 1, and none of them is {record!r}; "
            "take all of them with read_campaign"
        )
    return measurement_from(parts[int(record) - 1], f"{_stem(file)} {record}", wanted)


def read_campaign(
    path: str | os.PathLike[str],
    *,
    time: str | None = None,
    drive: str | None = None,
    position: str | None = None,
    between: Between | None = None,
    period: float | str | None = None,
    startup: float | str | None = None,
    rate: float | str | None = None,
    trim: str | None = None,
    every: int = 1,
    gain: float | str | None = None,
    scale: float | str | None = None,
    decimal: str | None = None,
) -> Campaign:
    """All records of a file: those of an HDF5 file, or the runs between which a clock begins anew.

    A file with one record gives a campaign of one. The options are those of `read`, for each
    record.

    Raises:
        InputError: one sentence with file, row or column, and what to do.
    """
    wanted = Wanted(
        time, drive, position, between, period, startup, False,
        rate, trim, every, gain, scale, decimal,
    )  # fmt: skip
    file = _path(path)
    stored = _stored(file)
    if stored is not None:
        return Campaign(tuple(_adjusted(file, one, wanted) for one in stored))
    parts = runs(table_of(file, wanted), wanted)
    stem = _stem(file)
    names = [stem if len(parts) == 1 else f"{stem} {k + 1}" for k in range(len(parts))]
    return Campaign(
        tuple(measurement_from(part, name, wanted) for part, name in zip(parts, names, strict=True))
    )


def read_drive(
    path: str | os.PathLike[str],
    *,
    time: str | None = None,
    drive: str | None = None,
    between: Between | None = None,
    rate: float | str | None = None,
) -> DriveSignal:
    """The drive alone, from a file that need not hold a reading; options as in `read`.

    Raises:
        InputError: one sentence with file, row or column, and what to do.
    """
    wanted = Wanted(time=time, drive=drive, between=between, rate=rate)
    file = _path(path)
    stored = _stored(file)
    if stored is not None:
        one = _adjusted(file, _one_of(file, stored, None), wanted)
        return DriveSignal(one.time, one.drive, one.drive_unit, one.between, file)
    return drive_from(table_of(file, wanted), wanted)


def headers(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """How the columns of a file are headed, ``"voltage [V]"``, in its order.

    Columns without numbers are left out, and those of a table without a header have numbers for
    names, ``"2"``; a file of this package has none to choose from.

    Raises:
        InputError: the file cannot be read.
    """
    file = _path(path)
    if _stored(file) is not None:
        return ()
    try:
        table = table_of(file, Wanted())
    except InputError:
        table = table_of(file, Wanted(drive="1", position="1"))
    return tuple(c.header for c in table.columns if c.values.size)


def write(
    records: Measurement | Iterable[Measurement] | Campaign,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
) -> None:
    """Write one record as .csv, or one or several as .h5 or .hdf5, in SI units.

    The file appears whole or not at all. Raises `InputError` when it exists and ``overwrite`` is
    not given, when it cannot be written, or for another suffix.
    """
    file = _path(path)
    suffix = file.suffix.lower()
    if suffix in HOLD_SEVERAL:
        from piezo_opt.readers.hdf5 import write_hdf5

        write_hdf5(records, file, overwrite=overwrite)
        return
    if suffix != ".csv":
        raise InputError(f"{file}: records are written as .csv, .h5 or .hdf5: choose one of these")
    campaign = Campaign.of(records)
    if len(campaign) > 1:
        raise InputError(f"{file}: CSV holds one record, not {len(campaign)}: write .h5")
    write_csv(campaign.records[0], file, overwrite=overwrite)


def _path(given: str | os.PathLike[str]) -> Path:
    expected((str, os.PathLike), given, "The file", "its path")
    return Path(given)


def _stem(file: Path) -> str:
    """The name of a record that its file does not name; a line break in it is a blank."""
    return " ".join(file.stem.splitlines())


def _suffix(file: Path) -> str:
    suffix = file.suffix.lower()
    if suffix == ".npy":
        raise InputError(
            f"{file}: an array does not say its columns: 'piezo-opt axes fit' takes u_NAME.npy and "
            "y_NAME.npy of a stage with several drives; a single record is saved as CSV"
        )
    if suffix not in _KNOWN and not file.is_dir():
        raise InputError(
            f"{file}: nothing reads {suffix or 'a file without suffix'}: save it as CSV, or as one "
            f"of {', '.join(_KNOWN)}"
        )
    return suffix


def _stored(file: Path) -> Campaign | None:
    """The records of a file in the package's own layout; None for any other file."""
    if _suffix(file) not in HOLD_SEVERAL:
        return None
    from piezo_opt.readers.hdf5 import campaign_from_hdf5

    return campaign_from_hdf5(file)


def table_of(file: Path, wanted: Wanted) -> Table:
    """The columns of a file; what a format needs is loaded when a file of it is read."""
    suffix = _suffix(file)
    if suffix in HOLD_SEVERAL:
        from piezo_opt.readers.hdf5 import table_from_hdf5

        return table_from_hdf5(file)
    if suffix in _MATLAB:
        from piezo_opt.readers.mat import table_from_mat

        return table_from_mat(file)
    if suffix in _NETCDF:
        from piezo_opt.readers.netcdf import table_from_netcdf

        return table_from_netcdf(file)
    if suffix in _LVM:
        from piezo_opt.readers.lvm import table_from_lvm

        return table_from_lvm(file, decimal=wanted.decimal)
    if suffix in _TDMS:
        from piezo_opt.readers.tdms import table_from_tdms

        return table_from_tdms(file)
    if suffix in _PARQUET:
        from piezo_opt.readers.parquet import table_from_parquet

        return table_from_parquet(file)
    numbered = all(by_number(said) for said in (wanted.drive, wanted.position))
    return table_from_csv(file, decimal=wanted.decimal, numbered=numbered)


def _one_of(file: Path, campaign: Campaign, record: str | None) -> Measurement:
    if record is not None:
        try:
            return campaign[record]
        except InputError as error:
            raise InputError(f"{file}: {error}") from error
    if len(campaign) > 1:
        raise InputError(
            f"{file}: holds {len(campaign)} records: choose one with record='...' from "
            f"{', '.join(campaign.names)}, or take all with read_campaign"
        )
    return campaign.records[0]


def _adjusted(file: Path, measurement: Measurement, wanted: Wanted) -> Measurement:
    """A stored record with what the caller says anew; its columns are fixed."""
    for role, said in (
        ("time", wanted.time),
        ("drive", wanted.drive),
        ("position", wanted.position),
    ):
        if said is not None and said.partition("[")[0].strip() != role:
            raise InputError(
                f"{file}: its columns are time, drive and position already: drop {role}={said!r}"
            )
    changes: dict[str, Any] = {}
    if wanted.between is not None:
        changes["between"] = wanted.between
    if wanted.period is not None:
        changes["period"] = quantity(wanted.period, "s")
    if wanted.startup is not None:
        changes["startup"] = quantity(wanted.startup, "s")
    if wanted.allow_saturated:
        changes["allow_saturated"] = True
    if wanted.rate is not None:
        changes["time"] = (
            np.linspace(measurement.time[0], measurement.time[-1], len(measurement))
            if wanted.hertz is None
            else np.arange(len(measurement)) / wanted.hertz
        )
        changes["notes"] = (*measurement.notes, "The clock was replaced by an even one.")
    if changes:
        measurement = measurement.with_(**changes)
    begin, end = wanted.stretch
    if begin is not None or end is not None:
        measurement = measurement.slice(begin, end)
    return treated(measurement, wanted)
