"""What is refused as a record: signals that cannot be judged, and claims that they contradict."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.clock import Clock
from piezo_opt.units import show, to_si

FEWEST_SAMPLES = 8
"""A record shorter than this determines nothing."""

DROWNED = 1e-12
"""Share of the largest instant that a step must have: doubles have sixteen digits, and a step wants
four of them."""

_COMMON_UNITS = frozenset({"V", "m", "N", "A", "K", "C", "1"})


def check_signals(record: str, signals: Mapping[str, FloatArray]) -> None:
    """Refuse signals that are empty, too short, unequal, not finite, out of order or unmoved.

    Args:
        record: its name.
        signals: ``"time"``, ``"drive"`` and all others, each (N,).
    """
    time, drive = signals["time"], signals["drive"]
    if time.size == 0:
        raise InputError(f"{record}: is empty: a record needs {FEWEST_SAMPLES} samples or more")
    for name, values in signals.items():
        if values.size != time.size:
            raise InputError(
                f"{record}: {name} has {values.size} samples but time has {time.size}: "
                "cut both to the same length"
            )
    if time.size < FEWEST_SAMPLES:
        raise InputError(
            f"{record}: has {time.size} samples, too few: a record needs {FEWEST_SAMPLES} or more"
        )
    for name, values in signals.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            where = f"index {bad[0]}" + ("" if name == "time" else f" (t = {time[bad[0]]:g} s)")
            raise InputError(
                f"{record}: {name} is {values[bad[0]]} at {where}: remove the sample, "
                "gaps in time are allowed"
            )
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        row = int(late[0]) + 1
        kind = "repeats" if time[row] == time[row - 1] else "goes back"
        raise InputError(
            f"{record}: time {kind} at index {row} ({time[row - 1]:g} s, then {time[row]:g} s): "
            "sort the samples and keep one for each instant"
        )
    # Beyond these magnitudes sums of squares overflow or vanish, or a step vanishes in rounding.
    for name, values in signals.items():
        largest = float(np.max(np.abs(values)))
        if largest > 1e100:
            raise InputError(f"{record}: {name} reaches {largest:g}: check its unit")
        if 0.0 < largest < 1e-100:
            raise InputError(f"{record}: {name} stays below {largest:g}: check its unit")
    if float(np.min(np.diff(time))) < DROWNED * float(np.max(np.abs(time))):
        raise InputError(
            f"{record}: the steps of time drown in its offset of {time[0]:g} s: "
            "let the clock start near zero, or read it with its rate, rate='1 kHz'"
        )
    if np.ptp(drive) <= 1e-12 * float(np.max(np.abs(drive))):
        raise InputError(
            f"{record}: the drive is constant at {drive[0]:g}, which identifies nothing: "
            "record a drive that moves"
        )


def check_unit(record: str, unit: str) -> None:
    """Refuse a unit that is not SI."""
    # The common units are known to be SI; asking takes the units library a while to load.
    if unit in _COMMON_UNITS:
        return
    if not isinstance(unit, str):
        raise InputError(f"{record}: a unit is {unit!r}: write it as text, 'V' or 'm'")
    if float(to_si(1.0, unit)[0]) != 1.0:
        raise InputError(
            f"{record}: its signals are in SI units, and {unit!r} is none: convert it, "
            f"for example with to_si(values, {unit!r})"
        )


def check_startup(record: str, clock: Clock, startup: float) -> None:
    """Refuse a start-up [s] that is negative or leaves nothing to count."""
    if not 0.0 <= startup < np.inf:
        raise InputError(f"{record}: startup is {startup:g} s: give 0 s or more")
    if not clock.after(startup).any():
        raise InputError(
            f"{record}: the start-up of {show(startup, 's')} covers the whole record "
            f"of {show(clock.duration, 's')}: shorten it"
        )


def check_period(record: str, clock: Clock, drive: FloatArray, period: float) -> None:
    """Refuse a period [s] that does not fit the clock, or that the drive does not repeat with."""
    step = clock.step
    if not 0.0 < period < np.inf:
        raise InputError(f"{record}: period is {period:g} s: give a positive one or none")
    if period > (clock.duration + step) * (1 + 1e-6):
        raise InputError(
            f"{record}: a period of {show(period, 's')} does not fit the record of "
            f"{show(clock.duration + step, 's')}: record a whole period or give none"
        )
    if not clock.uniform:
        return
    samples = period / step
    # The last period must still fall on the grid, not just the first.
    drift = abs(samples - round(samples)) * len(clock) / max(samples, 1.0)
    if round(samples) < 2 or drift > 0.05:
        raise InputError(
            f"{record}: a period of {show(period, 's')} is {samples:.6g} samples, not a whole "
            "number: give a multiple of it that is, or resample the record"
        )
    whole = len(clock) // round(samples)
    if whole < 2:
        return
    repeated = drive[: whole * round(samples)].reshape(whole, -1)
    varies = np.sqrt(np.mean((repeated - repeated.mean(axis=0)) ** 2))
    if varies > 0.2 * np.std(drive):
        raise InputError(
            f"{record}: the drive does not repeat every {show(period, 's')}: correct the period "
            "or give none"
        )


def check_saturation(
    record: str, time: FloatArray, drive: FloatArray, reading: FloatArray, unit: str
) -> None:
    """Refuse a reading [unit] stuck at its end while the drive moves on.

    A coarse reading is stuck everywhere a little, so a run at the end only counts when the drive
    moves much further in it than in the usual run in the interior.
    """
    spread = float(np.ptp(reading))
    if spread == 0.0:
        raise InputError(
            f"{record}: the reading is constant at {reading[0]:g} {unit}: check the sensor"
        )
    edges = np.flatnonzero(np.diff(reading) != 0) + 1
    starts = np.concatenate([[0], edges])
    stops = np.concatenate([edges, [reading.size]])
    at_end = (reading[starts] == reading.max()) | (reading[starts] == reading.min())
    long = at_end & (stops - starts >= max(5, int(np.ceil(0.05 * reading.size))))
    if not long.any():
        return
    drive_range = float(np.ptp(drive))
    inside = [
        _monotone_travel(drive[a:b])
        for a, b in zip(starts[~at_end], stops[~at_end], strict=True)
        if b - a > 1
    ]
    usual = float(np.median(inside)) if inside else 0.0
    for a, b in zip(starts[long], stops[long], strict=True):
        travel = _monotone_travel(drive[a:b])
        if travel > 0.05 * drive_range and travel > 3.0 * usual:
            raise InputError(
                f"{record}: the reading is stuck at {reading[a]:g} {unit} "
                f"from t = {time[a]:g} s to {time[b - 1]:g} s while the drive moves "
                f"by {100 * travel / drive_range:.0f} % of its range: it is saturated; remove "
                "those samples or pass allow_saturated=True"
            )


def _monotone_travel(drive: FloatArray) -> float:
    """The longest way the drive goes in one direction [drive unit]."""
    if drive.size < 2:
        return 0.0
    moves = np.diff(drive)
    turns = np.flatnonzero(moves[1:] * moves[:-1] < 0) + 1
    corners = drive[np.concatenate([[0], turns, [drive.size - 1]])]
    return float(np.max(np.abs(np.diff(corners))))
