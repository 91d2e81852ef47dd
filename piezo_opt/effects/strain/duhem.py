"""Duhem's hysteresis of the drive, as Coleman and Hodgdon write it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, tanh


@final
@dataclass(frozen=True)
class Duhem(Effect):
    """Hysteretic displacement that goes to a curve of the drive, in the place of bouc_wen.

        h' = alpha v' + beta |v'| [sigma S(v) - h],   S(v) = b tanh((v - c) / b)
        s += -h

    On either branch h relaxes to the curve sigma S and is as far off it as alpha says. With
    sigma = 0 it is Bouc-Wen without its gamma; with a broad b the law of Coleman and Hodgdon with
    straight lines.

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
        "m/V", "slope of the curve in its middle", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-7, 1e-7),
    )  # fmt: skip
    b = Parameter(
        "V", "breadth of the curve", nominal=100.0, bounds=(1e-6, 1e6), typical=(1.0, 300.0)
    )
    c = Parameter(
        "V", "middle of the curve", nominal=0.0, bounds=(-1e6, 1e6), typical=(-50.0, 100.0)
    )

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The loop's rate, and its contribution to the free displacement."""
        v, rate = chain.drive.value, chain.drive.rate
        curve = p.sigma * p.b * tanh((v - p.c) / p.b)
        moves = p.alpha * rate + p.beta * abs_(rate) * (curve - x.h)
        return Equations(gives=-x.h, moves={"h": moves})
