"""A loop whose two branches differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.symbolic import abs_


@final
@dataclass(frozen=True)
class Asymmetry(Effect):
    """Non-symmetrical hysteresis: the loop's rate depends on the sign of the drive.

        h' += delta v (1 + bend v^2) |v'|

    bend is kept at 0 unless freed. |v'| in place of sign(v') keeps the loop independent of the rate
    at which it is run through.

    References: after Zhu & Wang (2012), Sensors and Actuators A 181, 51-60 (non-symmetrical
    Bouc-Wen model for piezoelectric ceramic actuators).
    """

    place = Place.LOOP
    requires = ("loop",)
    delta = Parameter(
        "m/V^2", "strength of the asymmetry", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-10, 1e-10), null=0.0,
    )  # fmt: skip
    bend = Parameter(
        "1/V^2", "cubic over linear growth with the drive", nominal=0.0, bounds=(-1e6, 1e6),
        typical=(-1e-4, 1e-4), fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the loop's rate."""
        v = chain.drive.value
        return Equations(gives=p.delta * v * (1.0 + p.bend * v * v) * abs_(chain.drive.rate))
