"""Where the sensor reads zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place


@final
@dataclass(frozen=True)
class Offset(Effect):
    """Zero point of the displacement sensor, one per record.

        y = x + y0

    References: Fleming (2013), Sensors and Actuators A 190, 106-126 (displacement sensors).
    """

    place = Place.OUTPUT
    structural = True
    y0 = Parameter(
        "m", "reading at zero position", nominal=0.0, bounds=(-1.0, 1.0), typical=(-1e-5, 1e-5),
        per_record=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading."""
        return Equations(gives=chain.incoming.value + p.y0)
