"""A loop whose two branches differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, cos, dragged, max_, play, sin, stack, sum_

_LEAST = 0.05
"""Height of a growing loop, or threshold of a play, over that at 0 V below which it does not
fall."""


_PLAYS = 3
"""Plays of an unequal loop: their thresholds are a third of the largest one apart."""


@final
@dataclass(frozen=True)
class Asymmetry(Effect):
    """Non-symmetrical hysteresis: the loop is another one on one side, of the drive or of itself.

        h' += delta v (1 + bend v^2) |v'|
        h' += growth v' (eta v + h / (1 + growth v))   growing
        h' += growth v L,   L the law's own h'         bent
        h' += -chi (|v'| |h| cos(theta) + v' h sin(theta))   sided
        h' += excess |v'| (1 + tilt v)   uneven
        s += -growth v h   scaled
        s += -delta q,   q' = |v'| [v (1 + bend v^2) - forgets q]   beside
        s += weight sum_i (z_i - y_i),   i = 1..3   unequal
        z_i = min(max(z_i_before, v - r_i (1 + lower spread v)), v + r_i (1 + spread v))   unequal
        y_i = min(max(y_i_before, v - r_i), v + r_i),   r_i = r i / 3   unequal

    The first, with bend kept at 0 unless freed, depends on the sign of the drive; |v'| in place of
    sign(v') keeps the loop independent of the rate at which it is run through. A growing loop is as
    high as 1 + growth v: with eta the law's strength at 0 V (Bouc-Wen's alpha, n = 1) it is
    (1 + growth v) times the symmetrical one, with a large eta only its strength grows. A bent one
    is driven by v + growth v^2 / 2, as long as that rises with v. A sided one gives way sooner on
    one side: theta = 0 where h is positive, theta = pi/2 where the drive rises. An uneven one is
    driven by alpha + excess while the drive rises and alpha - excess while it falls; tilt is kept
    at 0 unless freed. A scaled one takes 1 + growth v times what the law takes from the strain, and
    one beside it forgets what it was like the law of its own. An unequal one is of plays whose
    envelopes spread with the drive; lower, kept at 1 unless freed, is how much of that the lower
    one does. These three ask no rate of the law, and act beside plays, too.

    References: after Zhu & Wang (2012), Sensors and Actuators A 181, 51-60 (non-symmetrical
    Bouc-Wen model for piezoelectric ceramic actuators); Song & Der Kiureghian (2006), J. Eng.
    Mech. 132(6), 610-618 (the terms of the sided form); Al Janaideh, Rakheja & Su (2011), IEEE/ASME
    Trans. Mechatronics 16(4), 734-744 (generalised plays).
    """

    growing: bool = False
    bent: bool = False
    sided: bool = False
    uneven: bool = False
    scaled: bool = False
    beside: bool = False
    unequal: bool = False
    variants = (
        {"growing": False}, {"growing": True}, {"bent": True}, {"sided": True}, {"uneven": True},
        {"scaled": True}, {"beside": True}, {"unequal": True},
    )  # fmt: skip
    rarer = ("growing", "bent", "sided", "uneven", "scaled", "beside", "unequal")
    z = State("V", "play between unequal envelopes", size=_PLAYS, when="unequal")
    y = State("V", "play between equal envelopes", size=_PLAYS, when="unequal")
    q = State("V^2", "asymmetrical part of the loop, over delta", when="beside")
    delta = Parameter(
        "m/V^2", "strength of the asymmetry", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-10, 1e-10), null=0.0,
        unless=("growing", "bent", "sided", "uneven", "scaled", "unequal"),
    )  # fmt: skip
    bend = Parameter(
        "1/V^2", "cubic over linear growth with the drive", nominal=0.0, bounds=(-1e6, 1e6),
        typical=(-1e-4, 1e-4), fixed=True, detail=True,
        unless=("growing", "bent", "sided", "uneven", "scaled", "unequal"),
    )  # fmt: skip
    growth = Parameter(
        "1/V", "growth of the loop with the drive", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1e-2, 1e-2), null=0.0, when=("growing", "bent", "scaled"),
    )  # fmt: skip
    eta = Parameter(
        "m/V", "strength of the loop at 0 V", nominal=3e-8, bounds=(0.0, 1e-3),
        typical=(5e-9, 1e-7), when="growing",
    )  # fmt: skip
    chi = Parameter(
        "1/V", "difference of the widths of the two sides", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1e-2, 1e-2), null=0.0, when="sided",
    )  # fmt: skip
    theta = Parameter(
        "rad", "whether the sides are of the loop or of the drive's rate", nominal=0.0,
        bounds=(-3.2, 3.2), typical=(0.0, 1.6), when="sided",
    )  # fmt: skip

    excess = Parameter(
        "m/V", "strength gained while the drive rises and lost while it falls", nominal=0.0,
        bounds=(-1e-3, 1e-3), typical=(-1e-8, 1e-8), null=0.0, when="uneven",
    )  # fmt: skip
    tilt = Parameter(
        "1/V", "growth of the excess with the drive", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1e-2, 1e-2), fixed=True, detail=True, when="uneven",
    )  # fmt: skip
    weight = Parameter(
        "m/V", "weight of each unequal play", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-8, 1e-8), null=0.0, when="unequal",
    )  # fmt: skip
    r = Parameter(
        "V", "largest threshold at 0 V", nominal=20.0, bounds=(1e-6, 1e6), typical=(1.0, 100.0),
        when="unequal",
    )  # fmt: skip
    spread = Parameter(
        "1/V", "growth of the thresholds with the drive", nominal=1e-2, bounds=(-1e3, 1e3),
        typical=(-1e-2, 1e-2), when="unequal",
    )  # fmt: skip
    lower = Parameter(
        "1", "growth of the lower thresholds over that of the upper ones", nominal=1.0,
        bounds=(-1.0, 1.0), typical=(0.0, 1.0), fixed=True, detail=True, when="unequal",
    )  # fmt: skip
    forgets = Parameter(
        "1/V", "how soon the part beside the law forgets", nominal=2e-2, bounds=(0.0, 1e3),
        typical=(2e-3, 2e-1), when="beside",
    )  # fmt: skip

    @property
    def place(self) -> Place:
        """Beside the law on the strain where it asks no rate of the law, else on the loop."""
        return Place.STRAIN if self.scaled or self.beside or self.unequal else Place.LOOP

    @property
    def requires(self) -> tuple[str, ...]:
        """A hysteresis law, with a rate where it adds to that."""
        return ("loop",) if self.place is Place.LOOP else ("hysteresis",)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the loop's rate, or what it adds to the strain beside the law."""
        v, rate, h = chain.drive.value, chain.drive.rate, chain.hysteresis
        if self.scaled:
            return Equations(gives=-p.growth * v * h)
        if self.beside:
            moves = abs_(rate) * (v * (1.0 + p.bend * v * v) - p.forgets * x.q)
            return Equations(gives=-p.delta * x.q, moves={"q": moves})
        if self.unequal:
            return self._plays(chain.drive, x, p)
        if self.growing:
            height = max_(1.0 + p.growth * v, _LEAST)
            return Equations(gives=p.growth * rate * (p.eta * v + h / height))
        if self.bent:
            return Equations(gives=p.growth * v * chain.law)
        if self.sided:
            sides = abs_(rate) * abs_(h) * cos(p.theta) + rate * h * sin(p.theta)
            return Equations(gives=-p.chi * sides)
        if self.uneven:
            return Equations(gives=p.excess * (1.0 + p.tilt * v) * abs_(rate))
        return Equations(gives=p.delta * v * (1.0 + p.bend * v * v) * abs_(rate))

    def _plays(self, drive: Any, x: Any, p: Any) -> Equations:
        """What plays between unequal envelopes do beyond those between equal ones."""
        v, k = drive.value, _PLAYS
        radii = stack([p.r * (i + 1) / k for i in range(k)])
        above = radii * max_(1.0 + p.spread * v, _LEAST)
        below = radii * max_(1.0 + p.lower * p.spread * v, _LEAST)
        middle, half = v + 0.5 * (above - below), 0.5 * (above + below)
        bent = dragged(x.z, middle, drive.heading, half)
        equal = dragged(x.y, v, drive.heading, radii)
        return Equations(
            gives=p.weight * sum_(bent - equal),
            becomes={"z": play(x.z, middle, half), "y": play(x.y, v, radii)},
            starts={"z": play(0.0 * radii, middle, half), "y": play(0.0 * radii, v, radii)},
        )
