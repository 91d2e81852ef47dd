"""Files with several drives and positions: arrays by realisation and period, or tables."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from piezo_opt.choosing import expected
from piezo_opt.errors import InputError
from piezo_opt.files import checked, replacing
from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.axes import AxesCampaign, AxesRecord
from piezo_opt.measurement.clock import Clock
from piezo_opt.readers.columns import (
    DRIVE,
    POSITION,
    TIME,
    Column,
    Table,
    candidates,
    choose,
    in_si,
)
from piezo_opt.readers.wanted import Wanted
from piezo_opt.units import quantity, same_dimension

if TYPE_CHECKING:
    import h5py

_NAMES: Final = ("voltage", "displacement")
_AXES: Final = "(sample, channel, realisation, period)"


def read_axes(
    *paths: str | os.PathLike[str],
    rate: float | str | None = None,
    period: float | str | None = None,
) -> AxesCampaign:
    """Records with several drives and positions, all of one stage.

    Args:
        paths: files or folders of them.

            - ``.h5``: data sets ``voltage`` [V] and ``displacement`` [m], in the file or in groups
              of it (levels), with the axes (sample, channel, realisation, period), the last ones
              left out where there is one; attribute ``rate`` [Hz].
            - ``.npy``: ``u_NAME.npy`` [V] and ``y_NAME.npy`` [m] in pairs, with the same axes.
              Naming one of a pair is enough.
            - tables that `read` takes: every column of a voltage is a drive, every one of a length
              a position, each file one realisation.
        rate: of sampling, [Hz] or ``"6400 Hz"``; files of a table say it themselves.
        period: of a table, [s] or ``"1.28 s"``; without it the record begins at rest. Arrays hold
            whole periods.

    Raises:
        InputError: one sentence with the file and what to do.
    """
    hertz = None if rate is None else quantity(rate, "Hz")
    seconds = None if period is None else quantity(period, "s")
    found: list[AxesRecord] = []
    for file in _each(paths):
        suffix = file.suffix.lower()
        if suffix in (".h5", ".hdf5"):
            found += _stored(file, hertz)
        elif suffix == ".npy":
            found += _pair(file, hertz)
        else:
            found.append(_tabled(file, seconds))
    return AxesCampaign(tuple(found))


def _each(paths: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """The files, a pair of arrays once, by the name of its drives."""
    if not paths:
        raise InputError("no file is given: name one, or a folder")
    files: list[Path] = []
    for given in paths:
        expected((str, os.PathLike), given, "The file", "its path")
        path = Path(given)
        if path.is_dir():
            inside = sorted(p for s in (".h5", ".hdf5", ".npy") for p in path.glob(f"*{s}"))
            if not inside:
                raise InputError(f"{path}: holds no .h5 and no .npy file: name the files")
            files += inside
        else:
            files.append(path)
    made = [
        file.with_name(f"u{file.name[1:]}")
        if file.suffix.lower() == ".npy" and file.name.startswith("y")
        else file
        for file in files
    ]
    return list(dict.fromkeys(made))


def _stored(file: Path, rate: float | None) -> list[AxesRecord]:
    import h5py

    try:
        with h5py.File(checked(file), "r") as content:
            hertz = rate if rate is not None else content.attrs.get("rate")
            groups = [("", content), *((f"{name} ", content[name]) for name in content)]
            found = [
                (label, [np.asarray(group[name][()]) for name in _NAMES])
                for label, group in groups
                if _both(group)
            ]
    except (OSError, KeyError, TypeError) as error:
        raise InputError(f"{file}: cannot be read as HDF5 ({error}): export it again") from error
    if not found:
        raise InputError(
            f"{file}: has no data sets 'voltage' and 'displacement' with axes {_AXES}, in the file "
            "or in groups of it"
        )
    if hertz is None:
        raise InputError(f"{file}: does not say its sampling rate: give rate='6400 Hz'")
    return [one for label, pair in found for one in _records(file, label, pair, float(hertz))]


def _both(group: h5py.Group) -> bool:
    return hasattr(group, "keys") and all(name in group for name in _NAMES)


def _pair(file: Path, rate: float | None) -> list[AxesRecord]:
    if not file.name.startswith("u"):
        raise InputError(f"{file}: arrays come as u_NAME.npy and y_NAME.npy: rename it")
    if rate is None:
        raise InputError(f"{file}: an array has no sampling rate: give rate='6400 Hz'")
    pair = []
    for one in (file, file.with_name(f"y{file.name[1:]}")):
        try:
            pair.append(np.load(checked(one), allow_pickle=False))
        except (OSError, ValueError, EOFError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{one}: is no array of numbers: save it with numpy.save") from error
    return _records(file, f"{file.stem.lstrip('u').lstrip('_')} ", pair, rate)


def _records(
    file: Path, label: str, pair: list[np.ndarray[tuple[int, ...], np.dtype[np.generic]]],
    rate: float,
) -> list[AxesRecord]:  # fmt: skip
    """One record for each realisation, its periods in a row."""
    made: list[FloatArray] = []
    for what, array in zip(("drives", "displacements"), pair, strict=True):
        if array.dtype.kind not in "fiu" or not 2 <= array.ndim <= 4:
            raise InputError(
                f"{file}: {label}{what} are {array.dtype} of shape {array.shape}, expected numbers "
                f"with axes {_AXES}"
            )
        made.append(array.reshape(array.shape + (1,) * (4 - array.ndim)).astype(np.float64))
    u, y = made
    if (u.shape[0], *u.shape[2:]) != (y.shape[0], *y.shape[2:]):
        raise InputError(
            f"{file}: {label}drives have shape {pair[0].shape} and displacements {pair[1].shape}: "
            f"samples, realisations and periods must agree, axes {_AXES}"
        )

    def in_a_row(values: FloatArray) -> FloatArray:
        return np.asarray(np.moveaxis(values, 2, 0).reshape(-1, values.shape[1]))

    return [
        AxesRecord(
            in_a_row(u[:, :, k]), in_a_row(y[:, :, k]), rate,
            period=u.shape[0], name=f"{label}{k + 1}",
        )
        for k in range(u.shape[2])
    ]  # fmt: skip


def _tabled(file: Path, period: float | None) -> AxesRecord:
    from piezo_opt.readers import table_of

    table = table_of(file, Wanted())
    _, column = choose(table, TIME, None)
    time, _ = in_si(table, column)
    clock = Clock(time)
    if time.size < 2 or bool(np.any(np.diff(time) <= 0.0)) or not clock.uniform:
        raise InputError(f"{file}: is not evenly sampled: resample it first")
    drives, drive_unit = _all_of(table, DRIVE.unit)
    positions, position_unit = _all_of(table, POSITION.unit)
    return AxesRecord(
        drives, positions, 1.0 / clock.step,
        period=None if period is None else round(period / clock.step), name=file.stem,
        drive_unit=drive_unit, position_unit=position_unit,
    )  # fmt: skip


def _all_of(table: Table, unit: str) -> tuple[FloatArray, str]:
    """(N, channels) every column of this kind, in SI."""
    columns: list[Column] = [c for _, c in candidates(table, lambda one: same_dimension(one, unit))]
    if not columns:
        raise InputError(f"{table.file}: no column has a unit like {unit}: {table.listing()}")
    made = [in_si(table, column) for column in columns]
    return np.stack([values for values, _ in made], axis=1), made[0][1]


def write_positions(
    path: str | os.PathLike[str], positions: Mapping[str, FloatArray], *, overwrite: bool = False
) -> None:
    """Arrays (N, A) by the name of their record, as .npz.

    Raises:
        InputError: another suffix, or a file that cannot be written.
    """
    file = Path(path)
    if file.suffix.lower() != ".npz":
        raise InputError(f"{file}: positions are written as .npz: choose such a name")
    with replacing(file, overwrite=overwrite) as temporary:
        np.savez(temporary, **dict(positions))  # type: ignore[arg-type]
