"""Hysteresis of guides and mounts: a force that remembers the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.symbolic import abs_, power_, stack, sum_

_ELEMENTS = 5
"""Of a distributed force: over a decade of displacements they yield a factor of 1.8 apart, less
than the width of the bend in which one of them does."""
_SPREAD = 10.0
"""Ratio of displacements from which a fit of a distributed force begins: a decade."""


@final
@dataclass(frozen=True)
class HystereticForce(Effect):
    """Bouc-Wen restoring force on the position, per unit mass.

        z' = x' - beta (gamma |x'| |z/z_s|^(n-1) z + delta x' |z/z_s|^(n-1) |z|)
        x'' += -alpha z
        z_i' = x' - beta_i |z_i/z_s|^(n-1) (gamma |x'| z_i + delta x' |z_i|)   distributed
        x'' += -alpha / 5 sum_i z_i,   beta_i = beta spread^((i-1)/4),   i = 1..5   distributed

    This is the benchmark's law for its force alpha z: with n = 1 (the default, kept fixed) its
    alpha per unit mass, beta, gamma and delta are the ones here. Carrying the displacement z
    instead of the force keeps the law regular at alpha = 0. Only beta gamma and beta delta act. A
    distributed force is carried by elements in parallel that yield one after another, as contacts
    in a joint do.

    References: Wen (1976), J. Eng. Mech. Div. 102(2), 249-263; Iwan (1966), J. Applied Mechanics
    33(4), 893-900 (elements in parallel); Noel & Schoukens (2016), Hysteretic benchmark with a
    dynamic nonlinearity, Workshop on Nonlinear System Identification Benchmarks, Brussels.
    """

    distributed: bool = False
    place = Place.MOTION
    requires = ("motion",)
    redundant = 1
    z = State("m", "hysteretic part of the position", size="elements", remanent=True)
    alpha = Parameter(
        "1/s^2", "stiffness of the hysteretic force per unit mass", nominal=0.0,
        bounds=(0.0, 1e12), typical=(1e3, 1e6), null=0.0,
    )  # fmt: skip
    beta = Parameter(
        "1/m", "how soon the force saturates", nominal=1e3, bounds=(0.0, 1e9), typical=(1e2, 1e5)
    )
    gamma = Parameter(
        "1", "width of the loop", nominal=0.8, bounds=(-10.0, 10.0), typical=(0.1, 1.0)
    )
    delta = Parameter(
        "1", "roundness of the loop", nominal=0.0, bounds=(-10.0, 10.0), typical=(-1.0, 1.0)
    )
    n = Parameter(
        "1", "exponent", nominal=1.0, bounds=(1.0, 4.0), typical=(1.0, 2.0), fixed=True, detail=True
    )
    z_s = Parameter(
        "m", "displacement at which the exponent makes no difference", nominal=1e-6,
        bounds=(1e-12, 1.0), fixed=True,
    )  # fmt: skip

    spread = Parameter(
        "1", "ratio of the displacements at which the elements yield", nominal=_SPREAD,
        bounds=(1.0, 1e4), typical=(3.0, 100.0), when="distributed",
    )  # fmt: skip

    @property
    def elements(self) -> int:
        """Number of elements in parallel."""
        return _ELEMENTS if self.distributed else 1

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """Distributed, about the displacement at which the one element yields."""
        if self.distributed:
            return self, {}
        return replace(self, distributed=True), {"beta": own["beta"] / _SPREAD**0.5}

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """Friction with presliding, opening and closing at the same stiffnesses.

            alpha = F / z0,   beta = 1 / z0,   gamma = 2^(n - 1),   delta = 1 - gamma

        Dahl's, with n = 1, is this law; with another exponent force and slope are the same at a
        reversal, at zero and at the end.
        """
        if other != "friction" or "z0" not in own:
            return None
        gamma = 2.0 ** (own["n"] - 1.0)
        return {
            "alpha": own["F"] / own["z0"], "beta": 1.0 / own["z0"], "gamma": gamma,
            "delta": 1.0 - gamma,
        }  # fmt: skip

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """Own share of the acceleration and the hysteretic part of the position."""
        w, size = chain.position.rate, abs_(x.z)
        beta = p.beta
        if self.distributed:
            shares = [i / (_ELEMENTS - 1.0) for i in range(_ELEMENTS)]
            beta = stack([beta * power_(p.spread, share) for share in shares])
        shape = beta * power_(size / p.z_s, p.n - 1.0)
        rate = w - shape * (p.gamma * abs_(w) * x.z + p.delta * w * size)
        return Equations(gives=-p.alpha * sum_(x.z) / self.elements, moves={"z": rate})
