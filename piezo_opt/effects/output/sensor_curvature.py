"""A sensor whose scale is not straight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class SensorCurvature(Effect):
    """Quadratic (and cubic) error of the sensor's calibration, or cubic (and quadratic).

        y = x + a x^2 (1 + ratio x)
        y = x + a x^2 (x / q + even)   cubic

    ratio and even are kept at 0 unless freed; q gives a its unit. Cubic is the error of a sensor
    that is read on both sides of its zero.

    References: Fleming (2013), Sensors and Actuators A 190, 106-126 (mapping error of a
    calibration function).
    """

    cubic: bool = False
    place = Place.OUTPUT
    variants = ({"cubic": False}, {"cubic": True})
    a = Parameter(
        "1/m", "curvature of the calibration, cubic at the reading q", nominal=0.0,
        bounds=(-1e8, 1e8), typical=(-1e3, 1e3), null=0.0,
    )  # fmt: skip
    ratio = Parameter(
        "1/m", "cubic over quadratic coefficient", nominal=0.0, bounds=(-1e9, 1e9),
        typical=(-1e4, 1e4), fixed=True, detail=True,
        unless="cubic",
    )  # fmt: skip
    even = Parameter(
        "1", "quadratic over cubic part at the reading q", nominal=0.0, bounds=(-1e3, 1e3),
        typical=(-1.0, 1.0), fixed=True, detail=True, when="cubic",
    )  # fmt: skip
    q = Parameter(
        "m", "reading at which a is the cubic coefficient", nominal=1e-5, bounds=(1e-9, 1.0),
        fixed=True, when="cubic",
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading."""
        seen = chain.incoming.value
        shape = seen / p.q + p.even if self.cubic else 1.0 + p.ratio * seen
        return Equations(gives=seen + p.a * seen * seen * shape)
