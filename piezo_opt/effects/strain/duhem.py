"""Duhem's hysteresis of the drive, as Coleman and Hodgdon write it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_


@final
@dataclass(frozen=True)
class Duhem(Effect):
    """Hysteretic displacement that goes to a curve of the drive, in the place of bouc_wen.

        h' = alpha v' + beta |v'| (sigma v + second v^2 + third v^3 - h)
        s += -h

    h relaxes to a curve of the drive and is as far off it on either branch as alpha says. With a
    curve of zero it is Bouc-Wen without its gamma; by default the curve is a line, and the higher
    powers are kept fixed at zero. All numbers but beta enter linearly.

    References: Coleman & Hodgdon (1986), Int. J. Engineering Science 24(6), 897-919; Visintin
    (1994), Differential Models of Hysteresis, Springer, ch. V (Duhem models).
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
    sigma = Parameter(
        "m/V", "slope of the curve at zero drive", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-7, 1e-7),
    )  # fmt: skip
    second = Parameter(
        "m/V^2", "second power of the curve", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1e-9, 1e-9), fixed=True, detail=True,
    )  # fmt: skip
    third = Parameter(
        "m/V^3", "third power of the curve", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1e-11, 1e-11), fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The loop's rate, and its contribution to the free displacement."""
        v, rate = chain.drive.value, chain.drive.rate
        curve = v * (p.sigma + v * (p.second + v * p.third))
        moves = p.alpha * rate + p.beta * abs_(rate) * (curve - x.h)
        return Equations(gives=-x.h, moves={"h": moves})
