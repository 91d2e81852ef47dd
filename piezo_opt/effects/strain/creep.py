"""Creep: the slow tail after every step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import exp, stack

_DENSE = 7
"""Elements of a chain that covers three decades at two elements a decade."""


@final
@dataclass(frozen=True)
class Creep(Effect):
    """Slow strain that follows the free displacement through a Kelvin-Voigt chain.

        tau_i z_i' = s - z_i,   tau_i = tau 10^(spread (i-1)/m),   i = 1..k
        s += c (w_1 z_1 + ... + w_k z_k),   w_i = 10^(power i/m) / sum_j 10^(power j/m)

    One element a decade (m = per_decade = 1) with equal weights approximates logarithmic creep,
    L(t) = L0 (1 + g lg(t / 0.1 s)); power, kept at 0 unless freed, is the exponent of fractional
    creep, t^power; spread, kept at 1 unless freed, brings the elements closer together or further
    apart. Two a decade leave no ripple that a record could show. The weight stands at the
    sum and not at the elements' input, so that creep vanishes with c even where a record begins
    with elements away from rest.

    References: Croft, Shed & Devasia (2001), J. Dyn. Sys. Meas. Control 123(1), 35-43.
    """

    elements: int = 3
    per_decade: int = 1
    place = Place.STRAIN
    variants = ({"elements": 3}, {"elements": 1})
    z = State("m", "displacement of each element", size="elements", remanent=True, relaxing=True)
    c = Parameter(
        "1", "share of the stroke that creeps", nominal=0.0, bounds=(-0.2, 0.9),
        typical=(5e-3, 0.1), null=0.0,
    )  # fmt: skip
    tau = Parameter(
        "s", "shortest time constant", nominal=0.1, bounds=(1e-4, 1e4), typical=(3e-2, 10.0)
    )

    power = Parameter(
        "1", "growth of the weights per decade", nominal=0.0, bounds=(-1.0, 1.0),
        typical=(-0.3, 0.3), fixed=True, detail=True,
    )  # fmt: skip

    spread = Parameter(
        "1", "spacing of the time constants, over the usual one", nominal=1.0,
        bounds=(0.1, 3.0), typical=(0.3, 1.7), fixed=True, detail=True,
    )  # fmt: skip

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """Two elements a decade over the same decades and half a one on either side."""
        if self.per_decade > 1:
            return self, {}
        start = {"tau": own["tau"] / 10.0**0.5} if self.elements < _DENSE else {}
        return replace(self, elements=max(_DENSE, self.elements), per_decade=2), start

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement; each element relaxes towards it."""
        decades = [i / self.per_decade for i in range(self.elements)]
        rates = [
            (chain.free.value - x.z[i]) / (p.tau * exp(p.spread * (decade * log(10.0))))
            for i, decade in enumerate(decades)
        ]
        weights = [exp(p.power * (decade * log(10.0))) for decade in decades]
        sum_of = sum(w * x.z[i] for i, w in enumerate(weights)) / sum(weights)
        return Equations(gives=p.c * sum_of, moves={"z": stack(rates)})
