"""The remedy for readings that are none: they are not counted, and nobody meets their values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.findings.finding import Mend, mask_of

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement


def leaving_out(stretches: tuple[tuple[int, int], ...], *, drive: bool = False) -> Mend:
    """Not to count these samples; a straight line stands in for them, in pictures too.

    The drive stays as it is, unless it is as wrong as the reading: an actuator remembers, so what
    it was given counts even where nobody looked.
    """

    def mend(record: Measurement) -> tuple[Measurement, ...]:
        gone = mask_of(stretches, len(record))
        kept = ~gone
        changes = {
            "position": np.interp(record.time, record.time[kept], record.position[kept]),
            "left_out": gone | record.left_out,
        }
        if drive:
            changes["drive"] = np.interp(record.time, record.time[kept], record.drive[kept])
        return (record.with_(**changes),)

    return mend
