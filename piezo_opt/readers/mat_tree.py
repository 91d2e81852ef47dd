"""MATLAB variables as columns: vectors, matrices, structures, what Simulink logs, time series.

Variables are plain Python here: arrays, text, lists (cells, arrays of structures) and dictionaries
(structures). Columns are called as in MATLAB, ``run.u``, ``log(2,:)``, ``scope.signals(1).values``;
signals of Simulink by their label and time series by their name, where they have one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from piezo_opt.measurement import FloatArray
from piezo_opt.readers.columns import TIME, Column
from piezo_opt.readers.headers import header_cell, known_unit, unit_word

_WIDEST: Final = 64
"""Signals that a matrix may hold."""


def columns_of(file: str, variables: Mapping[str, Any]) -> tuple[list[Column], list[str]]:
    """The columns, and sentences about what was concluded."""
    columns: list[Column] = []
    notes: list[str] = []
    for column, note in _walk(file, variables, ""):
        same = [
            one
            for one in columns
            if one.unit == column.unit in ("s", "ms", "us")
            and np.array_equal(one.values, column.values)
        ]
        # Every signal that Simulink logs and every time series comes with a clock of its own.
        if not same:
            columns.append(column)
            notes += [note] if note else []
    if not any(one.unit == "s" or one.name.lower() in TIME.names for one in columns):
        columns, said = _first_as_time(columns)
        notes += said
    return columns, notes


def _walk(file: str, tree: Mapping[str, Any], prefix: str) -> Iterator[tuple[Column, str]]:
    for name, value in tree.items():
        if name.startswith("__") or name.endswith("_unit"):
            continue
        yield from _value(file, tree, name, value, f"{prefix}{name}")


def _value(
    file: str, tree: Mapping[str, Any], name: str, value: Any, path: str
) -> Iterator[tuple[Column, str]]:
    if isinstance(value, dict):
        found = list(_simulink(value, path)) or list(_series(value, path))
        yield from found or _walk(file, value, f"{path}.")
    elif isinstance(value, list):
        for k, one in enumerate(value[:_WIDEST]):
            yield from _value(file, {}, "", one, f"{path}({k + 1})")
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
        unit = tree.get(f"{name}_unit")
        for own, numbers in _signals(value, path):
            yield _column(file, own, unit if isinstance(unit, str) else None, numbers), ""
    elif isinstance(value, np.ndarray) and value.dtype.kind == "c" and value.size > 1:
        yield Column(path, None, np.zeros(0), sample=str(value.reshape(-1)[0])), ""


def _column(file: str, name: str, unit: str | None, values: FloatArray) -> Column:
    if unit is not None:
        return Column(name, known_unit(file, name, unit), values)
    return Column(*header_cell(file, name), values) if "[" in name else Column(name, None, values)


def _signals(value: np.ndarray, path: str) -> Iterator[tuple[str, FloatArray]]:
    """A vector as it is, a matrix along its shorter side."""
    numbers = np.squeeze(np.asarray(value))
    if numbers.ndim == 1 and numbers.size > 1:
        yield path, numbers.astype(np.float64)
    elif numbers.ndim == 2 and min(numbers.shape) <= _WIDEST:
        rows, columns = numbers.shape
        for k in range(min(rows, columns)):
            if rows < columns:
                yield f"{path}({k + 1},:)", numbers[k].astype(np.float64)
            else:
                yield f"{path}(:,{k + 1})", numbers[:, k].astype(np.float64)


def _simulink(tree: Mapping[str, Any], path: str) -> Iterator[tuple[Column, str]]:
    """A structure with time, as scopes and To Workspace blocks log it."""
    time, signals = tree.get("time"), tree.get("signals")
    signals = [signals] if isinstance(signals, dict) else signals
    if not isinstance(time, np.ndarray) or not isinstance(signals, list):
        return
    if time.size < 2 or not all(isinstance(one, dict) and "values" in one for one in signals):
        return
    note = f"{path!r} was logged by Simulink: its time is in s."
    yield Column(f"{path}.time", "s", time.astype(np.float64).reshape(-1)), note
    for k, one in enumerate(signals):
        label = one.get("label")
        own = label if isinstance(label, str) and label.strip() else f"{path}.signals({k + 1})"
        if isinstance(one["values"], np.ndarray) and one["values"].dtype.kind in "fiu":
            name, unit = header_cell("", own) if "[" not in own else (own, None)
            for called, numbers in _signals(_along_time(one["values"], time.size), name):
                yield Column(called, unit, numbers), ""


def _series(tree: Mapping[str, Any], path: str) -> Iterator[tuple[Column, str]]:
    """A time series as a structure: Time and Data, with what is known about them."""
    time, data = tree.get("Time"), tree.get("Data")
    if not isinstance(time, np.ndarray) or not isinstance(data, np.ndarray) or time.size < 2:
        return
    if data.dtype.kind not in "fiu" or time.dtype.kind not in "fiu":
        return
    units = [_told(tree.get(info), "Units") for info in ("TimeInfo", "DataInfo")]
    unit = unit_word(units[0]) or "s"
    note = f"{path!r} is a time series: its time is in {unit}."
    yield Column(f"{path}.Time", unit, time.astype(np.float64).reshape(-1)), note
    called = tree.get("Name")
    name = called if isinstance(called, str) and called.strip() else path
    for own, numbers in _signals(_along_time(data, time.size), name):
        yield Column(own, unit_word(units[1]), numbers), ""


def _along_time(values: np.ndarray, samples: int) -> np.ndarray:
    """Values with the time along their first side; the last one in what has three."""
    numbers = np.squeeze(values)
    if numbers.ndim == 2 and numbers.shape[0] != samples and numbers.shape[1] == samples:
        return numbers.T
    return numbers


def _told(tree: Any, key: str) -> str:
    value = tree.get(key) if isinstance(tree, dict) else None
    return value if isinstance(value, str) else ""


def _first_as_time(columns: list[Column]) -> tuple[list[Column], list[str]]:
    """The first signal of a matrix is its clock, as To File writes it, when it is an even one."""
    matrices = [k for k, one in enumerate(columns) if one.name.endswith(("(1,:)", "(:,1)"))]
    if len(matrices) != 1:
        return columns, []
    place = matrices[0]
    steps = np.diff(columns[place].values)
    if not (steps.min() > 0.0 and np.ptp(steps) <= 0.01 * steps.mean()):
        return columns, []
    name, values = columns[place].name, columns[place].values
    told = [*columns]
    told[place] = Column(name, "s", values)
    return told, [f"{name!r} increases evenly and was taken as the time in s."]
