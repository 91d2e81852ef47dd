"""A drive recorded in coarse steps although the actuator saw a smooth one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.findings.finding import Finding, Weight
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_LEVELS = 16
"""Fewer levels are a staircase that was meant."""
_COARSE, _DWELLS = 2e-3, 0.2
"""Step over range that is worth a word; share of the samples that are equal to the one before."""


def quantised_drives(record: Measurement) -> Iterator[Finding]:
    """The drive comes in steps, and moves mostly from one to the next."""
    drive = record.drive
    spread = float(np.ptp(drive))
    step = _grid(drive)
    if step is None or step <= _COARSE * spread or spread / step < _LEVELS:
        return
    moves = np.abs(np.diff(drive))
    # A drive that goes several steps at a time is a sequence of levels that was meant.
    # One that goes on with every sample was commanded like that; a smooth one dwells on its levels.
    if np.mean(moves < 1.5 * step) < 0.7 or np.mean(moves < 0.5 * step) < _DWELLS:
        return
    gain = float(np.ptp(record.position)) / spread
    yield Finding(
        "quantised_drive",
        Weight.REMARK,
        f"The drive is recorded in steps of {show(step, record.drive_unit)}, "
        f"{100 * step / spread:.2g} % of its range: if the actuator saw a smooth one, rounding "
        f"leaves about {show(gain * step / np.sqrt(12.0), record.position_unit)} rms.",
        "Record the drive with a smaller range of the input, or give the drive that was commanded.",
    )


def _grid(drive: FloatArray) -> float | None:
    """The step of which all differences between the drive's levels are multiples."""
    levels = np.unique(drive)
    apart = np.diff(levels)
    # Printed digits leave specks far below any step.
    apart = apart[apart > 1e-6 * np.ptp(levels)]
    if apart.size < _LEVELS - 1 or apart.size > 1.0 / _COARSE:
        return None
    step = float(np.median(apart))
    cells = apart / step
    on = np.abs(cells - np.round(cells)) <= 0.06
    return step if np.mean(on & (cells > 0.5)) >= 0.95 else None
