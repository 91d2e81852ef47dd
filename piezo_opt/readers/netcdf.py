"""netCDF of the classic kind through scipy; netCDF-4 files are HDF5 and read as such."""

from __future__ import annotations

import os
import warnings

import numpy as np
import scipy

from piezo_opt.errors import InputError
from piezo_opt.files import checked, refuse_rows
from piezo_opt.readers.columns import Column, Table
from piezo_opt.readers.conventions import column_of


def table_from_netcdf(path: str | os.PathLike[str]) -> Table:
    """The one-dimensional variables of a netCDF file as columns.

    Raises `InputError` for a file that is none or is cut short.
    """
    file = checked(path)
    with file.open("rb") as content:
        head = content.read(4)
    if head[:3] != b"CDF":
        from piezo_opt.readers.hdf5 import table_from_hdf5

        return table_from_hdf5(file)
    columns: list[Column] = []
    notes: list[str] = []
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with scipy.io.netcdf_file(file, "r", mmap=False) as stored:
                for name, variable in stored.variables.items():
                    if len(variable.shape) != 1 or variable.data.dtype.kind not in "fiu":
                        continue
                    refuse_rows(file, int(variable.shape[0]))
                    values = np.array(variable.data).astype(variable.data.dtype.newbyteorder("="))
                    column, said = column_of(
                        str(file), name, values, getattr(variable, "_attributes", {})
                    )
                    columns.append(column)
                    notes += said
    except InputError:
        raise
    except Exception as error:  # a damaged file surfaces as any of the library's many errors
        raise InputError(
            f"{file}: is not a whole netCDF file: copy or export it again "
            f"({(str(error).splitlines() or [type(error).__name__])[0][:120]})"
        ) from error
    return Table(str(file), tuple(columns), "index {}".format, notes=tuple(notes))
