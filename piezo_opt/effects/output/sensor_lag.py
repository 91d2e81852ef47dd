"""The bandwidth of the sensor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.effects.lags import DAMPING, lagging, like_a_lag, with_second_pole
from piezo_opt.symbolic import stack


@final
@dataclass(frozen=True)
class SensorLag(Effect):
    """Lag of first (or second) order of the displacement sensor, entered through a share.

        tau z_1' = x - z_1
        tau z_1' = z_2,   tau z_2' = x - z_1 - 2 zeta z_2   two poles
        y = x + share (z_1 - x)

    The share is regular at 0 (no lag) and a pure lag at 1.

    References: Fleming (2013), Sensors and Actuators A 190, 106-126 (sensor bandwidth).
    """

    poles: int = 1
    place = Place.OUTPUT
    z = State("m", "lagged position, and tau times its rate", size="poles", trailing=True)
    share = Parameter(
        "1", "share of the reading that lags", nominal=0.0, bounds=(0.0, 1.0), typical=(0.2, 1.0),
        null=0.0,
    )  # fmt: skip
    tau = Parameter(
        "s", "time constant of the sensor", nominal=1e-3, bounds=(1e-7, 0.2), typical=(1e-5, 1e-2)
    )
    zeta = DAMPING

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """A short delay is a lag of that time constant; a lag elsewhere is as long here, and
        mechanics that do not ring are one."""
        return like_a_lag(self, other, own)

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """With the second pole."""
        return with_second_pole(self, own)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading and the lagged states."""
        seen = chain.incoming.value
        return Equations(
            gives=seen + p.share * (x.z[0] - seen),
            moves={"z": lagging(self, x.z, seen, p)},
            starts={"z": stack([seen, 0.0][: self.poles])},
        )
