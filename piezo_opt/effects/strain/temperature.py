"""A stroke that changes with temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class Temperature(Effect):
    """Change of the linear gain, or expansion, for records with a temperature channel.

        s += a (T - T0) [(1 + bend (T - T0)) v + shift]
        s += b (T - T0) (1 + slope v)   expanding

    The relative change of the gain per kelvin is a / d. Expanding is the expansion of actuator and
    frame, the difference of the two over the measured length. Each has the other beside it in
    detail: the expansion of the first is a shift, the change of gain of the second b slope; shift,
    slope and bend are kept at 0 unless freed.

    References: "Quasi-static thermo-electro-mechanical behaviour of piezoelectric stack
    actuators" (2008): measured from -30 to 125 degC, the stroke grows steadily with temperature;
    Nye (1985), Physical Properties of Crystals, Oxford (thermal expansion).
    """

    expanding: bool = False
    place = Place.STRAIN
    requires = ("channel:temperature",)
    variants = ({"expanding": False}, {"expanding": True})
    a = Parameter(
        "m/V/K", "change of the gain per kelvin", nominal=0.0, bounds=(-1e-4, 1e-4),
        typical=(-1e-9, 1e-9), null=0.0, unless="expanding",
    )  # fmt: skip
    b = Parameter(
        "m/K", "expansion per kelvin", nominal=0.0, bounds=(-1e-2, 1e-2), typical=(-1e-6, 1e-6),
        null=0.0, when="expanding",
    )  # fmt: skip
    T0 = Parameter(
        "K", "temperature at which d holds and nothing has expanded", nominal=293.15,
        bounds=(1.0, 1e3), typical=(283.0, 303.0), fixed=True,
    )  # fmt: skip
    bend = Parameter(
        "1/K", "growth of the change of the gain", nominal=0.0, bounds=(-1.0, 1.0),
        typical=(-0.05, 0.05), fixed=True, detail=True, unless="expanding",
    )  # fmt: skip
    shift = Parameter(
        "V", "expansion over the change of the gain", nominal=0.0, bounds=(-1e6, 1e6),
        typical=(-1e2, 1e2), fixed=True, detail=True, unless="expanding",
    )  # fmt: skip
    slope = Parameter(
        "1/V", "change of the gain over the expansion", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1e-2, 1e-2), fixed=True, detail=True, when="expanding",
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement."""
        warmer, v = chain.channels["temperature"].value - p.T0, chain.drive.value
        if self.expanding:
            return Equations(gives=p.b * warmer * (1.0 + p.slope * v))
        return Equations(gives=p.a * warmer * ((1.0 + p.bend * warmer) * v + p.shift))
