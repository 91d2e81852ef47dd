"""From one clock to an even one, by what is known about the signals between the samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
import scipy

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.between import Between
from piezo_opt.measurement.clock import Clock


@final
@dataclass(frozen=True, eq=False)
class Resampling:
    """New instants, and the way there for signals on the old ones.

    Attributes:
        time: (M,) new instants [s].
        between: how the drive moves between them.
        drive: takes the drive (N,) there (M,).
        other: takes any other signal (N,) there (M,).
    """

    time: FloatArray
    between: Between
    drive: Callable[[FloatArray], FloatArray]
    other: Callable[[FloatArray], FloatArray]


def resampling(clock: Clock, step: float, *, between: Between, period: float | None) -> Resampling:
    """The way from a clock to an even one of ``step`` [s], from the same start.

    Args:
        clock: the old one.
        step: the new one [s]; lower rates are low-passed first.
        between: how the drive moves between the old samples.
        period: of the steady state [s]; with whole periods of a band-limited drive on an even
            clock the Fourier series is exact.
    """
    if clock.uniform and between is Between.BANDLIMITED and period is not None:
        samples, new = round(period / clock.step), period / step
        whole = len(clock) == samples * (len(clock) // samples)
        if whole and abs(new - round(new)) < 1e-6 * new:
            return _by_fourier(clock, step, round(new) * (len(clock) // samples))
    lowered = clock.uniform and step > clock.step * (1 + 1e-9)
    count = int(np.floor(clock.duration / step + 1e-6)) + 1
    time = clock.time[0] + step * np.arange(count)

    def moved(values: FloatArray) -> FloatArray:
        return np.asarray(np.interp(time, clock.time, values), dtype=np.float64)

    def held(values: FloatArray) -> FloatArray:
        at = np.searchsorted(clock.time, time + 1e-9 * clock.step, side="right") - 1
        return np.asarray(values[at], dtype=np.float64)

    def filtered(values: FloatArray) -> FloatArray:
        smooth = _low_passed(values, clock.step / step)
        even = clock.time[0] + clock.step * np.arange(len(clock))
        return _cubic(even, smooth, time)

    other = filtered if lowered else moved
    hold = between is Between.HELD and not lowered
    return Resampling(
        time=time,
        between=Between.LINEAR if lowered and between is Between.HELD else between,
        drive=held if hold else other,
        other=other,
    )


def _by_fourier(clock: Clock, step: float, count: int) -> Resampling:
    def series(values: FloatArray) -> FloatArray:
        return np.asarray(scipy.signal.resample(values, count), dtype=np.float64)

    time = clock.time[0] + step * np.arange(count)
    return Resampling(time, Between.BANDLIMITED, drive=series, other=series)


def _low_passed(values: FloatArray, ratio: float) -> FloatArray:
    """Zero-phase low-pass at 0.8 of the new Nyquist frequency, ``ratio`` = old step / new step.

    A Kaiser-windowed sinc (60 dB); the ends are continued by odd reflection so that a trend
    stays a trend.
    """
    half = min(int(np.ceil(20.0 / ratio)), values.size - 1)
    kernel = scipy.signal.firwin(2 * half + 1, 0.8 * ratio, window=("kaiser", 5.65))
    head = 2.0 * values[0] - values[half:0:-1]
    tail = 2.0 * values[-1] - values[-2 : -half - 2 : -1]
    extended = np.concatenate([head, values, tail])
    return np.asarray(scipy.signal.oaconvolve(extended, kernel, mode="valid"), dtype=np.float64)


def _cubic(time: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    return np.asarray(
        scipy.interpolate.CubicSpline(time, values)(np.clip(at, time[0], time[-1])),
        dtype=np.float64,
    )
