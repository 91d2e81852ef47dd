"""The amplifier's largest rate: its current limit on a capacitive load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import softplus


@final
@dataclass(frozen=True)
class SlewLimit(Effect):
    """Largest rate of the drive, entered through a share.

        z' = e [softplus((w + fall rate) / e) - softplus((w - rate) / e)] - fall rate
        w = u' + (u - z) / tau,   v = u + share (z - u),   e = softness rate
        z' = e [softplus((w + fall rate) / e) - softplus((w - rate) / e)] - fall rate   behind
        w = (u - z) / tau,   v = u + share (z - u),   e = softness rate   behind

    A current limit I on a capacitance C allows rate = I / C: z' is w, held between -fall rate and
    rate by softly rounded corners; fall is 1 unless freed (an amplifier that sinks another current
    than it sources). Below the limit z follows u without lag, because u' is fed forward;
    tau is the time in which it recovers after the limit. Behind, tau is the lag of an amplifier's
    loop whose current is limited. softplus(a) = log(1 + exp(a)).

    References: Fleming & Leang (2014), Design, Modeling and Control of Nanopositioning
    Systems, ch. 14 (electrical drive of capacitive loads); Khalil (2002), Nonlinear Systems,
    3rd ed., sec. 1.2.7 (saturation).
    """

    behind: bool = False
    place = Place.INPUT
    variants = ({"behind": False}, {"behind": True})
    reshaped = ("behind",)
    z = State("V", "drive of limited rate", trailing=True)
    share = Parameter(
        "1", "share of the drive that is limited", nominal=0.0, bounds=(0.0, 1.0),
        typical=(0.5, 1.0), null=0.0,
    )  # fmt: skip
    rate = Parameter(
        "V/s", "largest rate, I / C", nominal=1e4, bounds=(1e-6, 1e12), typical=(1e2, 1e6)
    )
    tau = Parameter(
        "s", "recovery time after the limit, or lag below it", nominal=1e-3, bounds=(1e-7, 0.1),
        typical=(1e-4, 1e-2),
    )  # fmt: skip
    fall = Parameter(
        "1", "largest rate downwards over that upwards", nominal=1.0, bounds=(0.02, 50.0),
        typical=(0.3, 3.0), fixed=True, detail=True,
    )  # fmt: skip
    softness = Parameter(
        "1", "width of the corners over the rate", nominal=0.2, bounds=(1e-3, 1.0),
        typical=(0.02, 0.3), fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive and the rate-limited state."""
        u = chain.incoming
        wanted = (u.value - x.z) / p.tau
        wanted = wanted if self.behind else wanted + u.rate
        corner = p.softness * p.rate
        fall = p.fall * p.rate
        below = softplus((wanted + fall) / corner)
        above = softplus((wanted - p.rate) / corner)
        return Equations(
            gives=u.value + p.share * (x.z - u.value),
            moves={"z": corner * (below - above) - fall},
            starts={"z": u.value},
        )
