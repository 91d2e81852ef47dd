"""The amplifier's largest rate: its current limit on a capacitive load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import tanh


@final
@dataclass(frozen=True)
class SlewLimit(Effect):
    """Largest rate of the drive, entered through a share.

        z' = rate tanh((u' + (u - z) / tau) / rate)
        v = u + share (z - u)

    A current limit I on a capacitance C allows rate = I / C. Below the limit z follows u without
    lag, because u' is fed forward; tau is the time in which it recovers after the limit.

    References: Fleming & Leang (2014), Design, Modeling and Control of Nanopositioning
    Systems, ch. 14 (electrical drive of capacitive loads).
    """

    place = Place.INPUT
    z = State("V", "drive of limited rate")
    share = Parameter(
        "1", "share of the drive that is limited", nominal=0.0, bounds=(0.0, 1.0),
        typical=(0.5, 1.0), null=0.0,
    )  # fmt: skip
    rate = Parameter(
        "V/s", "largest rate, I / C", nominal=1e4, bounds=(1e-6, 1e12), typical=(1e2, 1e6)
    )
    tau = Parameter(
        "s", "recovery time after the limit", nominal=1e-3, bounds=(1e-7, 0.1),
        typical=(1e-4, 1e-2),
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive and the rate-limited state."""
        u = chain.incoming
        wanted = u.rate + (u.value - x.z) / p.tau
        return Equations(
            gives=u.value + p.share * (x.z - u.value),
            moves={"z": p.rate * tanh(wanted / p.rate)},
            starts={"z": u.value},
        )
