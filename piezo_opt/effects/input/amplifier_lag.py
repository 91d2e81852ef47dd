"""The amplifier charging the actuator's capacitance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.effects.lags import DAMPING, lagging, like_a_lag, with_second_pole
from piezo_opt.symbolic import stack


@final
@dataclass(frozen=True)
class AmplifierLag(Effect):
    """Lag of amplifier and actuator capacitance, of first or second order, entered through a share.

        tau z_1' = u - z_1
        tau z_1' = z_2,   tau z_2' = u - z_1 - 2 zeta z_2   two poles
        v = u + share (z_1 - u)

    The share is regular at 0 (no lag) and a pure lag at 1; tau = R C.

    References: Fleming & Leang (2014), Design, Modeling and Control of Nanopositioning
    Systems, ch. 14 (electrical drive of capacitive loads).
    """

    poles: int = 1
    place = Place.INPUT
    z = State("V", "lagged drive, and tau times its rate", size="poles", trailing=True)
    share = Parameter(
        "1", "share of the drive that lags", nominal=0.0, bounds=(0.0, 1.0), typical=(0.2, 1.0),
        null=0.0,
    )  # fmt: skip
    tau = Parameter(
        "s", "time constant R C", nominal=1e-3, bounds=(1e-7, 0.1), typical=(1e-4, 1e-2)
    )
    zeta = DAMPING

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """A short delay is a lag of that time constant; a lag elsewhere is as long here, and
        mechanics that do not ring are one."""
        return like_a_lag(self, other, own)

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """With the second pole."""
        return with_second_pole(self, own)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive and the lagged states."""
        u = chain.incoming.value
        return Equations(
            gives=u + p.share * (x.z[0] - u),
            moves={"z": lagging(self, x.z, u, p)},
            starts={"z": stack([u, 0.0][: self.poles])},
        )
