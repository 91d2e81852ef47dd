"""A reading that is computed from the drive: a set point, not a measurement."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.findings.finding import Finding, Weight

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_DIGITS = 1e-7
"""Residual of the curve over the reading's range: nine printed digits leave a hundredth of it."""
_ORDER, _LEVELS = 3, 8
"""Order of the curve, and fewest levels of a drive that it cannot pass through anyway."""


def computed(record: Measurement) -> Iterator[Finding]:
    """The reading is a cubic of the drive to the last digit."""
    u, y = record.drive, record.position
    some = slice(None, None, max(1, u.size // 2000))
    # A few samples tell of most records that they are none such; sorting all would take longer.
    few = np.unique(u[some]).size < _LEVELS
    if np.ptp(y) == 0.0 or (few and np.unique(u).size < _LEVELS):
        return
    scaled = 2.0 * (u - u.min()) / np.ptp(u) - 1.0
    powers = np.vander(scaled[some], _ORDER + 1, increasing=True)
    curve = np.linalg.lstsq(powers, y[some], rcond=None)[0]
    if _left(scaled[some], y[some], curve) > _DIGITS * np.ptp(y):
        return
    if _left(scaled, y, curve) > _DIGITS * np.ptp(y):
        return
    straight = np.abs(curve[2:]).max() <= _DIGITS * np.ptp(y)
    slope = 2.0 * curve[1] / np.ptp(u)
    what = (
        f"is the drive times {slope:.4g} {record.position_unit}/{record.drive_unit}"
        if straight
        else "is a function of the drive"
    )
    others = [
        name
        for name, unit in record.channel_units.items()
        if unit == record.position_unit and name in record.channels
    ]
    remedy = (
        f"The record also has {', '.join(repr(o) for o in others)}: --position {others[0]!r}; "
        if others
        else "Choose the measured column with --position; "
    )

    yield Finding(
        "computed",
        Weight.REFUSED,
        f"The reading {what} to the last digit: a set point or a computed value, which no "
        "measurement is.",
        remedy + "--accept computed takes it as it is.",
    )


def _left(scaled: np.ndarray, y: np.ndarray, curve: np.ndarray) -> float:
    return float(np.abs(y - np.polyval(curve[::-1], scaled)).max())
