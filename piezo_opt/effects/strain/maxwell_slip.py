"""Maxwell-slip hysteresis: springs that slip one after another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import dragged, play, stack, sum_


@final
@dataclass(frozen=True)
class MaxwellSlip(Effect):
    """Elastic elements that slip at growing drives, in the place of bouc_wen.

        z_i = min(max(z_i_before, v - r_i), v + r_i),   r_i = r spacing^(i-1),   i = 1..k
        s += -h / k sum_i (v - z_i) / r_i

    Every element carries at most h / k, reached when the drive has moved r_i from the last
    turn; all slip at -h and h. Exact on every monotone stretch of the drive; at the start of a
    record z_i is that of a drive that came from zero once.

    References: Goldfarb & Celanovic (1997), IEEE Control Systems 17(3) (generalised Maxwell
    resistive capacitor of a piezoelectric stack).
    """

    elements: int = 6
    place = Place.STRAIN
    structural = True
    z = State("V", "drive at which each element is relaxed", size="elements")
    h = Parameter(
        "m", "displacement when all elements slip", nominal=1e-6, bounds=(-1.0, 1.0),
        typical=(1e-7, 1e-5),
    )  # fmt: skip
    r = Parameter(
        "V", "drive at which the last element slips", nominal=100.0, bounds=(1e-6, 1e6),
        typical=(1.0, 300.0),
    )  # fmt: skip
    spacing = Parameter(
        "1", "ratio of one threshold to the next larger", nominal=0.6, bounds=(0.1, 0.99),
        typical=(0.4, 0.9),
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement; each element is dragged by the drive."""
        v, k = chain.drive.value, self.elements
        thresholds = [p.r]
        for _ in range(k - 1):
            thresholds.append(thresholds[-1] * p.spacing)
        radii = stack(thresholds)
        followed = dragged(x.z, v, chain.drive.rate, radii)
        return Equations(
            gives=-p.h / k * sum_((v - followed) / radii),
            becomes={"z": play(x.z, v, radii)},
            starts={"z": play(0.0 * radii, v, radii)},
        )
