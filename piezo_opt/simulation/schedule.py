"""When the drive bends and when the reading is taken: the time axis of a simulation as data.

The time of a record is cut at every corner of the drive and at every reading, so that within a
segment the drive is one straight line. A pure delay T shifts the readings against the drive: the
chain runs on the drive's own clock and is read at t - T. Only lengths of segments depend on T,
which makes the derivative by T exact.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace
from typing import final
from weakref import WeakKeyDictionary

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.lazy import lazy
from piezo_opt.measurement import Between, Measurement

FloatArray = NDArray[np.float64]

_RAMP = 1e-3
"""Length of a step of a held drive, as a share of the sampling step."""
_FINER = 16
"""Points a sample between which a band-limited drive is taken as straight."""


@final
class Addresses(ctypes.Structure):
    """Memory addresses of a :class:`Segment`'s columns; valid as long as it lives.

    ``po_segments`` in ``core.c``; the number of sub-steps is for a run to fill in.
    """

    _fields_ = [
        (name, ctypes.c_void_p)
        for name in (
            "length", "substeps", "time", "drive", "slope", "channels", "channel_slopes",
            "length_by_delay", "drive_by_delay", "time_by_delay", "channels_by_delay", "reading",
        )
    ]  # fmt: skip


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
    travel: FloatArray
    """How far the measured motion goes in each segment, there and back [m]."""

    @lazy
    def begins(self) -> FloatArray:
        """(2 + c,) time [s], drive [V] and channels at the start."""
        return np.concatenate([self.time[:1], self.drive[:1], self.channels[0]])

    @lazy
    def readings(self) -> int:
        """Number of readings taken."""
        return int((self.reading >= 0).sum())

    @lazy
    def moves(self) -> FloatArray:
        """How far the drive moves in each segment [V]."""
        return np.asarray(np.abs(self.slope) * self.length)

    @lazy
    def longest(self) -> float:
        """The longest segment [s]."""
        return float(self.length.max())

    @lazy
    def largest_move(self) -> float:
        """The farthest that the drive moves in one [V]."""
        return float(self.moves.max())

    @lazy
    def farthest(self) -> float:
        """The farthest that the measured motion goes in one [m]."""
        return float(self.travel.max())

    @lazy
    def lengths(self) -> int:
        """Number of different lengths."""
        return int(np.unique(self.length).size)

    @lazy
    def by_slope(self) -> tuple[int, ...]:
        """Indices of a segment of the least, the median and the largest slope; each once."""
        steep = np.abs(self.slope)
        middle = int(np.argsort(steep, kind="stable")[steep.size // 2])
        return tuple(dict.fromkeys((int(steep.argmin()), middle, int(steep.argmax()))))

    @lazy
    def even(self) -> Segment:
        """Lengths without the rounding of time stamps, so that equal ones are the same number.

        A difference of two stamps is known to the last digit of the larger one; adding a number
        some times as large leaves none beyond.
        """
        large = 8.0 * float(np.abs(self.time + self.length).max(initial=0.0))
        return replace(self, length=(self.length + large) - large)

    @lazy
    def addresses(self) -> Addresses:
        """Where the columns lie in memory, for the C program."""
        found = Addresses()
        for name in (field[0] for field in found._fields_):
            if name == "substeps":
                continue
            column = getattr(self, name)
            kind = np.int32 if name == "reading" else np.float64
            if column.dtype != kind or not column.flags.c_contiguous:
                raise ValueError(f"{name}: the C program reads contiguous {kind.__name__}")
            if column.shape[0] != self.length.size:
                raise ValueError(f"{name}: {column.shape[0]} rows for {self.length.size}")
            setattr(found, name, column.ctypes.data)
        return found


@final
@dataclass(frozen=True, eq=False)
class Drive:
    """Corners of a drive: time from the record's start [s], drive [V], and channels there."""

    time: FloatArray
    value: FloatArray
    channel_time: FloatArray
    channels: FloatArray
    """(samples of the record, channels)"""
    way: FloatArray
    """How far the measured motion has gone at the record's samples, there and back [m]."""
    closed: Drive | None = None
    """The first period, closed on itself, of a record that has a period."""

    @lazy
    def sampled(self) -> Segment:
        """The time axis of a chain without a delay that is read at the record's samples."""
        return segments(self, self.channel_time)


_KEPT: WeakKeyDictionary[Measurement, dict[tuple[str, ...], Drive]] = WeakKeyDictionary()
"""Drives of the records that are in use: a search simulates one record with hundreds of models."""


