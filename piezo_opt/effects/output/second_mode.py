"""A second resonance, beside the first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State


@final
@dataclass(frozen=True)
class SecondMode(Effect):
    """Parallel mode driven by the free displacement, added to the reading; or a mass on a spring.

        q'' = omega^2 (s - q) - 2 zeta omega q'
        y = x + g (q + phase q' / omega)
        q'' = omega^2 (x - q) + 2 zeta omega (x' - q')   attached
        x'' += -mass q''   attached
        q'' = omega^2 (s - q) - 2 zeta omega q'   another
        q2'' = omega2^2 (s - q2) - 2 zeta2 omega2 q2'   another
        y = x + g (q + phase q' / omega) + g2 q2   another

    With another there are two such modes beside the first. A mode with more damping than 0.7 has no
    peak: it is a lag. phase tells damping that is not proportional; it is kept at 0 unless freed.
    An attached mass, a mirror or a post on the stage, is a second mode that splits the first: mass
    is over that which the stage moves, and omega that of the mass on a stage at rest.

    References: Preumont (2011), Vibration Control of Active Structures, 3rd ed., ch. 2 (modal
    expansion: a response is the sum of its modes); Den Hartog (1956), Mechanical Vibrations, 4th
    ed., ch. 3 (a mass with a second one on a spring).
    """

    attached: bool = False
    another: bool = False
    variants = ({"attached": False}, {"attached": True})
    rarer = ("attached",)
    q = State("m", "modal displacement", remanent=True)
    r = State("m/s", "modal velocity", remanent=True)
    q2 = State(
        "m", "displacement of the other mode", remanent=True, when="another", unless="attached"
    )
    r2 = State(
        "m/s", "velocity of the other mode", remanent=True, when="another", unless="attached"
    )
    g = Parameter(
        "1", "share of the mode in the reading", nominal=0.0, bounds=(-10.0, 10.0),
        typical=(-0.1, 0.1), null=0.0, unless="attached",
    )  # fmt: skip
    mass = Parameter(
        "1", "mass on the spring over that of the stage", nominal=0.0, bounds=(0.0, 10.0),
        typical=(0.0, 0.1), null=0.0, when="attached",
    )  # fmt: skip
    omega = Parameter(
        "rad/s", "natural frequency of the mode", nominal=2e4, bounds=(1e-2, 1e7),
        typical=(1e3, 3e5),
    )  # fmt: skip
    zeta = Parameter("1", "damping ratio", nominal=0.02, bounds=(1e-4, 0.7), typical=(5e-3, 0.1))
    phase = Parameter(
        "1", "velocity over displacement in the reading", nominal=0.0, bounds=(-1.0, 1.0),
        typical=(-0.1, 0.1), fixed=True, detail=True, unless="attached",
    )  # fmt: skip

    g2 = Parameter(
        "1", "share of the other mode in the reading", nominal=0.01, bounds=(-10.0, 10.0),
        typical=(-0.1, 0.1), when="another", unless="attached",
    )  # fmt: skip
    omega2 = Parameter(
        "rad/s", "natural frequency of the other mode", nominal=5e4, bounds=(1e-2, 1e7),
        typical=(1e3, 3e5), when="another", unless="attached",
    )  # fmt: skip
    zeta2 = Parameter(
        "1", "damping ratio of the other mode", nominal=0.02, bounds=(1e-4, 0.7),
        typical=(5e-3, 0.1), when="another", unless="attached",
    )  # fmt: skip

    @property
    def place(self) -> Place:
        """The output line; of an attached mass the motion balance."""
        return Place.MOTION if self.attached else Place.OUTPUT

    @property
    def requires(self) -> tuple[str, ...]:
        """An attached mass pulls at what moves."""
        return ("motion",) if self.attached else ()

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """Two modes beside the first, the second of them an octave above the other."""
        if self.attached or self.another:
            return self, {}
        return replace(self, another=True), {"omega2": 2.0 * own["omega"]}

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing reading, or the pull at the stage, and the mode's motion."""
        if self.attached:
            stage = chain.position
            pull = p.omega * p.omega * (stage.value - x.q)
            pull = pull + 2.0 * p.zeta * p.omega * (stage.rate - x.r)
            return Equations(
                gives=-p.mass * pull, moves={"q": x.r, "r": pull}, starts={"q": stage.value}
            )
        gives = chain.incoming.value + p.g * (x.q + p.phase * x.r / p.omega)
        moves = {"q": x.r, "r": _driven(chain.free.value, x.q, x.r, p.omega, p.zeta)}
        starts = {"q": chain.free.value}
        if self.another:
            gives = gives + p.g2 * x.q2
            moves |= {"q2": x.r2, "r2": _driven(chain.free.value, x.q2, x.r2, p.omega2, p.zeta2)}
            starts |= {"q2": chain.free.value}
        return Equations(gives=gives, moves=moves, starts=starts)


def _driven(s: Any, q: Any, r: Any, omega: Any, zeta: Any) -> Any:
    """Acceleration of a mode that the free displacement drives."""
    return omega * omega * (s - q) - 2.0 * zeta * omega * r
