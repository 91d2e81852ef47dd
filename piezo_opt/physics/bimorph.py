"""Bimorph cantilevers: two layers that bend because one contracts and the other extends."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.physics.material import Material


class Wiring(Enum):
    """How the two layers share the voltage."""

    SERIES = "series"
    """Poled against each other, V across both: E = V / (2 t)."""
    PARALLEL = "parallel"
    """Poled alike, V across each: E = V / t."""


_FIRST: Final = 1.8751040687
"""First root of cos(x) cosh(x) = -1: the cantilever's. Source: Blevins (1979), table 8-1."""


@final
@dataclass(frozen=True)
class Bimorph:
    """A cantilever of two active layers, with or without a passive one between.

        kappa = d31 E Y t (t + s) / B,   u(x) = kappa x^2 / 2,   Y = 1 / s11^E
        B = Y ((s + 2 t)^3 - s^3) / 12 + Y_s s^3 / 12

    for layers of thickness t around one of thickness s and modulus Y_s, per unit width. Without a
    middle layer kappa = 3 d31 E / h and, wired in series, u = 3 d31 V x^2 / (2 h^2) with h = 2 t.
    u is positive towards the layer that contracts for positive V, so it takes |d31|.

    Args:
        material: the ceramic.
        length, width: [m].
        thickness: t, of one active layer [m].
        wiring: how the layers share the voltage.
        middle: s, thickness of the passive layer [m].
        middle_modulus: Y_s [Pa].
        middle_density: [kg/m^3].

    Raises:
        InputError: a dimension is not positive, or a middle layer has no modulus and density.

    Source: Smits, Dalke & Cooney (1991), Sensors and Actuators A 28, 41-61 (no middle layer);
    Euler-Bernoulli beam of layers for the rest.
    """

    material: Material
    length: float
    width: float
    thickness: float
    wiring: Wiring = Wiring.SERIES
    middle: float = 0.0
    middle_modulus: float = 0.0
    middle_density: float = 0.0

    def __post_init__(self) -> None:
        for label in ("length", "width", "thickness"):
            if not 0.0 < getattr(self, label) < np.inf:
                raise InputError(
                    f"{label} of a bimorph is {getattr(self, label):g} m; give a positive one"
                )
        if self.middle < 0.0 or (
            self.middle > 0.0 and not (self.middle_modulus > 0.0 and self.middle_density > 0.0)
        ):
            raise InputError(
                "a bimorph's middle layer needs a positive thickness, modulus and density; leave "
                "all three out where there is none"
            )

    @property
    def modulus(self) -> float:
        """Y = 1 / s11^E [Pa]."""
        return 1.0 / float(self.material.compliance[0, 0])

    @property
    def bending_stiffness(self) -> float:
        """B w [N m^2]."""
        outer = (self.middle + 2.0 * self.thickness) ** 3 - self.middle**3
        return self.width * (self.modulus * outer + self.middle_modulus * self.middle**3) / 12.0

    def field(self, voltage: float) -> float:
        """Field in a layer [V/m]."""
        share = 0.5 if self.wiring is Wiring.SERIES else 1.0
        return share * voltage / self.thickness

    def curvature(self, voltage: float) -> float:
        """kappa [1/m]."""
        moment = self.modulus * abs(self.material.d31) * self.field(voltage) * self.width
        arm = self.thickness * (self.thickness + self.middle)
        return moment * arm / self.bending_stiffness

    def deflection(self, voltage: float, x: float | None = None) -> float:
        """kappa x^2 / 2 at a distance x from the clamp, at the tip unless told [m]."""
        at = self.length if x is None else x
        return 0.5 * self.curvature(voltage) * at**2

    @property
    def stiffness(self) -> float:
        """3 B w / L^3 at the tip [N/m]."""
        return 3.0 * self.bending_stiffness / self.length**3

    def blocked_force(self, voltage: float) -> float:
        """Force that keeps the tip in place [N]."""
        return self.stiffness * self.deflection(voltage)

    @property
    def capacitance(self) -> float:
        """Of the free cantilever well below resonance [F].

            C = N eps33^T w L / t (1 - k31^2 (1 - kappa z / (d31 E)))

        z = (t + s) / 2, the middle of a layer; N = 2 in parallel and 1/2 in series. Bending
        relieves the layers of part of their stress: without a middle layer 1 - k31^2 / 4 is left.
        """
        layers = 0.5 if self.wiring is Wiring.SERIES else 2.0
        strain = abs(self.material.d31) * self.field(1.0)
        relieved = self.curvature(1.0) * 0.5 * (self.thickness + self.middle) / strain
        plate = float(self.material.permittivity[2, 2]) * self.width * self.length / self.thickness
        return layers * plate * (1.0 - self.material.k31**2 * (1.0 - relieved))

    @property
    def resonance(self) -> float:
        """First bending frequency, the voltage held [Hz]: x^2 / (2 pi L^2) sqrt(B w / mu)."""
        ceramic = 2.0 * self.thickness * self.material.density
        line = self.width * (ceramic + self.middle * self.middle_density)
        return float(
            _FIRST**2 / (2.0 * np.pi * self.length**2) * np.sqrt(self.bending_stiffness / line)
        )
