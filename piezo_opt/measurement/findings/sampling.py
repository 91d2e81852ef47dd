"""What the sampling of a record hides, as findings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from piezo_opt.measurement.findings.finding import Finding, Weight
from piezo_opt.measurement.findings.left_out import leaving_out
from piezo_opt.measurement.outliers import lone_readings, outlier_remarks
from piezo_opt.measurement.remarks import aliasing_remarks, gap_remarks, resolution_remarks

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement


def gaps(record: Measurement) -> Iterator[Finding]:
    """On what happened while nothing was sampled."""
    for sentence in gap_remarks(record.clock):
        yield Finding("gap", Weight.REMARK, sentence)


def resolutions(record: Measurement) -> Iterator[Finding]:
    """On what rounding the reading leaves."""
    for sentence in resolution_remarks(record.position, record.resolution, record.position_unit):
        yield Finding("resolution", Weight.REMARK, sentence)


def lone(record: Measurement) -> Iterator[Finding]:
    """On readings that stand alone."""
    said = outlier_remarks(record.time, record.drive, record.position, record.position_unit)
    for sentence in said:
        at = lone_readings(record.drive, record.position)
        found = tuple((int(k), int(k) + 1) for k in at)
        yield Finding(
            "lone", Weight.REMARK, sentence, "--mend lone leaves them out.", found,
            leaving_out(found),
        )  # fmt: skip


def aliasing(record: Measurement) -> Iterator[Finding]:
    """On what is faster than the samples."""
    for sentence in aliasing_remarks(record.clock, record.drive, record.between):
        yield Finding("aliasing", Weight.REMARK, sentence)
