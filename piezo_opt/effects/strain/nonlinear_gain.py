"""A stroke that is not proportional to the drive, without memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class NonlinearGain(Effect):
    """Quadratic (and cubic, quartic) stroke per drive, or cubic (and quadratic).

        s += k2 v^2 (1 + ratio v + bend v^2)
        s += k2 v^2 (v / q + even)   cubic

    The cubic coefficient of the first is k2 ratio and the quartic one k2 bend, so that one gate
    makes all vanish; ratio and bend are kept at 0 unless freed. A stroke that bends alike on both
    sides of zero has no quadratic part to be entered by: cubic begins with that, even at 0, and q
    gives k2 its unit.

    References: Smith (2005), Smart Material Systems: Model Development, SIAM
    (electrostrictive strain, quadratic in the field).
    """

    cubic: bool = False
    place = Place.STRAIN
    variants = ({"cubic": False}, {"cubic": True})
    k2 = Parameter(
        "m/V^2", "quadratic coefficient, cubic at the drive q", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-1e-9, 1e-9), null=0.0,
    )  # fmt: skip
    ratio = Parameter(
        "1/V", "cubic over quadratic coefficient", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1e-2, 1e-2), fixed=True, detail=True,
        unless="cubic",
    )  # fmt: skip
    bend = Parameter(
        "1/V^2", "quartic over quadratic coefficient", nominal=0.0, bounds=(-1e6, 1e6),
        typical=(-1e-4, 1e-4), fixed=True, detail=True,
        unless="cubic",
    )  # fmt: skip
    even = Parameter(
        "1", "quadratic over cubic part at the drive q", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1.0, 1.0), fixed=True, detail=True, when="cubic",
    )  # fmt: skip
    q = Parameter(
        "V", "drive at which k2 is the cubic coefficient", nominal=100.0, bounds=(1e-6, 1e6),
        fixed=True, when="cubic",
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement."""
        v = chain.drive.value
        shape = v / p.q + p.even if self.cubic else 1.0 + p.ratio * v + p.bend * v * v
        return Equations(gives=p.k2 * v * v * shape)
