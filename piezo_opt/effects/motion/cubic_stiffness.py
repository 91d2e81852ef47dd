"""A guide that stiffens (or softens) with its deflection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class CubicStiffness(Effect):
    """Cubic spring about the guide's unstrained position, per unit mass (Duffing).

        x'' += -k3 [f(x - x0) - f(-x0)],   f(e) = e^3 (1 + fifth e^2)

    x0 is where the guide is unstrained, fifth the next term of its stiffening; both are 0 unless
    freed. Off centre the cube brings its even partner, k2 = -3 k3 x0, and the whole vanishes with
    k3. k3 < 0 softens.

    References: Kovacic & Brennan (eds., 2011), The Duffing Equation: Nonlinear Oscillators and
    their Behaviour, Wiley.
    """

    place = Place.MOTION
    requires = ("motion",)
    k3 = Parameter(
        "1/m^2/s^2", "cubic stiffness per unit mass", nominal=0.0, bounds=(-1e22, 1e24),
        typical=(-1e15, 1e16), null=0.0,
    )  # fmt: skip
    x0 = Parameter(
        "m", "position of the unstrained guide", nominal=0.0, bounds=(-1e-1, 1e-1),
        typical=(-1e-5, 1e-5), fixed=True, detail=True,
    )  # fmt: skip
    fifth = Parameter(
        "1/m^2", "quintic over cubic stiffness", nominal=0.0, bounds=(-1e18, 1e18),
        typical=(-1e9, 1e9), fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the acceleration."""

        def force(off: Any) -> Any:
            return off * off * off * (1.0 + p.fifth * off * off)

        return Equations(gives=-p.k3 * (force(chain.position.value - p.x0) + force(p.x0)))
