"""A loop that depends on how fast it is run through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.symbolic import abs_, power_


@final
@dataclass(frozen=True)
class RateDependence(Effect):
    """Relaxation of the hysteretic displacement, or another strength or size at another rate.

        h' += -r |v'/q|^m h
        h' += -r |v'/q|^k h   narrowing
        h' += strength |v'/q|^j v'   strengthening
        h' += share |v'/q|^j L,   L the law's own h'   scaling

    m = 0 (the default, kept fixed): viscous relaxation, the loop forgets at the rate r even when
    the drive rests. narrowing, k = 2 (kept fixed): the hysteretic displacement at a turn falls with
    the rate, and a wide loop narrows, as Bouc-Wen's beta grown by r |v'| / q^2 would do. An
    exponent of 1 only renames beta. A strengthening loop is driven the harder the faster (its
    alpha grows), of a scaling one all of the law. q pivots the exponents, so that no unit depends
    on them. What looks like rate dependence is often the amplifier or the mechanics.

    References: Mayergoyz (2003), Mathematical Models of Hysteresis and Their Applications, 2nd
    ed., Elsevier (rate-dependent hysteresis).
    """

    narrowing: bool = False
    strengthening: bool = False
    scaling: bool = False
    place = Place.LOOP
    variants = (
        {"narrowing": False}, {"narrowing": True}, {"strengthening": True}, {"scaling": True},
    )  # fmt: skip
    rarer = ("strengthening", "scaling")
    requires = ("loop",)
    r = Parameter(
        "1/s", "relaxation rate of the loop", nominal=0.0, bounds=(0.0, 1e15), typical=(1e-3, 10.0),
        null=0.0, unless=("strengthening", "scaling"),
    )  # fmt: skip
    strength = Parameter(
        "m/V", "strength gained at the pivot rate", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-8, 1e-8), null=0.0, when="strengthening",
    )  # fmt: skip
    share = Parameter(
        "1", "share by which the law grows at the pivot rate", nominal=0.0, bounds=(-10.0, 1e3),
        typical=(-0.5, 0.5), null=0.0, when="scaling",
    )  # fmt: skip
    m = Parameter(
        "1", "exponent of the drive's rate", nominal=0.0, bounds=(0.0, 2.0), typical=(0.0, 2.0),
        fixed=True, detail=True, unless=("narrowing", "strengthening", "scaling"),
    )  # fmt: skip
    k = Parameter(
        "1", "exponent of the drive's rate when narrowing", nominal=2.0, bounds=(1.05, 3.0),
        typical=(1.2, 2.5), fixed=True, detail=True, when="narrowing",
    )  # fmt: skip
    j = Parameter(
        "1", "exponent of the drive's rate when strengthening or scaling", nominal=0.5,
        bounds=(0.02, 3.0), typical=(0.1, 1.0), fixed=True, detail=True,
        when=("strengthening", "scaling"),
    )  # fmt: skip
    q = Parameter(
        "V/s", "rate of the drive at which the exponent makes no difference", nominal=1e4,
        bounds=(1e-6, 1e9), fixed=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the loop's rate."""
        pace = abs_(chain.drive.rate) / p.q
        if self.strengthening:
            return Equations(gives=p.strength * power_(pace, p.j) * chain.drive.rate)
        if self.scaling:
            return Equations(gives=p.share * power_(pace, p.j) * chain.law)
        rate = power_(pace, p.k if self.narrowing else p.m)
        return Equations(gives=-p.r * rate * chain.hysteresis)
