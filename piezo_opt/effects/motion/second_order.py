"""The mechanics: one resonance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State


@final
@dataclass(frozen=True)
class SecondOrder(Effect):
    """Mass, spring and damper behind the free displacement, per unit mass.

        x'' += omega^2 (s - x) - 2 zeta omega x'

    Displacement data alone cannot reveal a mass, so the balance is written in m/s^2.

    References: Preumont (2011), Vibration Control of Active Structures, 3rd ed., ch. 3-4.
    """

    place = Place.MOTION
    structural = True
    x = State("m", "position", position=True, remanent=True)
    w = State("m/s", "velocity", velocity=True, remanent=True)
    omega = Parameter(
        "rad/s", "natural frequency", nominal=6e3, bounds=(1e-2, 1e7), typical=(3e2, 1e5)
    )
    zeta = Parameter("1", "damping ratio", nominal=0.05, bounds=(1e-4, 5.0), typical=(5e-3, 0.5))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the acceleration; the balance as a whole moves the velocity."""
        spring = p.omega * p.omega * (chain.free.value - x.x)
        return Equations(
            gives=spring - 2.0 * p.zeta * p.omega * x.w,
            moves={"x": x.w, "w": chain.acceleration},
            starts={"x": chain.free.value},
        )
