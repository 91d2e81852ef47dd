"""The charge that motion drives back through the amplifier's output resistance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, final

from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place, State
from piezo_opt.effects.lags import DAMPING, lagging, with_second_pole


@final
@dataclass(frozen=True)
class ChargeBackCoupling(Effect):
    """Drive lost over a series resistance to the charge that the motion generates.

        tau z_1' = x' - z_1,   tau = R C
        tau z_1' = z_2,   tau z_2' = x' - z_1 - 2 zeta z_2   two poles
        v = u - kappa z_1,   kappa = R T
        tau w' = u - w - tau back x',   v = u + share (w - u),   back = T / C   whole

    The second pole is the amplifier's own. With R i = u - v and
    i = C v' + T x' the drive is the lagged command (amplifier_lag) less kappa times the lagged
    velocity, which is the part written first. The whole port, entered through a share, holds the
    lag as well; it gives no energy to the motion, so that back has the sign of the gain d, as kappa
    has when it takes energy out.

    References: Goldfarb & Celanovic (1997), IEEE Control Systems 17(3) (charge q = C v + T x of
    a stack); Preumont (2011), Vibration Control of Active Structures, 3rd ed. (transducers).
    """

    poles: int = 1
    whole: bool = False
    place = Place.INPUT
    requires = ("motion",)
    variants = ({"whole": False}, {"whole": True})
    reshaped = ("whole",)
    z = State(
        "m/s", "velocity as the capacitance sees it, and tau times its rate", size="poles",
        remanent=True, unless="whole",
    )  # fmt: skip
    w = State("V", "voltage of the actuator's capacitance", trailing=True, when="whole")
    kappa = Parameter(
        "V*s/m", "voltage lost per velocity, R T", nominal=0.0, bounds=(-1e8, 1e8),
        typical=(10.0, 1e3), null=0.0, unless="whole",
    )  # fmt: skip
    share = Parameter(
        "1", "share of the drive that passes the port", nominal=0.0, bounds=(0.0, 1.0),
        typical=(0.2, 1.0), null=0.0, when="whole",
    )  # fmt: skip
    back = Parameter(
        "V/m", "voltage that the motion generates, T / C", nominal=1e6, bounds=(0.0, 1e12),
        typical=(1e5, 1e7), when="whole",
    )  # fmt: skip
    tau = Parameter(
        "s", "time constant R C", nominal=1e-4, bounds=(1e-7, 0.1), typical=(1e-5, 1e-2)
    )

    zeta = replace(DAMPING, unless="whole")

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """The whole port is an amplifier's lag to which nothing comes back; where the lag is short,
        the voltage lost to the velocity is the port's: back = kappa / tau."""
        if self.whole and other == "amplifier_lag":
            return {"share": own["share"], "tau": own["tau"], "back": 0.0}
        if self.whole and other == self.name and "kappa" in own:
            back = max(own["kappa"] / own["tau"], 0.0)
            return {"share": 1.0, "tau": own["tau"], "back": back}
        return None

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """With the second pole."""
        return (self, {}) if self.whole else with_second_pole(self, own)

    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The outgoing drive, and the lagged velocity or the port's voltage."""
        u = chain.incoming.value
        if self.whole:
            charged = (u - x.w) / p.tau - p.back * chain.position.rate
            return Equations(
                gives=u + p.share * (x.w - u), moves={"w": charged}, starts={"w": u}
            )  # fmt: skip
        return Equations(
            gives=u - p.kappa * x.z[0],
            moves={"z": lagging(self, x.z, chain.position.rate, p)},
        )
