"""A stroke that is not proportional to the drive, without memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class NonlinearGain(Effect):
    """Quadratic (and cubic) stroke per drive.

        s += k2 v^2 (1 + ratio v)

    The cubic coefficient is k2 ratio, so that one gate makes both vanish; ratio is kept at 0
    unless freed.

    References: Smith (2005), Smart Material Systems: Model Development, SIAM
    (electrostrictive strain, quadratic in the field).
    """

    place = Place.STRAIN
    k2 = Parameter(
        "m/V^2", "quadratic coefficient", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-9, 1e-9), null=0.0,
    )  # fmt: skip
    ratio = Parameter(
        "1/V", "cubic over quadratic coefficient", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1e-2, 1e-2), fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement."""
        v = chain.drive.value
        return Equations(gives=p.k2 * v * v * (1.0 + p.ratio * v))
