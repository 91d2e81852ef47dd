"""Dry friction of a guide."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, exp, power_, sign_, tanh

_SLIDING = 1e-6
"""Way left into sliding that is none: below an exponent of 1 its power has no derivative at 0."""


@final
@dataclass(frozen=True)
class Friction(Effect):
    """Dry friction with presliding (Dahl; LuGre when stribeck or tau are freed), per unit mass.

        z0 z' = x' |r|^(n-1) r,   r = 1 - sign(x') z / g(x')
        g = 1 + (stribeck - 1) exp(-(x'/w_s)^2)
        x'' += -F (z + tau z')
        x'' += -F tanh(x' / w_c)   smooth

    z runs within -g..g, so that F is the Coulomb force per unit mass and F / z0 the stiffness
    before sliding; n is how soon it gives way. stribeck is static over sliding friction, tau the
    micro-damping; with their defaults 1 and 0 the law is Dahl's. In the power |r| has 1e-6 added:
    there are derivatives then where the contact slides. The smooth form, Coulomb's as most
    simulations have it, has no presliding: below w_c it is viscous. Viscous damping is
    second_order's.

    References: Dahl (1976), AIAA Journal 14(12), 1675-1682; Canudas de Wit, Olsson, Astrom &
    Lischinsky (1995), IEEE Trans. Automatic Control 40(3), 419-425; Andersson, Soderberg &
    Bjorklund (2007), Tribology International 40(4), 580-587 (the smooth form).
    """

    smooth: bool = False
    place = Place.MOTION
    requires = ("motion",)
    variants = ({"smooth": False}, {"smooth": True})
    z = State("1", "deflection of the contact over its largest", remanent=True, unless="smooth")
    F = Parameter(
        "m/s^2", "Coulomb friction per unit mass", nominal=0.0, bounds=(0.0, 1e8),
        typical=(1e-3, 10.0), null=0.0,
    )  # fmt: skip
    z0 = Parameter(
        "m", "presliding displacement", nominal=1e-6, bounds=(1e-10, 1.0), typical=(1e-7, 1e-5),
        unless="smooth",
    )  # fmt: skip
    w_c = Parameter(
        "m/s", "velocity below which friction is viscous", nominal=1e-4, bounds=(1e-10, 1e3),
        typical=(1e-5, 1e-2), when="smooth",
    )  # fmt: skip
    n = Parameter(
        "1", "exponent of the way into sliding", nominal=1.0, bounds=(0.5, 4.0), typical=(0.5, 2.0),
        fixed=True, detail=True, unless="smooth",
    )  # fmt: skip
    stribeck = Parameter(
        "1", "static over sliding friction", nominal=1.0, bounds=(1.0, 5.0), typical=(1.0, 2.0),
        fixed=True, detail=True, unless="smooth",
    )  # fmt: skip
    w_s = Parameter(
        "m/s", "Stribeck velocity", nominal=1e-3, bounds=(1e-9, 1e3), typical=(1e-5, 1e-1),
        fixed=True, detail=True, unless="smooth",
    )  # fmt: skip
    tau = Parameter(
        "s", "micro-damping time", nominal=0.0, bounds=(0.0, 1.0), typical=(0.0, 1e-4), fixed=True,
        detail=True, unless="smooth",
    )  # fmt: skip

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """A hysteretic force whose loop opens and closes at the same stiffnesses.

            z0 = z_s (beta (gamma + delta) z_s)^(-1/n'),   F = alpha z0,
            n = log2(2 gamma / (gamma + delta))

        with n' the force's own exponent: force, slope and where it slides are the same at a
        reversal, at zero and at the end; everywhere with delta = 0 and n' = 1.
        """
        if self.smooth or other != "hysteretic_force":
            return None
        width, opening = own["gamma"] + own["delta"], 2.0 * own["gamma"]
        if own["beta"] * width <= 0.0 or opening * width <= 0.0:
            return None
        z_s = own["z_s"]
        z0 = z_s * (own["beta"] * width * z_s) ** (-1.0 / own["n"])
        low, high = self.parameters["n"].bounds
        return {
            "F": own["alpha"] * z0, "z0": z0,
            "n": min(max(math.log2(opening / width), low), high),
        }  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the acceleration and the contact's deflection."""
        w = chain.position.rate
        if self.smooth:
            return Equations(gives=-p.F * tanh(w / p.w_c))
        level = 1.0 + (p.stribeck - 1.0) * exp(-((w / p.w_s) ** 2))
        left = power_(abs_(1.0 - sign_(w) * x.z / level) + _SLIDING, p.n - 1.0)
        rate = left * (w - abs_(w) * x.z / level) / p.z0
        return Equations(gives=-p.F * (x.z + p.tau * rate), moves={"z": rate})
