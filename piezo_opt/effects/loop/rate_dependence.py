"""A loop that depends on how fast it is run through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, power_


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

    m = 0 (the default, kept fixed): viscous relaxation, the loop forgets at the rate r even when
    the drive rests. narrowing, k = 2 (kept fixed): the hysteretic displacement at a turn falls with
    the rate, and a wide loop narrows, as Bouc-Wen's beta grown by r |v'| / q^2 would do. An
    exponent of 1 only renames beta. A strengthening loop is driven the harder the faster (its
    alpha grows), of a scaling one all of the law. Of a lagging one a share follows late, and a
    paced one is higher after it was run through fast; these two ask no rate of the law, and act
    beside plays, too. q pivots the exponents, so that no unit depends on them. What looks like rate
    dependence is often the amplifier or the mechanics.

    References: Mayergoyz (2003), Mathematical Models of Hysteresis and Their Applications, 2nd
    ed., Elsevier (rate-dependent hysteresis).
    """

    narrowing: bool = False
    strengthening: bool = False
    scaling: bool = False
    lagging: bool = False
    paced: bool = False
    variants = (
        {"narrowing": False}, {"narrowing": True}, {"strengthening": True}, {"scaling": True},
        {"lagging": True}, {"paced": True},
    )  # fmt: skip
    rarer = ("strengthening", "scaling", "lagging", "paced")
    z = State("m", "the hysteretic displacement, late", when="lagging")
    w = State("1", "rate of the drive, smoothed", when="paced")
    r = Parameter(
        "1/s", "relaxation rate of the loop", nominal=0.0, bounds=(0.0, 1e15), typical=(1e-3, 10.0),
        null=0.0, unless=("strengthening", "scaling", "lagging", "paced"),
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
        unless=("narrowing", "strengthening", "scaling", "lagging", "paced"),
    )  # fmt: skip
    k = Parameter(
        "1", "exponent of the drive's rate when narrowing", nominal=2.0, bounds=(1.05, 3.0),
        typical=(1.2, 2.5), fixed=True, detail=True, when="narrowing",
    )  # fmt: skip
    j = Parameter(
        "1", "exponent of the drive's rate when it makes stronger", nominal=0.5,
        bounds=(0.02, 3.0), typical=(0.1, 1.0), fixed=True, detail=True,
        when=("strengthening", "scaling", "paced"),
    )  # fmt: skip
    q = Parameter(
        "V/s", "rate of the drive at which the exponent makes no difference", nominal=1e4,
        bounds=(1e-6, 1e9), fixed=True, unless="lagging",
    )  # fmt: skip
    tau = Parameter(
        "s", "time constant of what is late", nominal=1e-2, bounds=(1e-9, 1e9),
        typical=(1e-3, 10.0), when=("lagging", "paced"),
    )  # fmt: skip

    @property
    def place(self) -> Place:
        """Beside the law on the strain where it asks no rate of the law, else on the loop."""
        return Place.STRAIN if self.lagging or self.paced else Place.LOOP

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
        if self.strengthening:
            return Equations(gives=p.strength * power_(pace, p.j) * chain.drive.rate)
        if self.scaling:
            return Equations(gives=p.share * power_(pace, p.j) * chain.law)
        rate = power_(pace, p.k if self.narrowing else p.m)
        return Equations(gives=-p.r * rate * h)
