"""What the actuator carries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class LoadMass(Effect):
    """Mass load, over the moving mass of the actuator, one per record.

        x'' += -ratio x'',   ratio = M / m

    The other terms stay per unit mass m of the unloaded actuator. With load's spring k the
    resonance moves to omega_L^2 = (omega^2 + k) / (1 + ratio), the static gain to
    d omega^2 / (omega^2 + k) and the damping to zeta_L omega_L = zeta omega / (1 + ratio). A mass
    that never changes only renames what the others give: it shows where records with different
    masses are fitted together, one of them (the unloaded one) fixed at 0. A search for missing
    effects tries it only where it is offered as a candidate.

    References: Preumont (2011), Vibration Control of Active Structures, 3rd ed., ch. 3
    (transducer that carries a mass); Physik Instrumente, Piezo Tutorial, eq. 4-11 (resonant
    frequency with an additional mass, f sqrt(m / (m + M))).
    """

    place = Place.MOTION
    # One record hides it behind omega and zeta; in a search it would only crowd others out.
    variants = ()
    requires = ("motion",)
    ratio = Parameter(
        "1", "mass of the load over the moving mass", nominal=0.0, bounds=(0.0, 1e4),
        typical=(0.05, 2.0), null=0.0, per_record=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """No force of its own: the mass is accelerated by what the others add."""
        return Equations(gives=0.0, inertia=p.ratio)
