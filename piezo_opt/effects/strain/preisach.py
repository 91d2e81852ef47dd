"""Preisach hysteresis, written as a sum of saturating plays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import exp as exp_
from math import log
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.effects.strain.history import ELSEWHERE, history, remembered
from piezo_opt.symbolic import dragged, exp, play, stack, sum_, tanh

_WEIGHTS = 20
"""Plays of the form in which the weight of each is free. Between thresholds that are 1/k of a
loop's width apart the loop of a smooth density is a chord, at most 1/(8 k^2) of its height off:
three hundredths of a per cent with twenty, below the noise of a good sensor."""


def _weight(index: int) -> str:
    return f"w{index + 1}"


def _weights() -> dict[str, Parameter]:
    """The free weights by name; together they are nominally those of a usual loop."""
    return {
        _weight(index): Parameter(
            "m/V", f"weight of the play at {index + 1} twentieths of the largest threshold",
            nominal=3e-8 / _WEIGHTS, bounds=(0.0, 1e-3), typical=(0.0, 1e-8), when="free",
        )
        for index in range(_WEIGHTS)
    }  # fmt: skip


@final
@dataclass(frozen=True)
class Preisach(Effect):
    """Preisach operator with a smooth density, in the place of bouc_wen.

        z_i = min(max(z_i_before, v - r_i), v + r_i),   r_i = r (i / k)^spacing,   i = 1..k
        s += sum_i w_i b_i [S_i(z_i) - S_i(0)],   b_i = b exp(widening i / k)
        S_i(z) = tanh(e + flatness e^3),   e = (z - c) / b_i
        w_i = rho / k exp(-decay (i - 1) / k)
        w1 .. w20 are parameters   free
        z_i begins at origin - (swing + swing_before) r, goes to origin - swing r, to origin, to v

    A Preisach operator is a superposition, over the half-distance r of a relay's thresholds, of
    functions of the play of radius r. Its density is w(r) sech^2((centre - c) / b) here, with a
    breadth b that may grow with r: relays are rare far from the centre c, so the loop saturates and
    may be asymmetric, which plays alone cannot be. With flatness = 0.071 it is normal over the
    centre, of standard deviation 0.80 b, to five ten-thousandths of its integral; the larger, the
    more even and the more sharply bounded. Unlike a grid of relays this is continuous, with
    derivatives by every parameter. piezo_gain's d is the slope just after a turn. With free weights
    the density over r is any; with a broad one over the centre the plays are those of Prandtl and
    Ishlinskii. No weight is negative: such relays would give energy. Without swings the drive came
    from the origin at once.

    References: Preisach (1935), Zeitschrift fuer Physik 94, 277-302; Brokate & Sprekels (1996),
    Hysteresis and Phase Transitions, Springer (Preisach operators through plays); Page (1977),
    Applied Statistics 26(1), 75-76 (the normal distribution by tanh of a cubic).
    """

    operators: int = 10
    free: bool = False
    place = Place.STRAIN
    structural = True
    elsewhere = ELSEWHERE
    z = State("V", "play of each operator", size="plays")
    rho = Parameter(
        "m/V", "strength of the loop", nominal=3e-8, bounds=(0.0, 1e-3), typical=(5e-9, 1e-7),
        unless="free",
    )  # fmt: skip
    decay = Parameter(
        "1", "decay of the density over the thresholds", nominal=1.0, bounds=(-20.0, 20.0),
        typical=(0.0, 5.0), unless="free",
    )  # fmt: skip
    vars().update(_weights())
    r = Parameter("V", "largest threshold", nominal=50.0, bounds=(1e-6, 1e6), typical=(1.0, 150.0))
    b = Parameter(
        "V", "breadth of the density", nominal=100.0, bounds=(1e-6, 1e6), typical=(1.0, 300.0)
    )
    c = Parameter(
        "V", "centre of the density", nominal=0.0, bounds=(-1e6, 1e6), typical=(-50.0, 100.0)
    )

    spacing = Parameter(
        "1", "exponent of the thresholds' distances, 1 for even ones", nominal=1.0,
        bounds=(0.2, 5.0), typical=(0.5, 2.0), fixed=True, detail=True,
    )  # fmt: skip
    flatness = Parameter(
        "1", "how much flatter than sech^2 the density is, 0.071 for a normal one", nominal=0.0,
        bounds=(0.0, 10.0), typical=(0.0, 0.3), fixed=True, detail=True,
    )  # fmt: skip
    widening = Parameter(
        "1", "log of the breadth at the largest threshold over that at zero", nominal=0.0,
        bounds=(-5.0, 5.0), typical=(-0.5, 0.5), fixed=True, detail=True,
    )  # fmt: skip
    vars().update(history())

    @property
    def plays(self) -> int:
        """Number of plays."""
        return _WEIGHTS if self.free else self.operators

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """Free weights, which begin at those of the density."""
        if self.free:
            return self, {}
        begin = {
            _weight(i): own["rho"] / _WEIGHTS * exp_(-own["decay"] * i / _WEIGHTS)
            for i in range(_WEIGHTS)
        }
        return replace(self, free=True), begin

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Contribution to the free displacement; each operator is dragged by the drive."""
        v, k = chain.drive.value, self.plays
        radii = stack([p.r * exp(p.spacing * log((i + 1) / k)) for i in range(k)])
        if self.free:
            weights = stack([getattr(p, _weight(i)) for i in range(_WEIGHTS)])
        else:
            weights = stack([p.rho / k * exp(-p.decay * i / k) for i in range(k)])
        followed = dragged(x.z, v, chain.drive.heading, radii)
        breadths = stack([p.b * exp(p.widening * (i + 1) / k) for i in range(k)])
        bent = _share(followed, breadths, p) - _share(0.0, breadths, p)
        return Equations(
            gives=sum_(breadths * weights * bent),
            becomes={"z": play(x.z, v, radii)},
            starts={"z": remembered(p, v, radii)},
        )


def _share(z: Any, breadths: Any, p: Any) -> Any:
    """Integral of the density over the centre, from -1 far below c to 1 far above it."""
    e = (z - p.c) / breadths
    return tanh(e * (1.0 + p.flatness * e * e))
