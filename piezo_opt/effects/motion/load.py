"""What the actuator pushes against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class Load(Effect):
    """Spring load, per unit mass of the unloaded actuator, one per record.

        x'' += -k x,   k = k_L / m

    The load's mass is an effect of its own, load_mass. A load that never changes only renames
    omega and the gain, omega^2 -> omega^2 + k and d -> d omega^2 / (omega^2 + k): it shows where
    records with different loads are fitted together, one of them (the unloaded one) fixed at 0.

    References: Preumont (2011), Vibration Control of Active Structures, 3rd ed., ch. 4
    (piezoelectric stack against a spring).
    """

    place = Place.MOTION
    requires = ("motion",)
    k = Parameter(
        "1/s^2", "stiffness of the load per unit mass", nominal=0.0, bounds=(0.0, 1e14),
        typical=(1e3, 1e8), null=0.0, per_record=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the acceleration."""
        return Equations(gives=-p.k * chain.position.value)
