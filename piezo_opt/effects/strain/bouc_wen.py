"""Bouc-Wen hysteresis of the free displacement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, power_


@final
@dataclass(frozen=True)
class BoucWen(Effect):
    """Rate-independent hysteresis of the free displacement.

        h' = alpha v' - beta |v'| |h/h_s|^(n-1) h - gamma v' |h/h_s|^(n-1) |h|
        s += -h

    The exponent n pivots at the displacement h_s, so that beta and gamma keep the unit 1/V for
    every n; with n = 1 (the default, kept fixed) h_s drops out. With beta + gamma near 0, alpha
    and the linear gain d act alike: the fit reports it. alpha has the sign of the stroke (a loop
    lags behind its drive); an identification mirrors its bounds where position falls with drive,
    or where the loop leads, as that of s = d v + z with Wen's z does.

    References: Bouc (1967), Proc. 4th Conf. on Nonlinear Oscillation; Wen (1976), J. Eng. Mech.
    Div. 102(2), 249-263; Low & Guo (1995), J. Microelectromech. Syst. 4(4), 230-237 (piezo form).
    """

    place = Place.STRAIN
    structural = True
    h = State("m", "hysteretic displacement", loop=True, remanent=True)
    alpha = Parameter(
        "m/V", "strength of the loop", nominal=3e-8, bounds=(0.0, 1e-3), typical=(5e-9, 1e-7)
    )
    beta = Parameter(
        "1/V", "width of the loop", nominal=2e-2, bounds=(0.0, 1e3), typical=(2e-3, 2e-1)
    )
    gamma = Parameter(
        "1/V", "roundness of the loop", nominal=0.0, bounds=(-1e3, 1e3), typical=(-2e-2, 2e-2)
    )
    n = Parameter(
        "1", "exponent", nominal=1.0, bounds=(1.0, 4.0), typical=(1.0, 2.0), fixed=True, detail=True
    )
    h_s = Parameter(
        "m", "displacement at which the exponent makes no difference", nominal=1e-6,
        bounds=(1e-12, 1.0), fixed=True,
    )  # fmt: skip

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """The normalised form written with the classical parameters.

            alpha = rho kappa,   beta = rho sigma s,   gamma = rho (1 - sigma) s
            s = (h_s / kappa)^(n-1)

        The loop is the same for every exponent.
        """
        if other != "generalised_bouc_wen":
            return None
        rho, kappa, n = own["rho"], own["kappa"], own["n"]
        turned = rho * (self.parameters["h_s"].nominal / kappa) ** (n - 1.0)
        return {
            "alpha": rho * kappa, "beta": turned * own["sigma"],
            "gamma": turned * (1.0 - own["sigma"]), "n": n,
        }  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The loop's rate, and its contribution to the free displacement."""
        rate, size = chain.drive.rate, abs_(x.h)
        shape = power_(size / p.h_s, p.n - 1.0)
        loop = p.alpha * rate - shape * (p.beta * abs_(rate) * x.h + p.gamma * rate * size)
        return Equations(gives=-x.h, moves={"h": loop})
