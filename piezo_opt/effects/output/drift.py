"""A zero that wanders while the record runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.symbolic import expm1


@final
@dataclass(frozen=True)
class Drift(Effect):
    """Drift of the zero from the start of the record, straight or levelling out (warm-up).

        y = x + rate tau (1 - exp(-t / tau))

    With tau at its default of 1e9 s, where it is kept unless freed, this is x + rate t.

    References: Fleming (2013), Sensors and Actuators A 190, 106-126 (drift and stability).
    """

    place = Place.OUTPUT
    rate = Parameter(
        "m/s", "drift at the start of the record", nominal=0.0, bounds=(-1.0, 1.0),
        typical=(-1e-7, 1e-7), null=0.0, per_record=True,
    )  # fmt: skip
    tau = Parameter(
        "s", "warm-up time", nominal=1e9, bounds=(1e-3, 1e9), typical=(60.0, 3600.0), fixed=True,
        detail=True,
    )  # fmt: skip

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """Slow creep that was under way at the start runs out like a warm-up."""
        return {"rate": 0.0, "tau": own["tau"]} if other == "creep" else None

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading."""
        grown = -p.tau * expm1(-chain.time / p.tau)
        return Equations(gives=chain.incoming.value + p.rate * grown)
