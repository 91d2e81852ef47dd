"""A drive that does nothing near zero, or a reading that does nothing at a turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import play, softplus


@final
@dataclass(frozen=True)
class DeadZone(Effect):
    """Loss of slope around zero drive; or backlash, its form with a memory, behind the position.

        v = u + share (e [softplus((u - width) / e) - softplus((-u - width) / e)] - u)
        e = softness width
        y = z,   z = min(max(z_before, x - w), x + w)   backlash

    At share = 1 the drive has no effect for |u| < width and is short by width beyond it.
    softplus(a) = log(1 + exp(a)). Backlash is a play of half width w between the position and the
    reading, exact while the position moves one way: z_before is the reading where it last turned.
    At w = 0 the reading is the position.

    References: Tao & Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor
    Nonlinearities, Wiley (dead-zone, backlash); Khalil (2002), Nonlinear Systems, sec. 1.2.7.
    """

    backlash: bool = False
    variants = ({"backlash": False}, {"backlash": True})
    z = State("m", "reading at the last turn", remanent=True, when="backlash")
    share = Parameter(
        "1", "slope lost around zero", nominal=0.0, bounds=(0.0, 1.0), typical=(0.1, 1.0),
        null=0.0, unless="backlash",
    )  # fmt: skip
    width = Parameter(
        "V", "half width of the zone", nominal=1.0, bounds=(1e-6, 1e5), typical=(1e-2, 10.0),
        unless="backlash",
    )  # fmt: skip
    softness = Parameter(
        "1", "rounding of the corners over the width", nominal=0.1, bounds=(1e-3, 1.0),
        typical=(0.02, 0.3), fixed=True, detail=True, unless="backlash",
    )  # fmt: skip
    w = Parameter(
        "m", "half of the lost motion", nominal=0.0, bounds=(0.0, 1e-2), typical=(1e-9, 1e-6),
        null=0.0, when="backlash",
    )  # fmt: skip

    @property
    def place(self) -> Place:
        """The input line; of backlash the output line."""
        return Place.OUTPUT if self.backlash else Place.INPUT

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive, or the outgoing reading, remembered at the end of every stretch."""
        u = chain.incoming.value
        if self.backlash:
            carried = play(x.z, u, p.w)
            return Equations(gives=carried, becomes={"z": carried}, starts={"z": u})
        corner = p.softness * p.width
        above = softplus((u - p.width) / corner)
        below = softplus((-u - p.width) / corner)
        return Equations(gives=u + p.share * (corner * (above - below) - u))
