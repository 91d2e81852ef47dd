"""Maxwell-slip hysteresis: springs that slip one after another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.effects.strain.history import ELSEWHERE, history, remembered
from piezo_opt.symbolic import dragged, play, stack, sum_

_ELEMENTS = 8
"""Of the form in which each is its own: 0.6 of the next larger one apart, where they begin, their
thresholds go down to a thirty-sixth of the largest."""


def _own() -> dict[str, Parameter]:
    """What each element carries, and its threshold over the next larger one's, by name."""
    declared: dict[str, Parameter] = {}
    for i in range(1, _ELEMENTS + 1):
        declared[f"h{i}"] = Parameter(
            "m", f"displacement when element {i} slips", nominal=1e-6 / _ELEMENTS,
            bounds=(-1.0, 1.0), typical=(1e-8, 1e-6), when="free",
        )  # fmt: skip
    for i in range(2, _ELEMENTS + 1):
        declared[f"q{i}"] = Parameter(
            "1", f"threshold of element {i} over that of element {i - 1}", nominal=0.6,
            bounds=(0.02, 1.0), typical=(0.3, 0.9), when="free",
        )  # fmt: skip
    return declared


@final
@dataclass(frozen=True)
class MaxwellSlip(Effect):
    """Elastic elements that slip at growing drives, in the place of bouc_wen.

        z_i = min(max(z_i_before, v - r_i), v + r_i),   r_i = r spacing^(i-1),   i = 1..k
        z_i begins at origin - (swing + swing_before) r, goes to origin - swing r, to origin, to v
        s += -h / k sum_i (v - z_i) / r_i
        r_1 = r,   r_i = q_i r_(i-1),   s += -sum_i h_i (v - z_i) / r_i,   i = 1..8   free

    Every element carries at most h / k, reached when the drive has moved r_i from the last
    turn; all slip at -h and h. Free elements carry h_i at most, each at its own threshold. Exact on
    every monotone stretch of the drive. Unless freed, the swings before a record are 0 and its
    drive came from zero at once.

    References: Goldfarb & Celanovic (1997), IEEE Control Systems 17(3) (generalised Maxwell
    resistive capacitor of a piezoelectric stack).
    """

    elements: int = 6
    free: bool = False
    place = Place.STRAIN
    structural = True
    elsewhere = ELSEWHERE
    z = State("V", "drive at which each element is relaxed", size="count")
    h = Parameter(
        "m", "displacement when all elements slip", nominal=1e-6, bounds=(-1.0, 1.0),
        typical=(1e-7, 1e-5), unless="free",
    )  # fmt: skip
    vars().update(_own())
    r = Parameter(
        "V", "drive at which the last element slips", nominal=100.0, bounds=(1e-6, 1e6),
        typical=(1.0, 300.0),
    )  # fmt: skip
    spacing = Parameter(
        "1", "ratio of one threshold to the next larger", nominal=0.6, bounds=(0.1, 0.99),
        typical=(0.4, 0.9), unless="free",
    )  # fmt: skip

    vars().update(history())

    @property
    def count(self) -> int:
        """Number of elements."""
        return _ELEMENTS if self.free else self.elements

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """Elements that are each their own, which begin at the same loop, unless it has more."""
        if self.free or self.elements > _ELEMENTS:
            return self, {}
        numbers = range(1, _ELEMENTS + 1)
        carried = {f"h{i}": own["h"] / self.elements * (i <= self.elements) for i in numbers}
        return replace(self, free=True), {
            **carried,
            **{f"q{i}": own["spacing"] for i in numbers[1:]},
        }

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement; each element is dragged by the drive."""
        v, k = chain.drive.value, self.count
        thresholds = [p.r]
        for i in range(2, k + 1):
            thresholds.append(thresholds[-1] * (getattr(p, f"q{i}") if self.free else p.spacing))
        radii = stack(thresholds)
        followed = dragged(x.z, v, chain.drive.heading, radii)
        own = stack([getattr(p, f"h{i + 1}") for i in range(k)]) if self.free else None
        carried = p.h / k if own is None else own
        return Equations(
            gives=-sum_(carried * (v - followed) / radii),
            becomes={"z": play(x.z, v, radii)},
            starts={"z": remembered(p, v, radii)},
        )
