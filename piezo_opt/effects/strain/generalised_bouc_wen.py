"""Bouc-Wen hysteresis in its normalised form: every parameter can be told from the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, power_


@final
@dataclass(frozen=True)
class GeneralisedBoucWen(Effect):
    """Normalised Bouc-Wen hysteresis with a free exponent, in the place of bouc_wen.

        h' = rho kappa (v' - sigma |v'| |z|^(n-1) z + (sigma - 1) v' |z|^n),   z = h / kappa
        s += -h

    h saturates at kappa. Scaling by the saturation removes the redundancy of the classical
    parameters: alpha = rho kappa, beta = rho sigma, gamma = rho (1 - sigma) for n = 1.

    References: Ismail, Ikhouane & Rodellar (2009), Arch. Comput. Methods Eng. 16, 161-188.
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
    sigma = Parameter(
        "1", "width against roundness", nominal=1.0, bounds=(0.5, 1e2), typical=(0.5, 2.0)
    )
    n = Parameter("1", "exponent", nominal=1.5, bounds=(1.0, 4.0), typical=(1.0, 3.0))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The loop's rate, and its contribution to the free displacement."""
        rate, z = chain.drive.rate, x.h / p.kappa
        shape = power_(abs_(z), p.n - 1.0)
        bent = shape * (p.sigma * abs_(rate) * z - (p.sigma - 1.0) * rate * abs_(z))
        return Equations(gives=-x.h, moves={"h": p.rho * p.kappa * (rate - bent)})
