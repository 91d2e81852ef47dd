"""A reading that comes before its drive, or after it by whole samples: shifted channels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.findings.finding import Finding, Weight, answers
from piezo_opt.measurement.findings.slow_drive import slow_drives
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_SAMPLES, _SETTLED = 4000, 0.25
"""Samples that are looked at, and the part in which the plays settle."""
_REACHES = (12, 48)
"""Shifts that are tried; the further ones where the nearer ones end still falling."""
_PLAYS, _BLOCKS = 8, 8
_SURE, _PART = 3.0, 0.5
"""Standard errors that a lead is away from a part of a sample, which a loop's form may feign."""
_LESS, _MUCH_LESS, _WHOLE = 1.1, 2.0, 0.2
"""The residual without the shift over that with it, for a lead and for a lag; how far a lag may be
from a whole number."""


def leads(record: Measurement) -> Iterator[Finding]:
    """A quasi-static loop follows the reading much better with the drive earlier or later.

    The loop is that of Prandtl and Ishlinskii, linear in its weights:

        y_k = a + b u_(k+s) + sum_i c_i play_i(u)_(k+s)

    Its residual is the least squares' for every shift s. An actuator lags (s < 0), by its mechanics
    and its amplifier, and by parts of a sample; none leads. So any lead that is sure is one of the
    channels, whole or not, for the actuator's lag is subtracted from it. A lag of exactly whole
    samples may be one of the channels.
    """
    # A drive that is logged more slowly comes half of its own step late: another finding.
    if not record.uniform or any(True for _ in slow_drives(record)):
        return
    best = _best_shift(record.drive, record.position)
    if best is None:
        return
    samples = round(best.shift)
    if not samples or record.counted.size <= 8 * abs(samples):
        return
    many = f"{abs(samples)} sample{'s' if abs(samples) > 1 else ''}"
    took = show(abs(samples) * record.step, "s")

    def mend(old: Measurement) -> tuple[Measurement, ...]:
        return (_shifted(old, samples),)

    if best.shift - _SURE * best.error > _PART and best.less > _LESS and best.sure > _SURE:
        yield Finding(
            "lead",
            Weight.REFUSED,
            f"The reading comes {many} ({took}) or more before the drive: the channels are shifted "
            "against each other, or the drive alone passed a filter.",
            answers("lead", f"moves the drive {many} earlier"),
            (),
            mend,
        )
    elif (
        samples < -1 and best.less > _MUCH_LESS and abs(best.shift - samples) < _WHOLE + best.error
    ):
        yield Finding(
            "lag",
            Weight.REMARK,
            f"The reading follows the drive after {many} ({took}): a delay, or channels that are "
            "shifted against each other.",
            f"If they are, --mend lag moves the drive {many} later; else the effect delay has it.",
            (),
            mend,
        )


@final
@dataclass(frozen=True)
class _Best:
    """The shift of the smallest residual.

    Attributes:
        shift: in samples, positive where the reading comes first.
        error: its standard error, by leaving out one block after another.
        less: rms residual without the shift over that with it.
        sure: mean fall of a block's squared residual over its standard error.
    """

    shift: float
    error: float
    less: float
    sure: float


def _best_shift(drive: FloatArray, reading: FloatArray) -> _Best | None:
    """The best shift, or None where there is none within reach."""
    n = min(drive.size, _SAMPLES)
    # Where most happens: the way of the drive over such a stretch.
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(drive)))])
    first = int(np.argmax(way[n - 1 :] - way[: drive.size - n + 1]))
    u, y = drive[first : first + n], reading[first : first + n]
    columns = np.column_stack([np.ones(n), u, _plays(u)])
    for reach in _REACHES:
        if n < 40 * reach:
            return None
        left = _residuals(columns, y, reach)
        k = int(np.argmin(left.sum(axis=1)))
        if 0 < k < 2 * reach:
            return _vertex(left, k, reach)
    return None


def _residuals(columns: FloatArray, reading: FloatArray, reach: int) -> FloatArray:
    """(2 reach + 1, blocks) squared residual of every shift and block."""
    n = reading.size
    first, last = max(reach, int(_SETTLED * n)), n - reach
    begins = np.linspace(0, last - first, _BLOCKS + 1).astype(int)[:-1]
    target = reading[first:last]
    left = np.empty((2 * reach + 1, _BLOCKS))
    for k in range(left.shape[0]):
        basis = columns[first + k - reach : last + k - reach]
        # Ten unknowns: their products are smaller than the threads that would factor the columns.
        answer, *_ = np.linalg.lstsq(basis.T @ basis, basis.T @ target, rcond=None)
        left[k] = np.add.reduceat((target - basis @ answer) ** 2, begins)
    return left


def _vertex(left: FloatArray, k: int, reach: int) -> _Best | None:
    """The vertex of the parabola through three residuals, from all blocks and without each."""
    slope = 0.5 * (left[k - 1] - left[k + 1])
    bend = left[k - 1] - 2.0 * left[k] + left[k + 1]
    others = bend.sum() - bend
    fall = left[reach] - left[k]
    scatter = float(fall.std(ddof=1)) / np.sqrt(_BLOCKS)
    smallest = float(left[k].sum())
    if np.any(others <= 0.0) or smallest <= 0.0:
        return None
    without = (slope.sum() - slope) / others
    return _Best(
        shift=k - reach + float(slope.sum() / bend.sum()),
        error=float(np.sqrt((_BLOCKS - 1) * np.mean((without - without.mean()) ** 2))),
        less=float(np.sqrt(left[reach].sum() / smallest)),
        sure=float(fall.mean()) / scatter if scatter > 0.0 else 0.0,
    )


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
