"""The periodic error of an interferometer."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.effects.harmonics import harmonic, periodic


@final
@dataclass(frozen=True)
class SensorNonlinearity(Effect):
    """Periodic error of a two-beam interferometer, once every half wavelength.

        y = x + a [sin p + s2 sin 2p + c2 cos 2p],   p = 4 pi x / wavelength + phi

    The wavelength is kept at the laser's unless freed: helium-neon, or for instance
    ``SensorNonlinearity(laser=1.55e-6)``; a diagnosis also asks for a solid-state laser (1064 nm)
    and for fibre optics (1550 nm). The second harmonic (unequal gains, wrong quadrature) is kept at
    0 unless freed.

    References: Wu & Deslattes (1998), Applied Optics 37(28) (periodic nonlinearity in heterodyne
    interferometry, also homodyne).
    """

    place = Place.OUTPUT
    variants = tuple({"laser": one} for one in (632.8e-9, 1064e-9, 1550e-9))
    laser: float = 632.8e-9
    a = Parameter(
        "m", "amplitude of the periodic error", nominal=0.0, bounds=(-1e-4, 1e-4),
        typical=(-1e-8, 1e-8), null=0.0,
    )  # fmt: skip
    phi = Parameter(
        "rad",
        "phase at zero position",
        nominal=0.0,
        bounds=(-2.0 * pi, 2.0 * pi),
        typical=(-pi, pi),
    )
    wavelength = Parameter(
        "m", "wavelength of the laser", nominal=632.8e-9, bounds=(1e-8, 1e-2),
        typical=(4e-7, 1.6e-6), fixed=True, detail=True, given="laser",
    )  # fmt: skip
    s2 = harmonic("second harmonic, sine")
    c2 = harmonic("second harmonic, cosine")

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading."""
        seen = chain.incoming.value
        angle = 4.0 * pi * seen / p.wavelength + p.phi
        return Equations(gives=seen + p.a * periodic(angle, (p.s2, p.c2)))