def corners(record: Measurement, channels: tuple[str, ...]) -> Drive:
    """The drive of a record as a chain of straight lines, as its ``between`` says.

    Raises:
        InputError: a band-limited drive is not evenly sampled.
    """
    kept = _KEPT.setdefault(record, {})
    if channels not in kept:
        kept[channels] = _corners(record, channels)
    return kept[channels]


def _corners(record: Measurement, channels: tuple[str, ...]) -> Drive:
    t = record.time - record.time[0]
    beside = np.array([record.channels[c] for c in channels], dtype=float).T.reshape(t.size, -1)
    if record.between is Between.BANDLIMITED and not record.uniform:
        raise InputError(
            f"{record.name}: a band-limited drive needs even sampling; take between=LINEAR, or "
            "resample the record."
        )
    way = _way(record.position)
    closed = None if record.period is None else _closed(record, record.period, t, beside, way)
    return Drive(*_lines(record, t, record.drive), t, beside, way, closed)


def _way(position: FloatArray) -> FloatArray:
    """How far a motion (N,) has gone at each sample [m].

    What swings may be at its turn at one sample and in full motion at the next: every stretch
    counts as its fastest neighbour.
    """
    stretches = np.abs(np.diff(position))
    fastest = stretches.copy()
    np.maximum(fastest[1:], stretches[:-1], out=fastest[1:])
    np.maximum(fastest[:-1], stretches[1:], out=fastest[:-1])
    return np.concatenate([[0.0], np.cumsum(fastest)])


def _lines(record: Measurement, t: FloatArray, drive: FloatArray) -> tuple[FloatArray, FloatArray]:
    if record.between is Between.HELD:
        return _held(t, drive, _RAMP * record.step)
    if record.between is Between.BANDLIMITED:
        return _band_limited(record)
    return t, np.asarray(drive, dtype=float)


def _closed(
    record: Measurement, period: float, t: FloatArray, beside: FloatArray, way: FloatArray
) -> Drive:
    # The sample at the period's end is that at its start, whatever its time is rounded to.
    inside = t < period - 0.01 * record.step
    time = np.append(t[inside], period)
    channels = np.vstack([beside[inside], beside[:1]])
    gone = np.append(way[inside], np.interp(period, t, way))
    if record.between is Between.BANDLIMITED:
        fine = scipy.signal.resample(record.drive[inside], int(inside.sum()) * _FINER)
        value = np.append(fine, fine[0])
        return Drive(np.linspace(0.0, period, value.size), value, time, channels, gone)
    drive = np.append(record.drive[inside], record.drive[0])
    return Drive(*_lines(record, time, drive), time, channels, gone)


def cycle(drive: Drive, period: float) -> Segment:
    """The first period [s] of a drive, closed on itself.

    Raises:
        ValueError: the drive is not that of a record with a period.
    """
    if drive.closed is None:
        raise ValueError("the record has no period")
    return segments(drive.closed, np.array([0.0, period]))


def led_in(drive: Drive, times: int) -> Drive:
    """A periodic drive with whole periods before it: the past that a delayed chain answers to.

    Raises:
        ValueError: the drive is not that of a record with a period.
    """
    if drive.closed is None:
        raise ValueError("the record has no period")
    one = drive.closed
    shifts = float(one.time[-1]) * np.arange(-times, 0)

    def at(time: FloatArray) -> FloatArray:
        return np.asarray((shifts[:, None] + time[None, :-1]).ravel())

    return Drive(
        np.concatenate([at(one.time), drive.time]),
        np.concatenate([*[one.value[:-1]] * times, drive.value]),
        np.concatenate([at(one.channel_time), drive.channel_time]),
        np.concatenate([*[one.channels[:-1]] * times, drive.channels]),
        np.concatenate([*(one.way[:-1] + k * one.way[-1] for k in range(-times, 0)), drive.way]),
    )


def _held(t: FloatArray, drive: FloatArray, ramp: float) -> tuple[FloatArray, FloatArray]:
    """A held drive: steps as fast ramps that end at the sample."""
    jump = np.flatnonzero(np.diff(drive)) + 1
    before = np.maximum(t[jump] - ramp, 0.5 * (t[jump] + t[jump - 1]))
    time = np.concatenate([t, before])
    value = np.concatenate([drive, drive[jump - 1]])
    order = np.argsort(time, kind="stable")
    return np.asarray(time[order], dtype=float), np.asarray(value[order], dtype=float)


