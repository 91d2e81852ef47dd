"""A drive that does nothing near zero or a bias; a drive or a reading that rests at a turn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import length_of_stretch, play, softplus, stack, taken_along

_PLAYS = 4
"""Plays of which a finer backlash is made."""


@final
@dataclass(frozen=True)
class DeadZone(Effect):
    """Loss of slope around zero drive or a bias; or backlash, its form with a memory.

        v = u + share (e [softplus((u - width) / e) - softplus((-u - width) / e)] - u)
        e = softness width
        v = u + share (e [softplus((d - width) / e) - softplus((-d - width) / e)] - d)   biased
        d = u - c,   e = softness width   biased
        y = mean of z_i,   z_i = min(max(z_before, x - w_i), x + w_i)   backlash
        w_i = w (1 + spread c_i),   c_i evenly within -1 and 1   backlash
        v = min(max(v_before, u - slack), u + slack)   drive_backlash

    At share = 1 the drive has no effect for |u| < width and is short by width beyond it; biased,
    the same around c, as where an amplifier's output stage crosses over within its range.
    softplus(a) = log(1 + exp(a)). Backlash is a play of half width w between the position and the
    reading, exact while the position moves one way: z_before is the reading where it last turned.
    At w = 0 the reading is the position. A play that is taken up little by little, as by a rough
    surface, is several of them side by side; spread is kept at 0 unless freed. A backlash of the
    drive is the same in front of everything: the loop has the drive as the play hands it on.

    References: Tao & Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor
    Nonlinearities, Wiley (dead-zone, backlash); Khalil (2002), Nonlinear Systems, sec. 1.2.7.
    """

    biased: bool = False
    backlash: bool = False
    drive_backlash: bool = False
    plays: int = 1
    variants = ({}, {"biased": True}, {"backlash": True}, {"drive_backlash": True})
    rarer = ("biased",)
    z = State(
        "m", "reading at the last turn, play by play", size="plays", remanent=True, when="backlash"
    )
    v = State("V", "drive at the last turn", remanent=True, when="drive_backlash")
    begun = State("V", "drive where a stretch began", when="drive_backlash")
    length = State("s", "length of a stretch", when="drive_backlash")
    share = Parameter(
        "1", "slope lost around zero", nominal=0.0, bounds=(0.0, 1.0), typical=(0.1, 1.0),
        null=0.0, unless=("backlash", "drive_backlash"),
    )  # fmt: skip
    width = Parameter(
        "V", "half width of the zone", nominal=1.0, bounds=(1e-6, 1e5), typical=(1e-2, 10.0),
        unless=("backlash", "drive_backlash"),
    )  # fmt: skip
    c = Parameter(
        "V", "centre of the zone", nominal=0.0, bounds=(-1e6, 1e6), typical=(-50.0, 100.0),
        when="biased", unless=("backlash", "drive_backlash"),
    )  # fmt: skip
    softness = Parameter(
        "1", "rounding of the corners over the width", nominal=0.1, bounds=(1e-3, 1.0),
        typical=(0.02, 0.3), fixed=True, detail=True, unless=("backlash", "drive_backlash"),
    )  # fmt: skip
    w = Parameter(
        "m", "half of the lost motion", nominal=0.0, bounds=(0.0, 1e-2), typical=(1e-9, 1e-6),
        null=0.0, when="backlash",
    )  # fmt: skip
    spread = Parameter(
        "1", "largest width over the mean one, less 1", nominal=0.0, bounds=(0.0, 1.0),
        typical=(0.0, 1.0), fixed=True, detail=True, when="backlash",
    )  # fmt: skip

    slack = Parameter(
        "V", "half of the lost drive", nominal=0.0, bounds=(0.0, 1e5), typical=(1e-2, 10.0),
        null=0.0, when="drive_backlash",
    )  # fmt: skip

    @property
    def place(self) -> Place:
        """The input line; of backlash the output line."""
        return Place.OUTPUT if self.backlash else Place.INPUT

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """Backlash with several plays, whose widths can spread."""
        rough = self.backlash and self.plays == 1
        return (replace(self, plays=_PLAYS), {}) if rough else (self, {})

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive, or the outgoing reading, remembered at the end of every stretch."""
        u, rate = chain.incoming.value, chain.incoming.rate
        if self.drive_backlash:
            return Equations(
                gives=taken_along(x.v, x.begun, x.length, u, rate, p.slack),
                becomes={
                    "v": play(x.v, u, p.slack),
                    "begun": u,
                    "length": length_of_stretch(x.length, x.begun, u, rate),
                },
                starts={"v": u, "begun": u},
            )
        if self.backlash:
            n = self.plays
            apart = ((2.0 * i + 1.0 - n) / n for i in range(n))
            carried = play(x.z, u, stack([p.w * (1.0 + p.spread * c) for c in apart]))
            mean = sum(carried[i] for i in range(n)) / n
            return Equations(gives=mean, becomes={"z": carried}, starts={"z": stack([u] * n)})
        corner = p.softness * p.width
        around = u - p.c if self.biased else u
        above = softplus((around - p.width) / corner)
        below = softplus((-around - p.width) / corner)
        return Equations(gives=u + p.share * (corner * (above - below) - around))
