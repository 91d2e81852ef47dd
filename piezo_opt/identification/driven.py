"""How the drive moved between samples, where nobody has said.

A converter holds each value until the next one, a recorded voltage runs on a straight line from one
to the next: half a sample apart, and far apart at every step. A fit that takes one for the other
is left with a delay that is none.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from piezo_opt.effects.input.delay import Delay
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.effects.output.offset import Offset
from piezo_opt.effects.strain.bouc_wen import BoucWen
from piezo_opt.effects.strain.piezo_gain import PiezoGain
from piezo_opt.errors import NO_FIT
from piezo_opt.identification.quick import ENOUGH, Quick, quick
from piezo_opt.identification.stretch import busiest
from piezo_opt.identification.tall import inner
from piezo_opt.measurement import Between, Campaign, Measurement
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

_SURE = 10.0
"""Difference of the Bayesian information criterion that is very strong evidence (Kass & Raftery
1995)."""


def as_driven(
    records: Campaign | Measurement | Iterable[Measurement],
) -> tuple[Campaign, tuple[str, ...]]:
    """Records with a drive that is held where nobody has said how it moves, and they say so.

    On the first such record a loop with mechanics is fitted to the drive on straight lines and to
    the held one, each also with a delay, which is what looks like the other. By the Bayesian
    information criterion the held drive must beat straight lines by 10, alone and where either may
    have a delay. What such a model lacks makes the residual correlated: its samples count as so
    many independent ones.

    Returns:
        the records, and a sentence where a drive is taken as held.
    """
    campaign = Campaign.of(records)
    first = next((r for r in campaign.records if r.between is Between.UNKNOWN), None)
    if first is None or not _is_held(busiest(first, ENOUGH)):
        return campaign, ()
    held = (
        r.with_(between=Between.HELD) if r.between is Between.UNKNOWN else r
        for r in campaign.records
    )  # fmt: skip
    sentence = (
        f"{first.name}: the drive is taken as held from each sample to the next, as a converter "
        f"holds it, because on straight lines the reading would come half a sample "
        f"({show(0.5 * first.step, 's')}) late. Say --between linear if it is not."
    )
    return Campaign(tuple(held)), (sentence,)


def _is_held(record: Measurement) -> bool:
    plain = PiezoGain() + BoucWen() + SecondOrder() + Offset()
    line, step = (record.with_(between=b) for b in (Between.LINEAR, Between.HELD))
    try:
        along, held = quick(plain, line), quick(plain, step)
        # Each also from where the other one ended: a first fit may be stuck.
        along, held = (
            min(here, quick(plain, on, there.values), key=_squares)
            for here, on, there in ((along, line, held), (held, step, along))
        )
        late = {"delay.T": 0.5 * record.step}
        delayed = [
            quick(plain + Delay(), on, {**found.values, **late})
            for on, found in ((line, along), (step, held))
        ]
    except NO_FIT:
        return False
    told = [along, held, *delayed]
    n = _independent(min(told, key=_squares).residual)
    price = [
        float(n * np.log(max(found.squares, np.finfo(float).tiny)) + more * np.log(n))
        for found, more in zip(told, (0, 0, 1, 1), strict=True)
    ]
    line_alone, held_alone, line_late, held_late = price
    straight = min(line_alone, line_late)
    return held_alone < line_alone - _SURE and min(held_alone, held_late) < straight - _SURE


def _squares(found: Quick) -> float:
    return found.squares


def _independent(residual: FloatArray) -> float:
    """Samples that carry as much as these correlated ones: N (1 - rho) / (1 + rho), at least 2."""
    power = inner(residual, residual)
    rho = max(0.0, inner(residual[1:], residual[:-1]) / power) if power > 0.0 else 0.0
    return max(2.0, residual.size * (1.0 - rho) / (1.0 + rho))
