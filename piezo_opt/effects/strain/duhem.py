"""Duhem's hysteresis of the drive, as Coleman and Hodgdon write it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, sqrt


@final
@dataclass(frozen=True)
class Duhem(Effect):
    """Hysteretic displacement that goes to a curve of the drive, in the place of bouc_wen.

        h' = alpha v' + beta |v'| (sigma e / sqrt(1 + bend e^2) - h),   e = v - c
        s += -h

    h relaxes to a curve of the drive and is as far off it on either branch as alpha says. With
    sigma = 0 it is Bouc-Wen without its gamma; with bend = 0 (the default, kept fixed like c, which
    an offset replaces then) the curve is a line.

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
    bend = Parameter(
        "1/V^2", "bend of the curve: it is flat from 1 / sqrt(bend) on", nominal=0.0,
        bounds=(0.0, 1e6), typical=(0.0, 1e-2), fixed=True, detail=True,
    )  # fmt: skip
    c = Parameter(
        "V", "middle of the curve", nominal=0.0, bounds=(-1e6, 1e6), typical=(-50.0, 100.0),
        fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The loop's rate, and its contribution to the free displacement."""
        e, rate = chain.drive.value - p.c, chain.drive.rate
        curve = p.sigma * e / sqrt(1.0 + p.bend * e * e)
        moves = p.alpha * rate + p.beta * abs_(rate) * (curve - x.h)
        return Equations(gives=-x.h, moves={"h": moves})
