"""Strokes and drives that no actuator has: a unit is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.findings.finding import Finding, Mend, Weight, answers
from piezo_opt.units import show

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

_STROKE = (1e-11, 2e-2)
"""Smallest and largest stroke [m]: a hundredth of an atom; ten times the largest that is sold
(amplified stacks reach 2 mm)."""
_DRIVE = (1e-5, 2e5)
"""Smallest and largest range of a drive [V]."""
_USUAL = (1e-7, 1e-3)
"""Between these [m] lie nearly all strokes."""


def units(record: Measurement) -> Iterator[Finding]:
    """A stroke or a drive beyond what there is, with the unit that would make sense."""
    stroke, drive = float(np.ptp(record.position)), float(np.ptp(record.drive))
    if record.position_unit == "m" and not _STROKE[0] <= stroke <= _STROKE[1]:
        factor = next(
            (f for f in (1e-3, 1e-6, 1e-9, 1e-12, 1e3, 1e6, 1e9) if _usual(stroke * f)), None
        )
        said = (
            f"The reading moves by {show(stroke, 'm')} for {show(drive, record.drive_unit)}, which "
            "no piezo does: its unit is wrong."
        )
        if factor is None:
            remedy = "Correct the unit; --accept unit takes it as it is."
        else:
            meant = {1e-3: "mm", 1e-6: "um", 1e-9: "nm", 1e-12: "pm"}.get(factor)
            text = f"takes it as {meant}" if meant else f"multiplies it by {factor:g}"
            remedy = answers("unit", f"{text} ({show(stroke * factor, 'm')})")
        yield Finding(
            "unit", Weight.REFUSED, said, remedy, (),
            None if factor is None else _scaled(factor),
        )  # fmt: skip
    if record.drive_unit == "V" and not _DRIVE[0] <= drive <= _DRIVE[1]:
        yield Finding(
            "drive_unit",
            Weight.REFUSED,
            f"The drive moves by {show(drive, 'V')}, which no amplifier does: its unit is wrong.",
            "Correct the unit of the drive; --accept drive_unit takes it as it is.",
        )


def _usual(stroke: float) -> bool:
    return _USUAL[0] <= stroke <= _USUAL[1]


def _scaled(factor: float) -> Mend:
    def mend(old: Measurement) -> tuple[Measurement, ...]:
        return (old.with_(position=old.position * factor),)

    return mend
