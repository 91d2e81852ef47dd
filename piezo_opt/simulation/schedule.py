"""When the drive bends and when the reading is taken: the time axis of a simulation as data.

The time of a record is cut at every corner of the drive and at every reading, so that within a
segment the drive is one straight line. A pure delay T shifts the readings against the drive: the
chain runs on the drive's own clock and is read at t - T. Only lengths of segments depend on T,
which makes the derivative by T exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from piezo_opt.measurement import Between, Measurement

FloatArray = NDArray[np.float64]

_RAMP = 1e-3
"""Length of a step of a held drive, as a share of the sampling step."""
_FINER = 16
"""Points a sample between which a band-limited drive is taken as straight."""


@final
@dataclass(frozen=True, eq=False)
class Segment:
    """Straight stretches of the drive, as columns over segments (see the C program's comment)."""

    length: FloatArray
    time: FloatArray
    drive: FloatArray
    slope: FloatArray
    channels: FloatArray
    channel_slopes: FloatArray
    length_by_delay: FloatArray
    drive_by_delay: FloatArray
    time_by_delay: FloatArray
    channels_by_delay: FloatArray
    reading: NDArray[np.int32]

    @property
    def readings(self) -> int:
        """Number of readings taken."""
        return int((self.reading >= 0).sum())


@final
@dataclass(frozen=True, eq=False)
class Drive:
    """Corners of a drive: time from the record's start [s], drive [V], and channels there."""

    time: FloatArray
    value: FloatArray
    channel_time: FloatArray
    channels: FloatArray
    """(samples of the record, channels)"""


def corners(record: Measurement, channels: tuple[str, ...]) -> Drive:
    """The drive of a record as a chain of straight lines, as its ``between`` says."""
    t = record.time - record.time[0]
    beside = np.array([record.channels[c] for c in channels], dtype=float).T.reshape(t.size, -1)
    if record.between is Between.HELD:
        ramp = _RAMP * record.step
        jump = np.flatnonzero(np.diff(record.drive)) + 1
        before = np.maximum(t[jump] - ramp, 0.5 * (t[jump] + t[jump - 1]))
        time = np.concatenate([t, before])
        value = np.concatenate([record.drive, record.drive[jump - 1]])
        order = np.argsort(time, kind="stable")
        return Drive(time[order], value[order], t, beside)
    if record.between is Between.BANDLIMITED:
        return Drive(*_band_limited(record), t, beside)
    return Drive(t, np.asarray(record.drive), t, beside)


def _band_limited(record: Measurement) -> tuple[FloatArray, FloatArray]:
    """The drive between the samples as the band-limited signal through them."""
    n = record.time.size
    if record.period is not None:
        one = round(record.period / record.step)
        fine = signal.resample(record.drive[:one], one * _FINER)
        total = (n - 1) * _FINER + 1
        value = np.resize(fine, total)
    else:
        # Mirrored ends keep the resampling filter from ringing at the borders.
        pad = min(n - 1, 64)
        d = np.asarray(record.drive)
        ends = np.concatenate([2 * d[0] - d[pad:0:-1], d, 2 * d[-1] - d[-2 : -pad - 2 : -1]])
        fine = signal.resample_poly(ends, _FINER, 1)
        value = fine[pad * _FINER : pad * _FINER + (n - 1) * _FINER + 1]
    return np.arange(value.size) * (record.step / _FINER), np.asarray(value, dtype=float)


def segments(drive: Drive, readings: FloatArray, delay: float | None = None) -> Segment:
    """Cut time at the corners of the drive and at the readings.

    Args:
        drive: corners; before the first one the drive stands still, after the last one too.
        readings: times from the record's start at which the reading is taken [s].
        delay: seconds by which the readings lag the drive; None for a chain without a delay.
            With a delay (even of 0 s) a corner and a reading never share a cut, because a longer
            delay moves the one against the other.
    """
    at = readings if delay is None else readings - delay
    first = min(float(drive.time[0]), float(at[0]))
    inside = drive.time[(drive.time > first) & (drive.time < at[-1])]
    if delay is None:
        knots = np.unique(np.concatenate([[first], inside, at]))
        index = np.full(knots.size, -1, dtype=np.int32)
        index[np.searchsorted(knots, at)] = np.arange(at.size, dtype=np.int32)
        by_delay = np.zeros(knots.size)
    else:
        knots = np.concatenate([at, inside])
        number = np.concatenate([np.arange(at.size), np.full(inside.size, -1)])
        order = np.lexsort((number < 0, knots))
        knots, index = knots[order], number[order].astype(np.int32)
        if first < at[0]:
            knots, index = np.append(first, knots), np.append(np.int32(-1), index)
        by_delay = np.where(index >= 0, -1.0, 0.0)
    start = np.concatenate([knots[:1], knots[:-1]])
    start_by_delay = np.concatenate([by_delay[:1], by_delay[:-1]])
    line = np.clip(np.searchsorted(drive.time, knots, side="left"), 1, drive.time.size - 1)
    slopes = np.diff(drive.value) / np.diff(drive.time)
    slope = np.where((knots > drive.time[0]) & (start < drive.time[-1]), slopes[line - 1], 0.0)
    shift = 0.0 if delay is None else delay
    beside, beside_start = _channels(drive, knots + shift), _channels(drive, start + shift)
    length = knots - start
    safe = np.where(length > 0, length, 1.0)[:, None]
    beside_slope = np.where(length[:, None] > 0, (beside - beside_start) / safe, 0.0)
    time_by_delay = start_by_delay + (0.0 if delay is None else 1.0)
    return Segment(
        length=length,
        time=start + shift,
        drive=np.interp(start, drive.time, drive.value),
        slope=slope,
        channels=np.ascontiguousarray(beside_start),
        channel_slopes=np.ascontiguousarray(beside_slope),
        length_by_delay=by_delay - start_by_delay,
        drive_by_delay=slope * start_by_delay,
        time_by_delay=time_by_delay,
        channels_by_delay=np.ascontiguousarray(beside_slope * time_by_delay[:, None]),
        reading=np.ascontiguousarray(index, dtype=np.int32),
    )


def _channels(drive: Drive, at: FloatArray) -> FloatArray:
    columns = [
        np.interp(at, drive.channel_time, drive.channels[:, i])
        for i in range(drive.channels.shape[1])
    ]
    return np.array(columns, dtype=float).T.reshape(at.size, drive.channels.shape[1])
