"""Prandtl-Ishlinskii hysteresis: a sum of play operators, bent by dead zones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.effects.strain.history import ELSEWHERE, history, remembered
from piezo_opt.errors import ModelError
from piezo_opt.symbolic import dragged, exp, max_, min_, play, stack, sum_

_MOST = 100
"""Largest number of dead zones on a side: a guard against a slip of the keyboard."""


@final
@dataclass(frozen=True)
class PrandtlIshlinskii(Effect):
    """Weighted play operators, made asymmetric by dead zones, in the place of bouc_wen.

        z_i = min(max(z_i_before, v - r_i), v + r_i),   r_i = r i / k,   i = 1..k
        z_i begins at origin - (swing + swing_before) r, goes to origin - swing r, to origin, to v
        s += -sum_i w_i (v - z_i),   w_i = rho / k exp(-decay (i - 1) / k)
        s += sum_j [above max(e - t_j, 0) + below min(e + t_j, 0)] / l
        e = sum_i w_i z_i / sum_i w_i,   t_j = t j / l,   j = 1..l

    v - z_i is the stop operator, so that piezo_gain's d stays the slope of large strokes. e is
    what the k plays give, per weight; the l one-sided dead zones of either side add slope to it
    beyond their thresholds, and the branches of the loop differ where above and below do. below is
    kept at 0 unless freed: a drive that is never negative does not reach it. With dead_zones = 0
    the law is the classical, symmetric one. The play of threshold 0 is piezo_gain's and passes by
    the dead zones.

    Exact on every monotone stretch of the drive. Unless freed, the swings before a record are 0 and
    its drive came from zero at once. The loop of a smooth density over the thresholds is met by
    chords, at most 1/(8 k^2) of its height off: 0.03 % with twenty plays.

    References: Kuhnen (2003), European Journal of Control 9(4), 407-418 (modified law: dead-zone
    operators behind the plays); Brokate & Sprekels (1996), Hysteresis and Phase Transitions,
    Springer (play and stop operators).
    """

    operators: int = 20
    dead_zones: int = 2
    place = Place.STRAIN
    structural = True
    elsewhere = ELSEWHERE
    z = State("V", "play of each operator", size="operators")
    rho = Parameter(
        "m/V", "strength of the loop", nominal=3e-8, bounds=(0.0, 1e-3), typical=(5e-9, 1e-7)
    )
    decay = Parameter(
        "1", "decay of the weights over the thresholds", nominal=1.0, bounds=(-20.0, 20.0),
        typical=(0.0, 5.0),
    )  # fmt: skip
    r = Parameter("V", "largest threshold", nominal=50.0, bounds=(1e-6, 1e6), typical=(1.0, 150.0))
    above = Parameter(
        "m/V", "slope gained above all dead zones", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-5e-8, 5e-8), when="dead_zones",
    )  # fmt: skip
    below = Parameter(
        "m/V", "slope gained below all dead zones", nominal=0.0, bounds=(-1e-3, 1e-3),
        typical=(-5e-8, 5e-8), fixed=True, when="dead_zones",
    )  # fmt: skip
    t = Parameter(
        "V", "threshold of the widest dead zone", nominal=30.0, bounds=(1e-6, 1e6),
        typical=(1.0, 100.0), when="dead_zones",
    )  # fmt: skip

    vars().update(history())

    def __post_init__(self) -> None:
        super().__post_init__()
        count: object = self.dead_zones
        if not isinstance(count, int) or isinstance(count, bool) or not 0 <= count <= _MOST:
            raise ModelError(
                f"{self.name}: dead_zones is {count!r}; give a whole number from 0 (the "
                f"symmetric law) to {_MOST}."
            )

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement; each operator is dragged by the drive."""
        v, k = chain.drive.value, self.operators
        radii = stack([p.r * (i + 1) / k for i in range(k)])
        shares = stack([exp(-p.decay * i / k) for i in range(k)])
        followed = dragged(x.z, v, chain.drive.heading, radii)
        looped = -p.rho / k * sum_(shares * (v - followed))
        return Equations(
            gives=looped + self._bent(sum_(shares * followed) / sum_(shares), p),
            becomes={"z": play(x.z, v, radii)},
            starts={"z": remembered(p, v, radii)},
        )

    def _bent(self, played: Any, p: Any) -> Any:
        """What the dead zones add to the output of the plays."""
        count, added = self.dead_zones, 0.0
        for j in range(1, count + 1):
            threshold = p.t * j / count
            added += p.above / count * max_(played - threshold, 0.0)
            added += p.below / count * min_(played + threshold, 0.0)
        return added
