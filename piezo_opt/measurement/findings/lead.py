"""A reading that comes before its drive, or after it by whole samples: shifted channels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.findings.finding import Finding, Weight, answers
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_SAMPLES, _FURTHEST, _SETTLED = 4000, 12, 0.25
"""Samples that are looked at, shifts that are tried, and the part in which the plays settle."""
_PLAYS = 8
_BETTER, _WHOLE = 2.0, 0.2
"""The residual without the shift over that with it; how far from a whole number it may be."""


def leads(record: Measurement) -> Iterator[Finding]:
    """A quasi-static loop follows the reading much better with the drive earlier or later.

    The loop is that of Prandtl and Ishlinskii, linear in its weights:

        y_k = a + b u_(k+s) + sum_i c_i play_i(u)_(k+s)

    Its residual is the least squares' for every shift s. An actuator lags (s < 0), by its mechanics
    and its amplifier; none leads. A lag of exactly whole samples may be one of the channels.
    """
    if not record.uniform or len(record) < 40 * _FURTHEST:
        return
    shift, better = _best_shift(record.drive, record.position)
    samples = round(shift)
    if better < _BETTER or abs(shift - samples) > _WHOLE or abs(samples) >= _FURTHEST:
        return
    if not samples or record.counted.size <= 8 * abs(samples):
        return
    many = f"{abs(samples)} sample{'s' if abs(samples) > 1 else ''}"
    took = show(abs(samples) * record.step, "s")

    def mend(old: Measurement) -> tuple[Measurement, ...]:
        return (_shifted(old, samples),)

    if samples > 0:
        yield Finding(
            "lead",
            Weight.REFUSED,
            f"The reading comes at least {many} ({took}) before the drive: the channels are "
            "shifted against each other.",
            answers("lead", f"moves the drive {many} earlier"),
            (),
            mend,
        )
    elif samples < -1:
        yield Finding(
            "lag",
            Weight.REMARK,
            f"The reading follows the drive after {many} ({took}): a delay, or channels that are "
            "shifted against each other.",
            f"If they are, --mend lag moves the drive {many} later; else the effect delay has it.",
            (),
            mend,
        )


def _best_shift(drive: FloatArray, reading: FloatArray) -> tuple[float, float]:
    """The shift [samples] with the smallest residual, and what the residual without it is to it."""
    n = min(drive.size, _SAMPLES)
    # Where most happens: the way of the drive over such a stretch.
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(drive)))])
    first = int(np.argmax(way[n - 1 :] - way[: drive.size - n + 1]))
    u, y = drive[first : first + n], reading[first : first + n]
    columns = np.column_stack([np.ones(n), u, _plays(u)])
    inside = slice(max(_FURTHEST, int(_SETTLED * n)), n - _FURTHEST)
    target = y[inside]
    shifts = np.arange(-_FURTHEST, _FURTHEST + 1)
    left = np.empty(shifts.size)
    for k, s in enumerate(shifts):
        basis = columns[inside.start + s : inside.stop + s]
        # Ten unknowns: their products are smaller than the threads that would factor the columns.
        answer, *_ = np.linalg.lstsq(basis.T @ basis, basis.T @ target, rcond=None)
        left[k] = np.mean((target - basis @ answer) ** 2)
    k = int(np.argmin(left))
    if k in (0, shifts.size - 1) or left[k] <= 0.0:
        return 0.0, 1.0
    bend = left[k - 1] - 2.0 * left[k] + left[k + 1]
    between = 0.5 * (left[k - 1] - left[k + 1]) / bend if bend > 0.0 else 0.0
    return float(shifts[k] + between), float(np.sqrt(left[_FURTHEST] / left[k]))


def _plays(u: FloatArray) -> FloatArray:
    """(N, plays) play operators of the drive, of half widths up to half its range."""
    width = np.linspace(0.0, 0.5, _PLAYS + 1)[1:] * np.ptp(u)
    state = np.full(_PLAYS, u[0])
    out = np.empty((u.size, _PLAYS))
    for k, value in enumerate(u.tolist()):
        state = np.minimum(np.maximum(state, value - width), value + width)
        out[k] = state
    return out


def _shifted(old: Measurement, samples: int) -> Measurement:
    """The drive so many samples later with each reading, on the clock of the reading."""
    n = len(old) - abs(samples)
    reads = slice(0, n) if samples > 0 else slice(-samples, -samples + n)
    drives = slice(samples, samples + n) if samples > 0 else slice(0, n)
    return old.with_(
        time=old.time[reads],
        drive=old.drive[drives],
        position=old.position[reads],
        left_out=old.left_out[reads],
        channels={name: values[reads] for name, values in old.channels.items()},
        allow_saturated=True,
    )
