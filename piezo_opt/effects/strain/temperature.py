"""A gain that changes with temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class Temperature(Effect):
    """Change of the linear gain with temperature, for records with a temperature channel.

        s += a (T - T0) (1 + bend (T - T0)) v

    The relative change per kelvin is a / d; bend is kept at 0 unless freed. Thermal expansion is
    an effect of its own.

    References: "Quasi-static thermo-electro-mechanical behaviour of piezoelectric stack
    actuators" (2008): measured from -30 to 125 degC, the stroke grows steadily with temperature.
    """

    place = Place.STRAIN
    requires = ("channel:temperature",)
    a = Parameter(
        "m/V/K", "change of the gain per kelvin", nominal=0.0, bounds=(-1e-4, 1e-4),
        typical=(-1e-9, 1e-9), null=0.0,
    )  # fmt: skip
    T0 = Parameter(
        "K", "temperature at which d holds", nominal=293.15, bounds=(1.0, 1e3),
        typical=(283.0, 303.0), fixed=True,
    )  # fmt: skip
    bend = Parameter(
        "1/K", "growth of that change", nominal=0.0, bounds=(-1.0, 1.0), typical=(-0.05, 0.05),
        fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement."""
        warmer = chain.channels["temperature"].value - p.T0
        change = p.a * warmer * (1.0 + p.bend * warmer)
        return Equations(gives=change * chain.drive.value)
