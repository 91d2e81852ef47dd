"""Hum of the mains in the reading."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.effects.harmonics import harmonic, periodic


@final
@dataclass(frozen=True)
class MainsPickup(Effect):
    """Sine of the mains frequency, added to the reading.

        y = x + a [sin p + s2 sin 2p + c2 cos 2p + s3 sin 3p + c3 cos 3p],   p = 2 pi f t + phi

    f is kept at the mains' nominal frequency unless freed, the harmonics at 0 unless freed: 50 Hz,
    or ``MainsPickup(mains=60.0)``; a diagnosis asks for both. A negative amplitude is the opposite
    phase: a fit that starts at 0 can leave in either direction.

    References: Ott (2009), Electromagnetic Compatibility Engineering, Wiley (coupling of mains
    fields into cables, ground loops).
    """

    place = Place.OUTPUT
    variants = ({"mains": 50.0}, {"mains": 60.0})
    mains: float = 50.0
    a = Parameter(
        "m", "amplitude", nominal=0.0, bounds=(-1e-2, 1e-2), typical=(-1e-8, 1e-8), null=0.0
    )
    phi = Parameter(
        "rad", "phase at the start of the record", nominal=0.0, bounds=(-2.0 * pi, 2.0 * pi),
        typical=(-pi, pi), per_record=True,
    )  # fmt: skip
    f = Parameter(
        "1/s", "mains frequency", nominal=50.0, bounds=(1.0, 1e4), typical=(49.5, 60.5), fixed=True,
        detail=True, given="mains",
    )  # fmt: skip
    s2 = harmonic("second harmonic, sine")
    c2 = harmonic("second harmonic, cosine")
    s3 = harmonic("third harmonic, sine")
    c3 = harmonic("third harmonic, cosine")

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading."""
        turn = 2.0 * pi * p.f * chain.time + p.phi
        hum = periodic(turn, (p.s2, p.c2), (p.s3, p.c3))
        return Equations(gives=chain.incoming.value + p.a * hum)
