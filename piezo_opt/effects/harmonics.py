"""Periodic errors: a sine and its harmonics, what hum and interferometers have in common."""

from __future__ import annotations

from collections.abc import Sequence

from piezo_opt.effects.base import Parameter
from piezo_opt.symbolic import Expression, cos, sin


def harmonic(meaning: str, unless: str | tuple[str, ...] = ()) -> Parameter:
    """Amplitude of a harmonic over that of the fundamental; kept at 0 unless freed.

    Args:
        meaning: which one.
        unless: options of the effect without which there is this parameter.
    """
    return Parameter(
        "1", meaning, nominal=0.0, bounds=(-10.0, 10.0), typical=(-0.1, 0.1), fixed=True,
        detail=True, unless=unless,
    )  # fmt: skip


def periodic(turn: Expression, *harmonics: Sequence[Expression]) -> Expression:
    """``sin p + s_2 sin 2p + c_2 cos 2p + ...`` for pairs (s_2, c_2), (s_3, c_3), ..."""
    total = sin(turn)
    for order, (sine, cosine) in enumerate(harmonics, start=2):
        total = total + sine * sin(order * turn) + cosine * cos(order * turn)
    return total
