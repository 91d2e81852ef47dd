"""The linear piezoelectric stroke."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class PiezoGain(Effect):
    """Linear stroke of the stack, proportional to the drive.

        s += d v

    A multilayer stack of n layers has d = n d33.

    References: IEEE Std 176-1987, IEEE Standard on Piezoelectricity, sec. 2 (strain-charge form).
    """

    place = Place.STRAIN
    structural = True
    d = Parameter(
        "m/V", "stroke per volt", nominal=1e-7, bounds=(-1e-3, 1e-3), typical=(5e-8, 3e-7)
    )

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement."""
        return Equations(gives=p.d * chain.drive.value)
