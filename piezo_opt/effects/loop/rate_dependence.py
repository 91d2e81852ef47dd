"""A loop that depends on how fast it is run through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, dragged, play, power_, stack, sum_

_PLAYS = 3
"""Plays of a widening loop: their thresholds are a third of the largest one apart."""


@final
@dataclass(frozen=True)
class RateDependence(Effect):
    """Relaxation of the hysteretic displacement, or another strength or size at another rate.

        h' += -r |v'/q|^m h
        h' += -r |v'/q|^k h   narrowing
        h' += strength |v'/q|^j v'   strengthening
        h' += share |v'/q|^j L,   L the law's own h'   scaling
        s += -share (z - h),   tau z' = h - z   lagging
        s += -share |w|^j h,   tau w' = |v'/q| - w   paced
        s += weight sum_i (z_i - y_i),   i = 1..3   widening
        z_i = min(max(z_i_before, v - w_i), v + w_i),   w_i = r_i (1 + |v'/q|^j)   widening
        y_i = min(max(y_i_before, v - r_i), v + r_i),   r_i = threshold i / 3   widening

    m = 0 (the default, kept fixed): viscous relaxation, the loop forgets at the rate r even when
    the drive rests. narrowing, k = 2 (kept fixed): the hysteretic displacement at a turn falls with
    the rate, and a wide loop narrows, as Bouc-Wen's beta grown by r |v'| / q^2 would do. An
    exponent of 1 only renames beta. A strengthening loop is driven the harder the faster (its
    alpha grows), of a scaling one all of the law. Of a lagging one a share follows late, and a
    paced one is higher after it was run through fast; a widening one is of plays whose thresholds
    grow with the rate, and have doubled at q. These three ask no rate of the law, and act beside
    plays, too. Elsewhere q pivots the exponents, so that no unit depends on them. What looks like
    rate dependence is often the amplifier or the mechanics.

    References: Mayergoyz (2003), Mathematical Models of Hysteresis and Their Applications, 2nd
    ed., Elsevier (rate-dependent hysteresis); Al Janaideh & Krejci (2013), IEEE/ASME Trans.
    Mechatronics 18(5), 1498-1507 (plays whose thresholds depend on the rate).
    """

    narrowing: bool = False
    strengthening: bool = False
    scaling: bool = False
    lagging: bool = False
    paced: bool = False
    widening: bool = False
    variants = (
        {"narrowing": False}, {"narrowing": True}, {"strengthening": True}, {"scaling": True},
        {"lagging": True}, {"paced": True}, {"widening": True},
    )  # fmt: skip
    rarer = ("strengthening", "scaling", "lagging", "paced", "widening")
    z = State("m", "the hysteretic displacement, late", when="lagging")
    w = State("1", "rate of the drive, smoothed", when="paced")
    wide = State("V", "play whose threshold grows with the rate", size=_PLAYS, when="widening")
    y = State("V", "play whose threshold does not", size=_PLAYS, when="widening")
    r = Parameter(
        "1/s", "relaxation rate of the loop", nominal=0.0, bounds=(0.0, 1e15), typical=(1e-3, 10.0),
        null=0.0, unless=("strengthening", "scaling", "lagging", "paced", "widening"),
    )  # fmt: skip
    strength = Parameter(
        "m/V", "strength gained at the pivot rate", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-8, 1e-8), null=0.0, when="strengthening",
    )  # fmt: skip
    share = Parameter(
        "1", "share of the law that is late, or by which it grows at the pivot rate", nominal=0.0,
        bounds=(-10.0, 1e3), typical=(-0.5, 0.5), null=0.0, when=("scaling", "lagging", "paced"),
    )  # fmt: skip
    m = Parameter(
        "1", "exponent of the drive's rate", nominal=0.0, bounds=(0.0, 2.0), typical=(0.0, 2.0),
        fixed=True, detail=True,
        unless=("narrowing", "strengthening", "scaling", "lagging", "paced", "widening"),
    )  # fmt: skip
    k = Parameter(
        "1", "exponent of the drive's rate when narrowing", nominal=2.0, bounds=(1.05, 3.0),
        typical=(1.2, 2.5), fixed=True, detail=True, when="narrowing",
    )  # fmt: skip
    j = Parameter(
        "1", "exponent of the drive's rate when it makes stronger", nominal=0.5,
        bounds=(0.02, 3.0), typical=(0.1, 1.0), fixed=True, detail=True,
        when=("strengthening", "scaling", "paced", "widening"),
    )  # fmt: skip
    q = Parameter(
        "V/s", "rate of the drive at which the exponent makes no difference", nominal=1e4,
        bounds=(1e-6, 1e9), fixed=True, unless="lagging", freed="widening",
    )  # fmt: skip
    weight = Parameter(
        "m/V", "weight of each play that widens", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-8, 1e-8), null=0.0, when="widening",
    )  # fmt: skip
    threshold = Parameter(
        "V", "largest threshold of the plays at rest", nominal=20.0, bounds=(1e-6, 1e6),
        typical=(1.0, 100.0), when="widening",
    )  # fmt: skip
    tau = Parameter(
        "s", "time constant of what is late", nominal=1e-2, bounds=(1e-9, 1e9),
        typical=(1e-3, 10.0), when=("lagging", "paced"),
    )  # fmt: skip

    @property
    def place(self) -> Place:
        """Beside the law on the strain where it asks no rate of the law, else on the loop."""
        return Place.STRAIN if self.lagging or self.paced or self.widening else Place.LOOP

    @property
    def requires(self) -> tuple[str, ...]:
        """A hysteresis law, with a rate where it adds to that."""
        return ("loop",) if self.place is Place.LOOP else ("hysteresis",)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the loop's rate, or what it adds to the strain beside the law."""
        h = chain.hysteresis
        if self.lagging:
            moves = {"z": (h - x.z) / p.tau}
            return Equations(gives=-p.share * (x.z - h), moves=moves, starts={"z": h})
        pace = abs_(chain.drive.rate) / p.q
        if self.paced:
            moves = {"w": (pace - x.w) / p.tau}
            return Equations(gives=-p.share * power_(abs_(x.w), p.j) * h, moves=moves)
        if self.widening:
            v, heading, k = chain.drive.value, chain.drive.heading, _PLAYS
            radii = stack([p.threshold * (i + 1) / k for i in range(k)])
            wide = radii * (1.0 + power_(pace, p.j))
            more = dragged(x.wide, v, heading, wide) - dragged(x.y, v, heading, radii)
            begun = play(0.0 * radii, v, radii)
            return Equations(
                gives=p.weight * sum_(more),
                becomes={"wide": play(x.wide, v, wide), "y": play(x.y, v, radii)},
                starts={"wide": begun, "y": begun},
            )
        if self.strengthening:
            return Equations(gives=p.strength * power_(pace, p.j) * chain.drive.rate)
        if self.scaling:
            return Equations(gives=p.share * power_(pace, p.j) * chain.law)
        rate = power_(pace, p.k if self.narrowing else p.m)
        return Equations(gives=-p.r * rate * h)
