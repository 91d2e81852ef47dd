"""Prandtl-Ishlinskii hysteresis: a sum of play operators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import exp, play, stack, sum_


@final
@dataclass(frozen=True)
class PrandtlIshlinskii(Effect):
    """Weighted play operators with an exponential density, in the place of bouc_wen.

        z_i = min(max(z_i_before, v - r_i), v + r_i),   r_i = r i / k,   i = 1..k
        s += -sum_i w_i (v - z_i),   w_i = rho / k exp(-decay (i - 1) / k)

    v - z_i is the stop operator, so that piezo_gain's d stays the slope of large strokes. Exact
    on every monotone stretch of the drive; at the start of a record z_i is that of a drive that
    came from zero once.

    References: Kuhnen (2003), European Journal of Control 9(4), 407-418; Brokate & Sprekels
    (1996), Hysteresis and Phase Transitions, Springer (play and stop operators).
    """

    operators: int = 10
    place = Place.STRAIN
    structural = True
    z = State("V", "play of each operator", size="operators")
    rho = Parameter(
        "m/V", "strength of the loop", nominal=3e-8, bounds=(0.0, 1e-3), typical=(5e-9, 1e-7)
    )
    decay = Parameter(
        "1", "decay of the weights over the thresholds", nominal=1.0, bounds=(-20.0, 20.0),
        typical=(0.0, 5.0),
    )  # fmt: skip
    r = Parameter("V", "largest threshold", nominal=50.0, bounds=(1e-6, 1e6), typical=(1.0, 150.0))

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement; each operator is dragged by the drive."""
        v, k = chain.drive.value, self.operators
        radii = stack([p.r * (i + 1) / k for i in range(k)])
        weights = stack([p.rho / k * exp(-p.decay * i / k) for i in range(k)])
        dragged = play(x.z, v, radii)
        return Equations(
            gives=-sum_(weights * (v - dragged)),
            becomes={"z": dragged},
            starts={"z": play(0.0 * radii, v, radii)},
        )
