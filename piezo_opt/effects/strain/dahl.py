"""Dahl's hysteresis of the drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, power_, sign_


@final
@dataclass(frozen=True)
class Dahl(Effect):
    """Dahl's law between drive and hysteretic displacement, in the place of bouc_wen.

        h' = rho kappa v' |e|^i sign(e),   e = 1 - (h/kappa) sign(v')
        s += -h

    h saturates at kappa. The exponent i sharpens the approach; i = 1 is Bouc-Wen without its
    gamma.

    References: Dahl (1976), AIAA Journal 14(12), 1675-1682.
    """

    place = Place.STRAIN
    structural = True
    h = State("m", "hysteretic displacement", loop=True, remanent=True)
    kappa = Parameter(
        "m", "displacement at which the loop saturates", nominal=1e-6, bounds=(1e-12, 1.0),
        typical=(1e-7, 1e-5),
    )  # fmt: skip
    rho = Parameter(
        "1/V", "how soon the loop saturates", nominal=2e-2, bounds=(0.0, 1e3), typical=(2e-3, 2e-1)
    )
    i = Parameter("1", "exponent", nominal=1.5, bounds=(1.0, 4.0), typical=(1.0, 3.0))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The loop's rate, and its contribution to the free displacement."""
        rate = chain.drive.rate
        left = 1.0 - x.h / p.kappa * sign_(rate)
        slope = power_(abs_(left), p.i) * sign_(left)
        return Equations(gives=-x.h, moves={"h": p.rho * p.kappa * rate * slope})
