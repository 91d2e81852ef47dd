"""Damping that grows with speed or with deflection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.symbolic import abs_


@final
@dataclass(frozen=True)
class NonlinearDamping(Effect):
    """Damping beyond a constant ratio, per unit mass: of a fluid, or of a guide off its centre.

        x'' += -b |x'| x'
        x'' += -c x^2 x'   deflection

    x is the position [m], x' its velocity [m/s]. The first form is the drag of a fluid that is
    pushed aside [b in 1/m]; the second is that of a film that narrows, or of a guide that
    stretches as it deflects [c in 1/m^2/s]. Both only take energy (b, c >= 0). Beside them
    second_order's zeta is the damping of small motions: over a sine of amplitude A and angular
    frequency w the first takes as much as zeta + 4 b A w / (3 pi omega) would, the second as much
    as zeta + c A^2 / (8 omega).

    References: Nayfeh & Mook (1979), Nonlinear Oscillations, Wiley, sec. 3.3 (quadratic damping,
    and that of van der Pol); Elliott, Ghandchi Tehrani & Langley (2015), Philosophical
    Transactions of the Royal Society A 373, 20140402.
    """

    deflection: bool = False
    place = Place.MOTION
    requires = ("motion",)
    variants = ({"deflection": False}, {"deflection": True})
    b = Parameter(
        "1/m", "damping over speed, per unit mass", nominal=0.0, bounds=(0.0, 1e12),
        typical=(1e2, 1e6), null=0.0, unless="deflection",
    )  # fmt: skip
    c = Parameter(
        "1/m^2/s", "damping over squared deflection, per unit mass", nominal=0.0,
        bounds=(0.0, 1e20), typical=(1e9, 1e13), null=0.0, when="deflection",
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the acceleration."""
        speed = chain.position.rate
        if self.deflection:
            return Equations(gives=-p.c * chain.position.value**2 * speed)
        return Equations(gives=-p.b * abs_(speed) * speed)
