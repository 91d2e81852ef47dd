"""Lost motion between the actuator and what is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import play


@final
@dataclass(frozen=True)
class Backlash(Effect):
    """Play of half width w between the position and the reading.

        y = z,   z = min(max(z_before, x - w), x + w)

    Exact while the position moves one way: z_before is the reading where it last turned. At
    w = 0 the reading is the position.

    References: Tao & Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor
    Nonlinearities, Wiley (backlash).
    """

    place = Place.OUTPUT
    z = State("m", "reading at the last turn", remanent=True)
    w = Parameter(
        "m", "half of the lost motion", nominal=0.0, bounds=(0.0, 1e-2), typical=(1e-9, 1e-6),
        null=0.0,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading, remembered at the end of every stretch."""
        carried = play(x.z, chain.incoming.value, p.w)
        return Equations(gives=carried, becomes={"z": carried}, starts={"z": chain.incoming.value})
