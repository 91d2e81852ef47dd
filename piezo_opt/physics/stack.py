"""Multilayer stacks: stroke, stiffness, force, capacitance and resonance from their dimensions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.physics.expected import Expected
from piezo_opt.physics.material import Material


@final
@dataclass(frozen=True)
class Stack:
    """n layers poled and driven along the stack, mechanically in series, electrically parallel.

    Every layer is thin against the stack, so its field is held by the voltage and the compliance is
    s33^E throughout.

    Args:
        material: the ceramic.
        layers: n, active layers.
        thickness: of one layer [m].
        area: of the cross section [m^2].
        end_mass: what the free end carries [kg].

    Raises:
        InputError: a dimension is not positive.

    Sources: Preumont (2011), Vibration Control of Active Structures, 3rd ed., sec. 3.3 (stack);
    Blevins (1979), Formulas for Natural Frequency and Mode Shape, table 8-16 (rod with end mass).
    """

    material: Material
    layers: int
    thickness: float
    area: float
    end_mass: float = 0.0

    def __post_init__(self) -> None:
        if self.layers < 1:
            raise InputError(f"a stack of {self.layers} layers: give at least one")
        for label, value in (("thickness", self.thickness), ("area", self.area)):
            if not 0.0 < value < np.inf:
                raise InputError(f"{label} of a layer is {value:g}; give it in SI units")
        if not 0.0 <= self.end_mass < np.inf:
            raise InputError(f"end_mass is {self.end_mass:g} kg; give none, or a positive one")

    @property
    def length(self) -> float:
        """n t, active length [m]."""
        return self.layers * self.thickness

    @property
    def gain(self) -> float:
        """n d33, free stroke a volt [m/V]."""
        return self.layers * self.material.d33

    def stroke(self, voltage: float, load_stiffness: float = 0.0) -> float:
        """n d33 V k / (k + k_L), stroke against a spring k_L [N/m]; free without one [m]."""
        return self.gain * voltage * self.stiffness / (self.stiffness + load_stiffness)

    @property
    def stiffness(self) -> float:
        """A / (n t s33^E), with the voltage held [N/m]."""
        return self.area / (self.length * float(self.material.compliance[2, 2]))

    def blocked_force(self, voltage: float) -> float:
        """k n d33 V, force at no stroke [N]."""
        return self.stiffness * self.gain * voltage

    @property
    def capacitance(self) -> float:
        """n eps33^T A / t, of the free stack well below resonance [F]."""
        return self.layers * float(self.material.permittivity[2, 2]) * self.area / self.thickness

    @property
    def blocked_capacitance(self) -> float:
        """(1 - k33^2) of that: of a stack whose length is held, its sides free [F]."""
        return self.capacitance * (1.0 - self.material.k33**2)

    @property
    def mass(self) -> float:
        """rho A n t, of the ceramic [kg]."""
        return self.material.density * self.area * self.length

    @property
    def resonance(self) -> float:
        """First natural frequency, one end held and the voltage, too [Hz].

        f = x v / (2 pi L),   x tan x = m / M,   v = 1 / sqrt(rho s33^E);   x = pi/2 without M
        """
        speed = 1.0 / np.sqrt(self.material.density * float(self.material.compliance[2, 2]))
        x = 0.5 * np.pi
        if self.end_mass > 0.0:
            # Imported where it is needed: models are read without it.
            from scipy import optimize

            ratio = self.mass / self.end_mass
            x = float(optimize.brentq(lambda y: y * np.sin(y) - ratio * np.cos(y), 0.0, x))
        return float(x * speed / (2.0 * np.pi * self.length))

    def expected(self, tolerance: float, *, mechanics: float | None = None) -> dict[str, Expected]:
        """What a model's parameters are expected to be, by full name.

        ``piezo_gain.d`` from n d33, and ``second_order.omega`` from the resonance where asked for.

        Args:
            tolerance: share by which n d33 may be off; data sheets state 10 to 20 %.
            mechanics: share by which the resonance may be off; None leaves it out, as it should be
                where a frame or a stage decides it.

        Raises:
            InputError: a tolerance that is not a positive share.
        """
        what = f"{self.layers} layers of {self.material.name}"
        found = {"piezo_gain.d": Expected.within(self.gain, tolerance, f"n d33 of {what}")}
        if mechanics is not None:
            omega = 2.0 * np.pi * self.resonance
            found["second_order.omega"] = Expected.within(omega, mechanics, f"resonance of {what}")
        return found
