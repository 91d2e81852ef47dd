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
    """Drift of the zero from the start of the record: straight, levelling out, or wandering.

        y = x + rate tau (1 - exp(-t / tau))
        y = x + rate (t + bend t^2 + twist t^3)   wandering

    With tau at its default of 1e9 s, where it is kept unless freed, the first is x + rate t; with
    the option settling it is a warm-up that runs out within the record or a few of its lengths. The
    second is the smooth wander of a room's temperature, as far as a cubic follows it.

    References: Fleming (2013), Sensors and Actuators A 190, 106-126 (drift and stability).
    """

    wandering: bool = False
    settling: bool = False
    place = Place.OUTPUT
    variants = ({"wandering": False}, {"wandering": True}, {"settling": True})
    rate = Parameter(
        "m/s", "drift at the start of the record", nominal=0.0, bounds=(-1.0, 1.0),
        typical=(-1e-7, 1e-7), null=0.0, per_record=True,
    )  # fmt: skip
    tau = Parameter(
        "s", "warm-up time", nominal=1e9, bounds=(1e-3, 1e9), typical=(60.0, 3600.0), fixed=True,
        detail=True, unless="wandering", freed="settling",
    )  # fmt: skip
    bend = Parameter(
        "1/s", "growth of the rate", nominal=0.0, bounds=(-1e9, 1e9), typical=(-1.0, 1.0),
        per_record=True, when="wandering",
    )  # fmt: skip
    twist = Parameter(
        "1/s^2", "growth of the growth", nominal=0.0, bounds=(-1e9, 1e9), typical=(-1.0, 1.0),
        per_record=True, when="wandering",
    )  # fmt: skip

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """Slow creep that was under way at the start runs out like a warm-up."""
        alike = other == "creep" and not self.wandering
        return {"rate": 0.0, "tau": own["tau"]} if alike else None

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading."""
        t = chain.time
        if self.wandering:
            grown = t * (1.0 + t * (p.bend + t * p.twist))
        else:
            grown = -p.tau * expm1(-t / p.tau)
        return Equations(gives=chain.incoming.value + p.rate * grown)
