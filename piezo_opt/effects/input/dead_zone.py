"""A drive that does nothing near zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.symbolic import softplus


@final
@dataclass(frozen=True)
class DeadZone(Effect):
    """Loss of slope around zero drive.

        v = u + share (e [softplus((u - width) / e) - softplus((-u - width) / e)] - u)
        e = softness width

    At share = 1 the drive has no effect for |u| < width and is short by width beyond it.
    softplus(a) = log(1 + exp(a)).

    References: Tao & Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor
    Nonlinearities, Wiley (dead-zone); Khalil (2002), Nonlinear Systems, sec. 1.2.7.
    """

    place = Place.INPUT
    share = Parameter(
        "1", "slope lost around zero", nominal=0.0, bounds=(0.0, 1.0), typical=(0.1, 1.0), null=0.0
    )
    width = Parameter(
        "V", "half width of the zone", nominal=1.0, bounds=(1e-6, 1e5), typical=(1e-2, 10.0)
    )
    softness = Parameter(
        "1", "rounding of the corners over the width", nominal=0.1, bounds=(1e-3, 1.0),
        typical=(0.02, 0.3), fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive."""
        u, corner = chain.incoming.value, p.softness * p.width
        above = softplus((u - p.width) / corner)
        below = softplus((-u - p.width) / corner)
        return Equations(gives=u + p.share * (corner * (above - below) - u))
