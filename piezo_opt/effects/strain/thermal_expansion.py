"""The actuator as a thermometer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class ThermalExpansion(Effect):
    """Expansion of actuator and frame, for records with a temperature channel.

        s += b (T - T0)

    b is the difference of the expansions of stack and frame over the measured length.

    References: Nye (1985), Physical Properties of Crystals, Oxford (thermal expansion).
    """

    place = Place.STRAIN
    requires = ("channel:temperature",)
    b = Parameter(
        "m/K", "expansion per kelvin", nominal=0.0, bounds=(-1e-2, 1e-2), typical=(-1e-6, 1e-6),
        null=0.0,
    )  # fmt: skip
    T0 = Parameter(
        "K", "temperature of zero expansion", nominal=293.15, bounds=(1.0, 1e3),
        typical=(283.0, 303.0), fixed=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement."""
        return Equations(gives=p.b * (chain.channels["temperature"].value - p.T0))
