"""The charge that motion drives back through the amplifier's output resistance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.effects.series_lag import RATIO, lag_rates, time_constants, with_second_pole


@final
@dataclass(frozen=True)
class ChargeBackCoupling(Effect):
    """Drive lost over a series resistance to the charge that the motion generates.

        tau z_1' = x' - z_1,   ratio tau z_2' = z_1 - z_2,   tau = R C
        v = u - kappa z,   kappa = R T

    z is z_1, or z_2 with poles = 2 (the amplifier's own output pole). With R i = u - v and
    i = C v' + T x' the drive is the lagged command (amplifier_lag) less kappa times the lagged
    velocity, which is the part written here. kappa has the sign of the gain d when it takes
    energy out of the motion.

    References: Goldfarb & Celanovic (1997), IEEE Control Systems 17(3) (charge q = C v + T x of
    a stack); Preumont (2011), Vibration Control of Active Structures, 3rd ed. (transducers).
    """

    poles: int = 1
    place = Place.INPUT
    requires = ("motion",)
    z = State(
        "m/s", "velocity as the capacitance sees it, pole by pole", size="poles", remanent=True
    )
    kappa = Parameter(
        "V*s/m", "voltage lost per velocity, R T", nominal=0.0, bounds=(-1e8, 1e8),
        typical=(10.0, 1e3), null=0.0,
    )  # fmt: skip
    tau = Parameter(
        "s", "time constant R C", nominal=1e-4, bounds=(1e-7, 0.1), typical=(1e-5, 1e-2)
    )

    ratio = RATIO

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """With the second pole."""
        return with_second_pole(self, own)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive and the lagged velocity."""
        taus = time_constants(self, p)
        return Equations(
            gives=chain.incoming.value - p.kappa * x.z[self.poles - 1],
            moves={"z": lag_rates(x.z, chain.position.rate, taus)},
        )
