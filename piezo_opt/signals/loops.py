"""Signals of straight lines and holds: for loops, minor loops, creep and steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_opt.choosing import real, whole, words
from piezo_opt.errors import InputError
from piezo_opt.signals.drive import Drive, check_range, sampled
from piezo_opt.units import show


def triangle(
    low: float, high: float, frequency: float, *, rate: float, periods: int = 1, unit: str = "V"
) -> Drive:
    """Up and down between low and high, from low.

    Args:
        low, high: [unit].
        frequency: [Hz].
        rate: samples a second [Hz].
        periods: whole ones; the last sample of all is low again.
        unit: SI unit of the drive.

    Raises:
        InputError: the range, frequency or rate makes no sense.
    """
    check_range(low, high, "triangle")
    period = _period(frequency, periods, "triangle")
    time = sampled(periods * period, rate, "triangle")
    time = np.append(time, periods * period) if periods == 1 else time
    wave = 1.0 - np.abs(1.0 - 2.0 * np.mod(time / period, 1.0))
    return Drive(
        f"triangle_{frequency:.3g}_Hz",
        f"triangle {low:g}..{high:g} {unit}, {frequency:g} Hz",
        low + (high - low) * wave,
        rate,
        unit,
        period=None if periods == 1 else period,
    )


def square(
    low: float,
    high: float,
    frequency: float,
    *,
    rate: float,
    duty: float = 0.5,
    periods: int = 1,
    unit: str = "V",
) -> Drive:
    """Low, and then high for the share ``duty`` of each period.

    Raises:
        InputError: a duty outside (0, 1), or less than a sample at either level.
    """
    check_range(low, high, "square")
    if not 0.0 < duty < 1.0:
        raise InputError(f"square: duty is {duty:g}; give a share between 0 and 1, 0.5")
    period = _period(frequency, periods, "square")
    time = sampled(periods * period, rate, "square")
    if min(duty, 1.0 - duty) * period * rate < 1.0:
        raise InputError(
            f"square: {duty:g} of a period at {frequency:g} Hz is shorter than a sample at "
            f"{rate:g} Hz: raise the rate"
        )
    # Half a sample's slack keeps rounding of the clock from moving an edge.
    phase = np.mod(time / period + 0.5 / (period * rate), 1.0)
    is_high = phase >= 1.0 - duty
    return Drive(
        f"square_{frequency:.3g}_Hz",
        f"square {low:.4g}/{high:.4g} {unit}, {frequency:.4g} Hz, {100.0 * duty:g} % high",
        np.where(is_high, high, low),
        rate,
        unit,
        period=period,
        steps=True,
    )


def staircase(levels: Sequence[float], hold: float, *, rate: float, unit: str = "V") -> Drive:
    """Levels [unit], each held for ``hold`` [s].

    Raises:
        InputError: fewer than two levels, or a hold shorter than a sample.
    """
    words(levels, "levels")
    if len(levels) < 2:
        raise InputError("staircase: give two levels at least")
    each = sampled(hold, rate, "staircase").size
    if each < 1:
        raise InputError(
            f"staircase: a hold of {hold:g} s is shorter than a sample: raise the rate"
        )
    shown = ", ".join(f"{level:.4g}" for level in levels)
    return Drive(
        f"staircase_{len(levels)}_levels",
        f"staircase {shown} {unit}, {show(hold, 's')} each",
        np.repeat(np.asarray(levels, dtype=np.float64), each),
        rate,
        unit,
        steps=True,
    )


def decaying_triangles(
    low: float,
    high: float,
    frequency: float,
    *,
    rate: float,
    count: int = 5,
    minor: int = 1,
    hold: float = 0.0,
    unit: str = "V",
) -> Drive:
    """Triangles from low whose tops fall evenly, with minor loops on the way down.

    All at one speed, 2 (high - low) frequency, so that amplitude is told from rate. A minor loop
    turns up again for a quarter of the top's height.

    Args:
        low, high: [unit], the first triangle's.
        frequency: of the first triangle [Hz].
        rate: samples a second [Hz].
        count: triangles; the k-th reaches the share 1 - k / count of the first.
        minor: minor loops on each way down.
        hold: at each end [s].
        unit: SI unit of the drive.

    Raises:
        InputError: no triangle, or a number or time below zero.
    """
    check_range(low, high, "decaying triangles")
    if count < 1 or minor < 0 or not hold >= 0.0:
        raise InputError(
            f"decaying triangles: {count} with {minor} minor loops, holds of {hold:g} s; give one "
            "triangle at least, and nothing below zero"
        )
    half = 0.5 * _period(frequency, 1, "decaying triangles")
    at, level = [0.0], [0.0]

    def go(to: float) -> None:
        at.append(at[-1] + half * abs(to - level[-1]))
        level.append(to)

    def stay() -> None:
        if hold > 0.0:
            at.append(at[-1] + hold)
            level.append(level[-1])

    for k in range(count):
        top = 1.0 - k / count
        go(top)
        stay()
        for loop in range(minor):
            turn = top * (1.0 - (loop + 1.0) / (minor + 1.0))
            go(turn)
            go(turn + 0.25 * top)
        go(0.0)
        stay()
    time = sampled(at[-1], rate, "decaying triangles")
    return Drive(
        f"decaying_{count}_triangles",
        f"{count} triangles from {low:.4g} {unit}, tops falling from {high:.4g} {unit}, {minor} "
        f"minor loop{'' if minor == 1 else 's'} each, {frequency:.4g} Hz"
        + (f", holds of {show(hold, 's')}" if hold > 0.0 else ""),
        low + (high - low) * np.interp(time, at, level),
        rate,
        unit,
    )


def _period(frequency: float, periods: int, name: str) -> float:
    real(frequency, f"{name}: frequency")
    whole(periods, f"{name}: periods", 0)
    if not 0.0 < frequency < np.inf or periods < 1:
        raise InputError(
            f"{name}: {periods} periods of {frequency:g} Hz; give a positive frequency and at "
            "least one period"
        )
    return 1.0 / frequency
