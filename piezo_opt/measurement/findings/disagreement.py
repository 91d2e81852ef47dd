"""Records of one campaign that disagree by a factor: a range switch, another gain."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.measurement.findings.finding import Finding, Weight

if TYPE_CHECKING:
    from piezo_opt.measurement.campaign import Campaign
    from piezo_opt.measurement.record import Measurement

_FACTOR = 2.5
"""A loop's gain changes with the swing of its drive by less."""
_SHARED = 1e-3
"""Share of the strongest band's power that a band must have in both drives."""
_BANDS = 24


def disagreements(campaign: Campaign) -> Iterator[Finding]:
    """Gains that differ by a factor where two drives have power in the same bands."""
    first = campaign.records[0]
    for other in campaign.records[1:]:
        factor = _factor(first, other)
        if factor is None or 1.0 / _FACTOR < factor < _FACTOR:
            continue
        yield Finding(
            "disagreement",
            Weight.REFUSED,
            f"{other.name} moves {factor:.3g} times as far as {first.name} on the same drive: "
            "a range switch, another gain, or another unit.",
            "Correct the one that is wrong, or fit them one by one; --accept disagreement fits "
            "them together.",
        )


def _factor(first: Measurement, other: Measurement) -> float | None:
    """Gain of one record over that of another, median over the bands that both drives have."""
    top = min(first.rate, other.rate) / 2.0
    bottom = max(1.0 / first.duration, 1.0 / other.duration)
    if not top > 4.0 * bottom:
        return None
    edges = np.geomspace(bottom / 2.0, top, _BANDS + 1)
    u1, y1 = (_bands(first, s, edges) for s in (first.drive, first.position))
    u2, y2 = (_bands(other, s, edges) for s in (other.drive, other.position))
    shared = (u1 > _SHARED * u1.max()) & (u2 > _SHARED * u2.max()) & (y1 > 0.0) & (y2 > 0.0)
    if not shared.any():
        return None
    return float(np.sqrt(np.median(y2[shared] / u2[shared] * u1[shared] / y1[shared])))


def _bands(record: Measurement, values: FloatArray, edges: FloatArray) -> FloatArray:
    """Power of a signal in each band, on an even clock of the record's length."""
    even = np.linspace(record.time[0], record.time[-1], len(record))
    moved = np.interp(even, record.time, values)
    moved = (moved - moved.mean()) * np.hanning(moved.size)
    power = np.abs(np.fft.rfft(moved)) ** 2 / float(moved.size) ** 2
    at = np.fft.rfftfreq(moved.size, even[1] - even[0])
    return np.histogram(at, bins=edges, weights=power)[0]
