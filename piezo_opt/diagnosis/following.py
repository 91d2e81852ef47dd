"""Whether a residual follows the drive, whatever the function."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.scores import chance
from piezo_opt.identification import Fit
from piezo_opt.measurement import Measurement

FloatArray = NDArray[np.float64]

_PLAYS = (0.1, 0.3, 0.6)
"""Widths over the drive's range: a loop of another shape leaves what such memories give."""
_TELLING = 0.03
"""Power that a function of the drive must explain, over the floor's: mechanics that nobody sees
leave less, and slow noise that hides from the floor makes the residual look larger than it is."""


def follows_drive(fit: Fit, point: BasePoint, floor: float) -> tuple[float, str]:
    """Smallest corrected p-value over generic functions of the drive, and the function's name."""
    parts: dict[str, list[FloatArray]] = {}
    for index, record in enumerate(fit.records):
        for label, column in _library(record, fit.readings[index]).items():
            parts.setdefault(label, []).append(column[record.counted])
    least, named = 1.0, ""
    for label, columns in parts.items():
        column = point.project(np.concatenate(columns))
        if _share(column, point.residual) * fit.rms**2 < _TELLING * floor**2:
            continue
        p = chance(column, point.residual, dense=True) * len(parts)
        if p < least:
            least, named = p, label
    return least, named


def _share(column: FloatArray, r: FloatArray) -> float:
    """Share of a residual's sum of squares that a column explains."""
    power = float(column @ column) * float(r @ r)
    return float(column @ r) ** 2 / power if power > 0.0 else 0.0


def _library(record: Measurement, reading: FloatArray) -> dict[str, FloatArray]:
    """Generic functions of drive, its rate, the position and the time since a reversal."""
    t = record.time
    v = (record.drive - record.drive.mean()) / (float(np.ptp(record.drive)) or 1.0)
    rate = np.gradient(v, t)
    speed = rate / (float(np.sqrt(np.mean(rate**2))) or 1.0)
    x = (reading - reading.mean()) / (float(np.ptp(reading)) or 1.0)
    w = np.gradient(x, t)
    w = w / (float(np.sqrt(np.mean(w**2))) or 1.0)
    way = np.sign(speed)
    turned = np.concatenate([[True], way[1:] * way[:-1] < 0])
    since = t - np.maximum.accumulate(np.where(turned, t, t[0]))
    settle = np.log1p(since / record.step)
    plays = {
        f"the drive through a play of {share:.0%} of its range": play(v, 0.5 * share)
        for share in _PLAYS
    }
    return {
        **plays,
        "the drive's square": v**2,
        "the drive's cube": v**3,
        "the drive's rate": speed,
        "the size of the drive's rate": np.abs(speed),
        "the branch (loading or unloading)": way,
        "the branch times the drive": way * v,
        "the branch times the drive's square": way * v**2,
        "the position's square": x**2,
        "the position's cube": x**3,
        "the velocity": w,
        "the sign of the velocity": np.sign(w),
        "the time since the last reversal": settle,
        "the time since the last reversal, by branch": settle * way,
        "the time": t - t.mean(),
    }


def play(v: FloatArray, half: float) -> FloatArray:
    """What a play of this half width makes of a signal: the simplest memory of its turns."""
    step = np.diff(v)
    moving = np.flatnonzero(step)
    turned = moving[1:][step[moving[1:]] * step[moving[:-1]] < 0]
    rising = bool(step[moving[0]] > 0) if moving.size else True
    at, followed = float(v[0]), []
    # Within a monotone stretch only one side of the play is ever touched.
    for stretch in np.split(v, turned + 1):
        moved = np.maximum(at, stretch - half) if rising else np.minimum(at, stretch + half)
        followed.append(moved)
        at, rising = float(moved[-1]), not rising
    return np.concatenate(followed)
