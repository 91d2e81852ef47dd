"""The charge that motion drives back through the amplifier's output resistance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State


@final
@dataclass(frozen=True)
class ChargeBackCoupling(Effect):
    """Drive lost over a series resistance to the charge that the motion generates.

        tau z' = x' - z,   tau = R C
        v = u - kappa z,   kappa = R T

    With R i = u - v and i = C v' + T x' the drive is the lagged command (amplifier_lag) less
    kappa times the lagged velocity, which is the part written here. kappa has the sign of the
    gain d when it takes energy out of the motion.

    References: Goldfarb & Celanovic (1997), IEEE Control Systems 17(3) (charge q = C v + T x of
    a stack); Preumont (2011), Vibration Control of Active Structures, 3rd ed. (transducers).
    """

    place = Place.INPUT
    requires = ("motion",)
    z = State("m/s", "velocity as the capacitance sees it")
    kappa = Parameter(
        "V*s/m", "voltage lost per velocity, R T", nominal=0.0, bounds=(-1e8, 1e8),
        typical=(10.0, 1e3), null=0.0,
    )  # fmt: skip
    tau = Parameter(
        "s", "time constant R C", nominal=1e-4, bounds=(1e-7, 0.1), typical=(1e-5, 1e-2)
    )

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive and the lagged velocity."""
        return Equations(
            gives=chain.incoming.value - p.kappa * x.z,
            moves={"z": (chain.position.rate - x.z) / p.tau},
        )