def _band_limited(record: Measurement) -> tuple[FloatArray, FloatArray]:
    """The drive between the samples as the band-limited signal through them."""
    n = record.time.size
    if record.period is not None:
        one = round(record.period / record.step)
        fine = scipy.signal.resample(record.drive[:one], one * _FINER)
        total = (n - 1) * _FINER + 1
        value = np.resize(fine, total)
    else:
        # Mirrored ends keep the resampling filter from ringing at the borders.
        pad = min(n - 1, 64)
        d = np.asarray(record.drive)
        ends = np.concatenate([2 * d[0] - d[pad:0:-1], d, 2 * d[-1] - d[-2 : -pad - 2 : -1]])
        # Ripples by 1e-4 of the drive up to 0.9 of the band; resample_poly's own filter by 2e-3.
        smooth = _FINER * scipy.signal.firwin(64 * _FINER + 1, 1.0 / _FINER, window=("kaiser", 8.0))
        fine = scipy.signal.upfirdn(smooth, ends, up=_FINER)[32 * _FINER :]
        value = fine[pad * _FINER : pad * _FINER + (n - 1) * _FINER + 1]
    time = np.arange(value.size) * (record.step / _FINER)
    return np.asarray(time, dtype=np.float64), np.asarray(value, dtype=np.float64)


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
    inside = drive.time[drive.time < at[-1]]
    # Nearly always the drive is known where the reading is, and there is nothing to sort.
    same = delay is None and np.array_equal(drive.time, at)
    if same:
        knots, index = at, np.arange(at.size, dtype=np.int32)
        by_delay = np.zeros(knots.size)
    elif delay is None:
        first = min(float(drive.time[0]), float(at[0]))
        knots = np.unique(np.concatenate([[first], inside, at]))
        index = np.full(knots.size, -1, dtype=np.int32)
        index[np.searchsorted(knots, at)] = np.arange(at.size, dtype=np.int32)
        by_delay = np.zeros(knots.size)
    else:
        knots = np.concatenate([at, inside])
        number = np.concatenate([np.arange(at.size), np.full(inside.size, -1)])
        order = np.lexsort((number < 0, knots))
        knots, index = knots[order], number[order].astype(np.int32)
        by_delay = np.where(index >= 0, -1.0, 0.0)
    start, start_by_delay = _before(knots), _before(by_delay)
    line = np.arange(at.size) if same else np.searchsorted(drive.time, knots, side="left")
    line = np.clip(line, 1, drive.time.size - 1)
    slopes = np.diff(drive.value) / np.diff(drive.time)
    slope = np.where((knots > drive.time[0]) & (start < drive.time[-1]), slopes[line - 1], 0.0)
    shift = 0.0 if delay is None else delay
    at_samples = same and np.array_equal(drive.channel_time, at)
    if at_samples:
        gone, goes = _before(drive.way), drive.way
    else:
        gone, goes = np.interp([start + shift, knots + shift], drive.channel_time, drive.way)
    beside, beside_start = _channels(drive, knots + shift), _channels(drive, start + shift)
    length = knots - start
    safe = np.where(length > 0, length, 1.0)[:, None]
    beside_slope = np.where(length[:, None] > 0, (beside - beside_start) / safe, 0.0)
    time_by_delay = start_by_delay + (0.0 if delay is None else 1.0)
    return Segment(
        length=length,
        time=start + shift,
        drive=_before(drive.value) if same else np.interp(start, drive.time, drive.value),
        slope=slope,
        channels=np.ascontiguousarray(beside_start),
        channel_slopes=np.ascontiguousarray(beside_slope),
        length_by_delay=by_delay - start_by_delay,
        drive_by_delay=slope * start_by_delay,
        time_by_delay=time_by_delay,
        channels_by_delay=np.ascontiguousarray(beside_slope * time_by_delay[:, None]),
        reading=np.ascontiguousarray(index, dtype=np.int32),
        travel=goes - gone,
    )


def _before(values: FloatArray) -> FloatArray:
    """What was one place earlier; the first stays where it is."""
    return np.concatenate([values[:1], values[:-1]])


def _channels(drive: Drive, at: FloatArray) -> FloatArray:
    columns = [
        np.interp(at, drive.channel_time, drive.channels[:, i])
        for i in range(drive.channels.shape[1])
    ]
    return np.array(columns, dtype=float).T.reshape(at.size, drive.channels.shape[1])
