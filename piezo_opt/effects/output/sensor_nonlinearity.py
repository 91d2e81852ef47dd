"""What a sensor makes of a position: the periodic error of an interferometer, or a bent scale."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.effects.harmonics import harmonic, periodic

_BENT = ("quadratic", "cubic")


@final
@dataclass(frozen=True)
class SensorNonlinearity(Effect):
    """Periodic error of a two-beam interferometer, once every half wavelength; or a bent scale.

        y = x + a [sin p + s2 sin 2p + c2 cos 2p],   p = 4 pi x / wavelength + phi
        y = x + curvature x^2 (1 + ratio x)   quadratic
        y = x + curvature x^2 (x / q + even)   cubic

    The wavelength is kept at the laser's unless freed: helium-neon, or for instance
    ``SensorNonlinearity(laser=1.55e-6)``; a diagnosis also asks for a solid-state laser (1064 nm)
    and for fibre optics (1550 nm), and with ``unknown`` for what the residual repeats after: an
    encoder's lines. Where the zero lies on the wave is another matter in every record. The second
    harmonic (unequal gains, wrong quadrature) is kept at 0 unless freed.

    Quadratic and cubic are errors of a calibration, the second of a sensor that is read on both
    sides of its zero; ratio and even are kept at 0 unless freed, and q gives the curvature its
    unit.

    References: Wu & Deslattes (1998), Applied Optics 37(28) (periodic nonlinearity in heterodyne
    interferometry, also homodyne); Fleming (2013), Sensors and Actuators A 190, 106-126 (mapping
    error of a calibration function).
    """

    place = Place.OUTPUT
    variants = (
        *({"laser": one} for one in (632.8e-9, 1064e-9, 1550e-9)),
        {"unknown": True}, {"quadratic": True}, {"cubic": True},
    )  # fmt: skip
    laser: float = 632.8e-9
    unknown: bool = False
    quadratic: bool = False
    cubic: bool = False
    a = Parameter(
        "m", "amplitude of the periodic error", nominal=0.0, bounds=(-1e-4, 1e-4),
        typical=(-1e-8, 1e-8), null=0.0, unless=_BENT,
    )  # fmt: skip
    phi = Parameter(
        "rad", "phase at zero position", nominal=0.0, bounds=(-2.0 * pi, 2.0 * pi),
        typical=(-pi, pi), per_record=True, unless=_BENT,
    )  # fmt: skip
    wavelength = Parameter(
        "m", "wavelength of the laser", nominal=632.8e-9, bounds=(1e-8, 1e-2),
        typical=(4e-7, 1.6e-6), fixed=True, detail=True, repeats=True, freed="unknown",
        given="laser", unless=_BENT,
    )  # fmt: skip
    s2 = harmonic("second harmonic, sine", unless=_BENT)
    c2 = harmonic("second harmonic, cosine", unless=_BENT)
    curvature = Parameter(
        "1/m", "curvature of the calibration, cubic at the reading q", nominal=0.0,
        bounds=(-1e8, 1e8), typical=(-1e3, 1e3), null=0.0, when=_BENT,
    )  # fmt: skip
    ratio = Parameter(
        "1/m", "cubic over quadratic coefficient", nominal=0.0, bounds=(-1e9, 1e9),
        typical=(-1e4, 1e4), fixed=True, detail=True, when="quadratic",
    )  # fmt: skip
    even = Parameter(
        "1", "quadratic over cubic part at the reading q", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1.0, 1.0), fixed=True, detail=True, when="cubic",
    )  # fmt: skip
    q = Parameter(
        "m", "reading at which the curvature is the cubic coefficient", nominal=1e-5,
        bounds=(1e-9, 1.0), fixed=True, when="cubic",
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading."""
        seen = chain.incoming.value
        if self.quadratic or self.cubic:
            shape = seen / p.q + p.even if self.cubic else 1.0 + p.ratio * seen
            return Equations(gives=seen + p.curvature * seen * seen * shape)
        angle = 4.0 * pi * seen / p.wavelength + p.phi
        return Equations(gives=seen + p.a * periodic(angle, (p.s2, p.c2)))
