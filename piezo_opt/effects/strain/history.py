"""What a hysteresis of plays remembers of the drive before a record."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from piezo_opt.effects.base import Parameter
from piezo_opt.symbolic import play

ELSEWHERE: tuple[Mapping[str, float], ...] = (
    {"swing": -1.0, "swing_before": 2.0},
    {"swing": 1.0, "swing_before": -2.0},
)
"""Swings from which a fit begins as well, because its error has a minimum of its own wherever they
turn: down after all was wiped out from below, and the reverse."""


def history() -> dict[str, Parameter]:
    """Parameters of a history, by name."""
    return {
        "origin": Parameter(
            "V", "drive from which the record's beginning was reached", nominal=0.0,
            bounds=(-1e6, 1e6), typical=(-50.0, 100.0), fixed=True, detail=True, per_record=True,
        ),
        "swing": Parameter(
            "1", "swing that led to the origin, upwards, over r", nominal=0.0, bounds=(-2.0, 2.0),
            typical=(-1.0, 1.0), fixed=True, detail=True, per_record=True,
        ),
        "swing_before": Parameter(
            "1", "swing before that one, upwards, over r", nominal=0.0, bounds=(-2.0, 2.0),
            typical=(-1.0, 1.0), fixed=True, detail=True, per_record=True,
        ),
    }  # fmt: skip


def remembered(p: Any, v: Any, radii: Any) -> Any:
    """Plays at the beginning of a record, for a drive that went from turning point to turning
    point.

        origin - (swing + swing_before) r -> origin - swing r -> origin -> v

    Each play begins at the first of them, as a demagnetised actuator does that was driven there. A
    swing of 2 r, twice the largest radius, leaves nothing of what was before it. With both swings
    0 the drive came from the origin at once.

    Args:
        p: parameters of the effect, those of :func:`history` and r among them.
        v: first value of the drive [V].
        radii: of the plays [V], none larger than r.
    """
    last = p.origin - p.swing * p.r
    first = last - p.swing_before * p.r
    begun = play(first + 0.0 * radii, last, radii)
    return play(play(begun, p.origin, radii), v, radii)
