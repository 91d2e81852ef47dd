"""What a transfer function's poles make of a drive: the columns that its numerator weighs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.identification import Start
from piezo_opt.linear_models.cascade import Cascade
from piezo_opt.linear_models.question import Detrend, LinearQuestion
from piezo_opt.linear_models.stepping import Steps
from piezo_opt.measurement import FloatArray, Measurement
from piezo_opt.measurement.arrays import BoolArray


@final
@dataclass(frozen=True, eq=False)
class Prepared:
    """One record in units of its own size: steps, drive, reading, and the columns of its trend."""

    steps: Steps
    reading: FloatArray
    trend: FloatArray
    counted: BoolArray
    rest: float

    @staticmethod
    def of(record: Measurement, question: LinearQuestion, scale: Scale) -> Prepared:
        """A record as the fit sees it; a constant of the drive goes where it is free."""
        free = question.detrend is not Detrend.NOTHING
        base = 0.0
        if free:
            base = record.drive[0] if question.start is Start.REST else record.drive.mean()
        level = float(record.position.mean()) if free else 0.0
        clock = (record.time - record.time[0]) / record.duration - 0.5
        drive = (record.drive - base) / scale.drive
        return Prepared(
            Steps.of(record, drive),
            (record.position - level) / scale.reading,
            np.vander(clock, question.detrend.columns, increasing=True),
            record.counted,
            float(drive[0]),
        )


@final
@dataclass(frozen=True)
class Scale:
    """Sizes of drive and reading, so that every weight is of order one."""

    drive: float
    reading: float

    @staticmethod
    def of(question: LinearQuestion) -> Scale:
        """Standard deviations over all records; 1 where nothing moves."""
        records = question.records.records
        u = np.concatenate([one.drive - one.drive.mean() for one in records])
        y = np.concatenate([one.position - one.position.mean() for one in records])
        return Scale(float(u.std()) or 1.0, float(y.std()) or 1.0)


@final
@dataclass(frozen=True, eq=False)
class Columns:
    """Everything that is linear at given poles, with its derivatives.

    Attributes:
        shared: (N, c) of the numerator's weights; ``shared_slope`` (N, c, n) by the poles' p.
        own: (N, f) of the free response; ``own_slope`` (N, f, n).
        trend: (N, t).
    """

    shared: FloatArray
    shared_slope: FloatArray
    own: FloatArray
    own_slope: FloatArray
    trend: FloatArray


def columns(
    record: Prepared, cascade: Cascade, p: FloatArray, question: LinearQuestion, *, slopes: bool
) -> Columns:
    """The columns of one record at the poles p, on every sample."""
    a, b, da = cascade.matrices(p)
    n = cascade.order
    if not slopes:
        da = da[:, :, :0]
    q = da.shape[2]
    start = np.zeros((n, 1 + q))
    if question.start is Start.REST:
        rest = np.linalg.solve(a, -b * record.rest)
        start[:, 0] = rest
        start[:, 1:] = -np.linalg.solve(a, np.einsum("abq,b->aq", da, rest))
    x, s = record.steps.along(a, b, da, start)
    chosen = list(cascade.by_degree[: question.zeros + 1])
    shared, shared_slope = x[:, chosen], s[:, chosen]
    if question.zeros == n:
        drive = record.steps.drive[:: record.steps.every]
        shared = np.column_stack([shared, drive])
        shared_slope = np.concatenate([shared_slope, np.zeros((x.shape[0], 1, q))], axis=1)
    if question.start is Start.FREE:
        # All exp(A h) commute, so the output's row moves by the transposed system.
        begin = np.zeros((n, 1 + q))
        begin[cascade.by_degree[0], 0] = 1.0
        own, own_slope = record.steps.along(
            np.ascontiguousarray(a.T), np.zeros(n), np.swapaxes(da, 0, 1), begin
        )
    else:
        own, own_slope = np.zeros((x.shape[0], 0)), np.zeros((x.shape[0], 0, q))
    return Columns(shared, shared_slope, own, own_slope, record.trend)


@final
@dataclass(frozen=True, eq=False)
class Point:
    """The least squares at given poles.

    Attributes:
        residual: (M,) measured minus modelled over the counted samples of all records, scaled.
        slope: (M, n) derivative of the model's reading by p, less what the linear weights can
            undo; its product with the residual is the exact gradient.
        jacobian: (M, d) derivative by p and all linear weights.
        weights: (c,) of the numerator.
        own: for each record the weights of its free response and trend.
    """

    residual: FloatArray
    slope: FloatArray
    jacobian: FloatArray
    weights: FloatArray
    own: tuple[FloatArray, ...]

    @property
    def cost(self) -> float:
        """Sum of squares, scaled."""
        return float(self.residual @ self.residual)


def solved(
    records: tuple[Prepared, ...],
    cascade: Cascade,
    p: FloatArray,
    question: LinearQuestion,
    *,
    slopes: bool = True,
) -> Point:
    """Solve for everything linear at the poles p: variable projection with Kaufman's slope.

    Source: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413-432; Kaufman (1975), BIT 15, 49-57.
    """
    made = [columns(one, cascade, p, question, slopes=slopes) for one in records]
    keep = [one.counted for one in records]
    shared = np.vstack([one.shared[k] for one, k in zip(made, keep, strict=True)])
    own = [np.hstack([one.own, one.trend])[k] for one, k in zip(made, keep, strict=True)]
    c, each = shared.shape[1], question.of_each_record
    matrix = np.zeros((shared.shape[0], c + each * len(records)))
    matrix[:, :c] = shared
    row = 0
    for k, block in enumerate(own):
        matrix[row : row + len(block), c + k * each : c + (k + 1) * each] = block
        row += len(block)
    reading = np.concatenate([one.reading[k] for one, k in zip(records, keep, strict=True)])
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0.0] = 1.0
    basis, triangle = np.linalg.qr(matrix / size)
    small, sigma, vt = np.linalg.svd(triangle, full_matrices=False)
    # Directions that rounding alone gives are left out, as numpy.linalg.lstsq does.
    good = sigma > sigma[0] * max(matrix.shape) * np.finfo(np.float64).eps
    u = basis @ small[:, good]
    seen = u.T @ reading
    weights = (vt[good].T @ (seen / sigma[good])) / size
    residual = reading - u @ seen
    per_record = tuple(weights[c + k * each : c + (k + 1) * each] for k in range(len(records)))
    slope = np.zeros((residual.size, 0))
    if slopes:
        n = cascade.order
        free = n if made[0].own.shape[1] else 0
        slope = np.vstack(
            [
                (
                    np.einsum("icq,c->iq", one.shared_slope, weights[:c])
                    + np.einsum("icq,c->iq", one.own_slope, mine[:free])
                )[k]
                for one, mine, k in zip(made, per_record, keep, strict=True)
            ]
        )
    full = np.hstack([slope, matrix])
    return Point(residual, slope - u @ (u.T @ slope), full, weights[:c], per_record)
