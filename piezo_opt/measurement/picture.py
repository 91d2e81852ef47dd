"""A record as text: drive and reading over time, drawn with the dots of Braille."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.findings import Finding
    from piezo_opt.measurement.record import Measurement

_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of the dots of a cell, by row and column."""
_BLANK = 0x2800
_HEIGHT = 6


def picture(record: Measurement, findings: Sequence[Finding], width: int = 72) -> str:
    """Drive and reading over time, and a line of marks below: ``^`` where a finding is about.

    Args:
        record: the record.
        findings: what it shows about itself.
        width: columns of text of the drawing.
    """
    lines = [repr(record).strip("<>")]
    for label, values, unit in (
        ("drive", record.drive, record.drive_unit),
        ("reading", record.position, record.position_unit),
    ):
        low, high = _range(values, record.counted & ~_odd(record, findings))
        lines.append(f"  {label}, {show(low, unit)} to {show(high, unit)}")
        lines += [f"  {row}" for row in _drawn(record.time, values, low, high, width)]
    marks = _marks(record, findings, width)
    if marks.strip():
        lines.append(f"  {marks}")
    lines.append(f"  {show(float(record.time[0]), 's')} to {show(float(record.time[-1]), 's')}")
    return "\n".join(lines)


def _odd(record: Measurement, findings: Sequence[Finding]) -> np.ndarray:
    """Samples that must not set the scale."""
    odd = np.zeros(len(record), dtype=np.bool_)
    for one in findings:
        for a, b in one.stretches:
            odd[a:b] = True
    return odd


def _range(values: FloatArray, judged: np.ndarray) -> tuple[float, float]:
    some = values[judged] if judged.any() else values
    return float(some.min()), float(some.max())


def _drawn(time: FloatArray, values: FloatArray, low: float, high: float, width: int) -> list[str]:
    """Rows of text: in every column of dots a line from the smallest to the largest value."""
    columns, rows = 2 * width, 4 * _HEIGHT
    share = (time - time[0]) / (time[-1] - time[0])
    column = np.minimum((share * columns).astype(np.intp), columns - 1)
    height = (np.clip(values, low, high) - low) / ((high - low) or 1.0)
    row = rows - 1 - np.minimum((height * rows).astype(np.intp), rows - 1)
    dots = np.zeros((rows, columns), dtype=np.bool_)
    first = np.flatnonzero(np.concatenate([[True], np.diff(column) > 0]))
    top, bottom = np.minimum.reduceat(row, first), np.maximum.reduceat(row, first)
    for c, a, b in zip(column[first].tolist(), top.tolist(), bottom.tolist(), strict=True):
        dots[a : b + 1, c] = True
    cells = np.full((_HEIGHT, width), _BLANK)
    for i, pair in enumerate(_DOTS):
        for j, bit in enumerate(pair):
            cells += bit * dots[i::4, j::2]
    return ["".join(map(chr, line)).rstrip(chr(_BLANK)) for line in cells.tolist()]


def _marks(record: Measurement, findings: Sequence[Finding], width: int) -> str:
    marks = [" "] * width
    span = record.duration
    for one in findings:
        for a, b in one.stretches:
            for k in (a, min(b, len(record)) - 1):
                at = int((record.time[k] - record.time[0]) / span * width)
                marks[min(at, width - 1)] = "^"
    return "".join(marks).rstrip()
