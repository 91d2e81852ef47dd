"""Creep: the slow tail after every step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import stack, sum_


@final
@dataclass(frozen=True)
class Creep(Effect):
    """Slow strain that follows the free displacement through a Kelvin-Voigt chain.

        tau_i z_i' = s - z_i,   tau_i = tau 10^(i-1),   i = 1..k
        s += c / k (z_1 + ... + z_k)

    One element a decade with equal weights 1/k approximates logarithmic creep,
    L(t) = L0 (1 + g lg(t / 0.1 s)). The weight stands at the sum and not at the elements' input,
    so that creep vanishes with c even where a record begins with elements away from rest.

    References: Croft, Shed & Devasia (2001), J. Dyn. Sys. Meas. Control 123(1), 35-43.
    """

    elements: int = 3
    place = Place.STRAIN
    variants = ({"elements": 3}, {"elements": 1})
    z = State("m", "displacement of each element", size="elements", remanent=True)
    c = Parameter(
        "1", "share of the stroke that creeps", nominal=0.0, bounds=(-0.2, 0.9),
        typical=(5e-3, 0.1), null=0.0,
    )  # fmt: skip
    tau = Parameter(
        "s", "shortest time constant", nominal=0.1, bounds=(1e-4, 1e4), typical=(3e-2, 10.0)
    )

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement; each element relaxes towards it."""
        rates = [(chain.free.value - x.z[i]) / (p.tau * 10.0**i) for i in range(self.elements)]
        return Equations(gives=p.c / self.elements * sum_(x.z), moves={"z": stack(rates)})
