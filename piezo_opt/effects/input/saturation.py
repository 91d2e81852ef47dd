"""The end of the amplifier's range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.symbolic import softplus


@final
@dataclass(frozen=True)
class Saturation(Effect):
    """Loss of slope beyond a knee on both sides of the centre of the range.

        v = u - s e [softplus((u - c - v_s) / e) - softplus((c - u - v_s) / e)],   e = softness v_s

    s = 0 leaves the drive alone, s = 1 holds it at c - v_s and c + v_s; softness rounds the
    knee. softplus(a) = log(1 + exp(a)).

    References: Khalil (2002), Nonlinear Systems, 3rd ed., sec. 1.2.7 (saturation).
    """

    place = Place.INPUT
    s = Parameter(
        "1", "slope lost beyond the knee", nominal=0.0, bounds=(0.0, 1.0), typical=(0.1, 1.0),
        null=0.0,
    )  # fmt: skip
    v_s = Parameter(
        "V", "knee: distance from the centre", nominal=50.0, bounds=(1e-6, 1e6),
        typical=(1.0, 150.0),
    )  # fmt: skip
    c = Parameter(
        "V", "centre of the range", nominal=0.0, bounds=(-1e6, 1e6), typical=(0.0, 75.0),
        fixed=True, detail=True,
    )  # fmt: skip
    softness = Parameter(
        "1", "width of the knee over its distance", nominal=0.05, bounds=(1e-3, 1.0),
        typical=(0.02, 0.2), fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive."""
        u, width = chain.incoming.value, p.softness * p.v_s
        above = softplus((u - p.c - p.v_s) / width)
        below = softplus((p.c - u - p.v_s) / width)
        return Equations(gives=u - p.s * width * (above - below))
