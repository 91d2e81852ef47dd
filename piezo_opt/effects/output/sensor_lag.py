"""The bandwidth of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State


@final
@dataclass(frozen=True)
class SensorLag(Effect):
    """First-order lag of the displacement sensor, entered through a share.

        tau z' = x - z
        y = x + share (z - x)

    The share is regular at 0 (no lag) and a pure lag at 1.

    References: Fleming (2013), Sensors and Actuators A 190, 106-126 (sensor bandwidth).
    """

    place = Place.OUTPUT
    z = State("m", "lagged position")
    share = Parameter(
        "1", "share of the reading that lags", nominal=0.0, bounds=(0.0, 1.0), typical=(0.2, 1.0),
        null=0.0,
    )  # fmt: skip
    tau = Parameter(
        "s", "time constant of the sensor", nominal=1e-3, bounds=(1e-7, 0.2), typical=(1e-5, 1e-2)
    )

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading and the lagged state."""
        seen = chain.incoming.value
        return Equations(
            gives=seen + p.share * (x.z - seen),
            moves={"z": (seen - x.z) / p.tau},
            starts={"z": seen},
        )
