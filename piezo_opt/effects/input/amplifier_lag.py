"""The amplifier charging the actuator's capacitance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State


@final
@dataclass(frozen=True)
class AmplifierLag(Effect):
    """First-order lag of amplifier and actuator capacitance, entered through a share.

        tau z' = u - z
        v = u + share (z - u)

    The share is regular at 0 (no lag) and a pure lag at 1; tau = R C.

    References: Fleming & Leang (2014), Design, Modeling and Control of Nanopositioning
    Systems, ch. 14 (electrical drive of capacitive loads).
    """

    place = Place.INPUT
    z = State("V", "lagged drive")
    share = Parameter(
        "1", "share of the drive that lags", nominal=0.0, bounds=(0.0, 1.0), typical=(0.2, 1.0),
        null=0.0,
    )  # fmt: skip
    tau = Parameter(
        "s", "time constant R C", nominal=1e-3, bounds=(1e-7, 0.1), typical=(1e-4, 1e-2)
    )

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive and the lagged state."""
        u = chain.incoming.value
        return Equations(
            gives=u + p.share * (x.z - u), moves={"z": (u - x.z) / p.tau}, starts={"z": u}
        )
