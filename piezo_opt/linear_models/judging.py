"""Any linear system of python-control on a record: its reading, start and offset free."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.comparison import Misfit
from piezo_opt.errors import InputError
from piezo_opt.identification import Start
from piezo_opt.linear_models.question import Detrend, LinearQuestion
from piezo_opt.linear_models.responses import Prepared, Scale
from piezo_opt.measurement import Campaign, FloatArray, Measurement

if TYPE_CHECKING:
    import control


def state_space(
    system: control.StateSpace | control.TransferFunction,
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """A (n, n), B (n,), C (n,) and D of a continuous system with one input and one output.

    Raises:
        InputError: it is sampled, has several inputs or outputs, or more zeros than poles.
    """
    if getattr(system, "dt", 0) not in (0, None):
        raise InputError("a continuous-time system is needed, and this one is sampled")
    if (system.ninputs, system.noutputs) != (1, 1):
        raise InputError(
            f"one drive and one reading are needed, not {system.ninputs} and {system.noutputs}"
        )
    if hasattr(system, "num"):
        falling = np.trim_zeros(np.ravel(system.num[0][0]), "f")
        below = np.trim_zeros(np.ravel(system.den[0][0]), "f")
        if falling.size > below.size:
            raise InputError("this transfer function has more zeros than poles: it has no states")
        n = below.size - 1
        top = np.concatenate([np.zeros(n + 1 - falling.size), falling]) / below[0]
        monic = below / below[0]
        # Time is counted in units of the geometric mean of the poles, for the sake of rounding.
        unit = abs(float(monic[-1])) ** (1.0 / n) if n and monic[-1] != 0.0 else 1.0
        scaled = monic * unit ** -np.arange(n + 1.0)
        upper = top * unit ** -np.arange(n + 1.0)
        a = np.eye(n, k=-1) * unit
        a[:1] = -scaled[1:] * unit
        b = np.zeros(n)
        b[:1] = unit
        return a, b, upper[1:] - upper[0] * scaled[1:], float(upper[0])
    return (
        np.asarray(system.A, dtype=np.float64),
        np.asarray(system.B, dtype=np.float64)[:, 0],
        np.asarray(system.C, dtype=np.float64)[0],
        float(system.D[0, 0]),
    )


def least(columns: FloatArray, values: FloatArray) -> FloatArray:
    """(c,) weights of the columns (N, c) in least squares; none of none."""
    if not columns.shape[1]:
        return np.zeros(0)
    return np.asarray(np.linalg.lstsq(columns, values, rcond=None)[0], dtype=np.float64)


def judge(
    system: control.StateSpace | control.TransferFunction,
    records: Measurement | Iterable[Measurement] | Campaign,
    *,
    start: Start = Start.FREE,
    detrend: Detrend = Detrend.OFFSET,
) -> tuple[Misfit, ...]:
    """What a linear system leaves over on records; nothing of the system itself is fitted.

        minimise over x(0) and offset:  sum (y(t_i) - C x(t_i) - D u(t_i) - offset)^2

    Args:
        system: drive [drive_unit] to reading [position_unit].
        records: one or several, each with a start and an offset of its own.
        start, detrend: what is free beside the system.

    Raises:
        InputError: the system is none that can be simulated, see :func:`state_space`.
    """
    a, b, c, d = state_space(system)
    n = a.shape[0]
    question = LinearQuestion(records, max(n, 1), 0, start=start, detrend=detrend)
    scale = Scale.of(question)
    found = []
    for record in question.records.records:
        one = Prepared.of(record, question, scale)
        begin = np.zeros((n, 1))
        if start is Start.REST and n:
            begin[:, 0] = np.linalg.lstsq(a, -b * one.rest, rcond=None)[0]
        nothing = np.zeros((n, n, 0))
        x, _ = one.steps.along(a, b, nothing, begin)
        forced = (x @ c + d * one.steps.drive[:: one.steps.every]) * scale.drive / scale.reading
        free: FloatArray = one.trend
        if start is Start.FREE and n:
            own, _ = one.steps.along(np.ascontiguousarray(a.T), np.zeros(n), nothing, c[:, None])
            size = np.abs(own).max(axis=0)
            free = np.hstack([own / np.where(size > 0.0, size, 1.0), free])
        left = one.reading - forced
        error = (left - free @ least(free[one.counted], left[one.counted])) * scale.reading
        found.append(Misfit(record, record.position - error))
    return tuple(found)
