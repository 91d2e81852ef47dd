"""Mechanics far below their resonance: a spring without a mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State


@final
@dataclass(frozen=True)
class Spring(Effect):
    """A spring behind the free displacement that holds whatever forces act, without inertia.

        0 = omega^2 (s - x) + sum of the other forces

    For records too slow for the resonance: without forces x = s, and a force f moves the position
    by f / omega^2 at once. Only that ratio is seen, so omega is kept where it is set, and a force
    is per unit of a mass that has this natural frequency. The velocity follows from the balance's
    derivative, which the forces' laws turn into a line on either side of zero as long as they do
    not depend on how fast they are run through (friction, hysteresis). Behind a law of plays
    the position is put back where the balance is zero after each sub-step.

    References: Kokotovic, Khalil & O'Reilly (1986), Singular Perturbation Methods in Control,
    Academic Press, ch. 1 (the reduced model of fast dynamics).
    """

    place = Place.MOTION
    structural = True
    x = State("m", "position", position=True)
    omega = Parameter(
        "rad/s", "natural frequency that forces are stated for", nominal=1e3, bounds=(1e-2, 1e7),
        fixed=True,
    )  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the balance; the position moves so that it stays at zero."""
        return Equations(
            gives=p.omega * p.omega * (chain.free.value - x.x),
            moves={"x": chain.position.rate},
            starts={"x": chain.free.value},
        )
