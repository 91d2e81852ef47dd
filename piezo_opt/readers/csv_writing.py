"""A record as text, in SI units and with every digit, so that it reads back as the same record."""

from __future__ import annotations

import os

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.files import replacing
from piezo_opt.measurement import FloatArray, Measurement
from piezo_opt.readers.csv import SIGNATURE
from piezo_opt.readers.records import LEFT_OUT


def write_csv(
    record: Measurement, path: str | os.PathLike[str], *, overwrite: bool = False
) -> None:
    """Write a record in SI units with all digits, in one step: all of the file or none of it."""
    columns: dict[str, FloatArray] = {
        "time [s]": record.time,
        f"drive [{record.drive_unit}]": record.drive,
        f"position [{record.position_unit}]": record.position,
    }
    for name, values in record.channels.items():
        columns[f"{name} [{record.channel_units[name]}]"] = values
    if record.left_out.any():
        columns[f"{LEFT_OUT} [1]"] = record.left_out.astype(np.float64)
    for text in (*columns, record.name, record.source):
        if not text.isprintable():
            raise InputError(f"{path}: {text!r} cannot stand in a line of text: rename it")
    for header in columns:
        foreign = any(sign in header for sign in ',;#"') or header != header.strip()
        if foreign or header.count("[") > 1 or header.count("]") > 1:
            raise InputError(f"{path}: column {header!r} cannot stand in a CSV header: rename it")
    about = [
        SIGNATURE,
        f"# name: {record.name}",
        f"# between: {record.between.value}",
        *([] if record.period is None else [f"# period: {record.period!r} s"]),
        f"# startup: {record.startup!r} s",
        f"# allow_saturated: {str(record.allow_saturated).lower()}",
        f"# source: {record.source}",
        ",".join(columns),
    ]
    with (
        replacing(path, overwrite=overwrite) as temporary,
        temporary.open("x", encoding="utf-8", newline="\n") as lines,
    ):
        lines.write("\n".join(about) + "\n")
        for row in zip(*(values.tolist() for values in columns.values()), strict=True):
            lines.write(",".join(map(repr, row)) + "\n")
