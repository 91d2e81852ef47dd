"""The linear piezoelectric stroke."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.errors import ModelError
from piezo_opt.physics import Material


@final
@dataclass(frozen=True)
class PiezoGain(Effect):
    """Linear stroke of the stack, proportional to the drive.

        s += d v

    A multilayer stack of n layers has d = n d33: :meth:`from_stack`.

    References: IEEE Std 176-1987, IEEE Standard on Piezoelectricity, sec. 2 (strain-charge form).
    """

    place = Place.STRAIN
    structural = True
    nominal: float = 1e-7
    d = Parameter(
        "m/V", "stroke per volt", nominal=1e-7, bounds=(-1e-3, 1e-3), typical=(5e-8, 3e-7),
        given="nominal",
    )  # fmt: skip

    @staticmethod
    def from_stack(material: Material, layers: int) -> PiezoGain:
        """The gain with n d33 as its nominal value.

        Args:
            material: the ceramic, for instance ``piezo_opt.physics.PZT_5H``.
            layers: n, active layers in series.

        Raises:
            ModelError: fewer than one layer.
        """
        if layers < 1:
            raise ModelError(f"A stack of {layers} layers has no stroke; give at least one layer.")
        return PiezoGain(nominal=layers * material.d33)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement."""
        return Equations(gives=p.d * chain.drive.value)
