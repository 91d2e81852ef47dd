"""A sensor whose scale is not straight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class SensorCurvature(Effect):
    """Quadratic (and cubic) error of the sensor's calibration.

        y = x + a x^2 (1 + ratio x)

    ratio is kept at 0 unless freed.

    References: Fleming (2013), Sensors and Actuators A 190, 106-126 (mapping error of a
    calibration function).
    """

    place = Place.OUTPUT
    a = Parameter(
        "1/m", "curvature of the calibration", nominal=0.0, bounds=(-1e8, 1e8),
        typical=(-1e3, 1e3), null=0.0,
    )  # fmt: skip
    ratio = Parameter(
        "1/m", "cubic over quadratic coefficient", nominal=0.0, bounds=(-1e9, 1e9),
        typical=(-1e4, 1e4), fixed=True, detail=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading."""
        seen = chain.incoming.value
        return Equations(gives=seen + p.a * seen * seen * (1.0 + p.ratio * seen))
