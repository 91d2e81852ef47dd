"""What a record shows about itself, before anything is fitted: one kind of finding, one file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from piezo_opt.measurement.findings.block_twice import blocks_twice
from piezo_opt.measurement.findings.butterfly import butterflies
from piezo_opt.measurement.findings.computed import computed
from piezo_opt.measurement.findings.disagreement import disagreements
from piezo_opt.measurement.findings.dropout import dropouts
from piezo_opt.measurement.findings.finding import Finding, Weight
from piezo_opt.measurement.findings.jitter import jitter
from piezo_opt.measurement.findings.jump import jumps
from piezo_opt.measurement.findings.lead import leads
from piezo_opt.measurement.findings.overload import overloads
from piezo_opt.measurement.findings.quantised_drive import quantised_drives
from piezo_opt.measurement.findings.sampling import aliasing, gaps, lone, resolutions
from piezo_opt.measurement.findings.slow_drive import slow_drives
from piezo_opt.measurement.findings.unit import units
from piezo_opt.measurement.findings.wrapped import wraps

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

__all__ = ["NAMES", "Finding", "Weight", "disagreements", "found"]

_KINDS: tuple[Callable[[Measurement], Iterator[Finding]], ...] = (
    jitter, slow_drives, overloads, wraps, dropouts, jumps, computed, leads, units, butterflies,
    blocks_twice, quantised_drives, gaps, resolutions, lone, aliasing,
)  # fmt: skip
"""In the order in which they are looked for, each on the record that the ones before have mended:
what they find would be found by others, too, under another name."""

NAMES = (
    "aliasing", "block_twice", "butterfly", "computed", "disagreement", "drive_overload",
    "drive_unit", "dropout", "frozen", "gap", "jitter", "jump", "lag", "lead", "lone", "overload",
    "quantised_drive", "resolution", "saturated", "slow_drive", "unit", "wrapped",
)  # fmt: skip
"""Names of all findings."""


def found(record: Measurement, accepted: frozenset[str] = frozenset()) -> tuple[Finding, ...]:
    """What a record shows about itself, in the order in which it is looked for.

    Args:
        record: the record.
        accepted: names of findings that are not mended before the next kind is looked for.
    """
    told: list[Finding] = []
    part: Measurement | None = None
    for kind in _KINDS:
        # Two records in one hide a shift of their channels, which is the same in both.
        looked_at = part if part is not None and kind is leads else record
        for finding in kind(looked_at):
            told.append(finding)
            if finding.mend is None or finding.weight is Weight.REMARK or finding.name in accepted:
                continue
            mended = finding.mend(record)
            if len(mended) == 1:
                record = mended[0]
            else:
                part = max(mended, key=len)
    # A jump makes the readings next to it stand alone; a clock that jitters is uneven.
    named = {one.name for one in told}
    implied = {"lone"} if "jump" in named else set()
    if "jitter" in named and record.clock.gaps == ():
        implied.add("gap")
    return tuple(one for one in told if one.name not in implied)
