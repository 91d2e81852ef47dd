"""PID control with a filtered derivative and an integral that does not wind up."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any, ClassVar, Final, final

import casadi as ca
import control
import numpy as np

from piezo_opt.choosing import real
from piezo_opt.errors import InputError


@final
@dataclass(frozen=True)
class PIDState:
    """What a PID remembers: its integral [V], the filtered derivative [m/s], the last error [m]."""

    integral: float = 0.0
    slope: float = 0.0
    error: float | None = None


@final
@dataclass(frozen=True)
class PID:
    """Discrete PID of the error e = r - y.

        u = Kp e + I + Kd s,   I += Ki T e,   s' = (e' - s) / tau

    The integral is taken by the trapezoidal rule, the filter by the backward difference. Where the
    drive is limited the integral gives back what the drive could not follow, but no more than it
    has just gained (conditional integration without a jump).

    Args:
        kp: [V/m], ki: [V/(m s)], kd: [V s/m].
        tau: time constant of the derivative's filter [s].
        largest: error beyond which it is cut [m]: more is a fault of the sensor, which the integral
            would remember.

    A reference or reading that is no number, or leads to none, is passed over: the error stays what
    it was, and nothing is integrated.

    Raises:
        InputError: a gain or time that is negative or no number.

    Source: Astrom & Hagglund (2006), Advanced PID Control, chs. 2, 3 and 13.
    """

    kind: ClassVar[str] = "pid"

    kp: float
    ki: float = 0.0
    kd: float = 0.0
    tau: float = 0.0
    largest: float = float("inf")

    def __post_init__(self) -> None:
        for name in ("kp", "ki", "kd", "tau"):
            value = getattr(self, name)
            real(value, name)
            if not (0.0 <= value < float("inf")):
                raise InputError(f"{name} = {value}: a PID takes numbers from 0 on")
        if not self.largest > 0.0:
            raise InputError(f"largest = {self.largest} m: give a positive error")

    def begin(self) -> PIDState:
        """Nothing remembered."""
        return PIDState()

    def act(
        self, state: PIDState, reference: float, reading: float, period: float,
        low: float, high: float,
    ) -> tuple[float, PIDState]:  # fmt: skip
        """The drive [V] within its limits, and what is remembered for the next sample."""
        error = reference - reading
        if isfinite(error):
            error = min(max(error, -self.largest), self.largest)
        last = error if state.error is None else state.error
        slope = (self.tau * state.slope + (error - last)) / (self.tau + period)
        gained = self.ki * period * (error + last) / 2.0
        wanted = self.kp * error + (state.integral + gained) + self.kd * slope
        if not isfinite(wanted):
            kept = self.kp * (state.error or 0.0) + state.integral + self.kd * state.slope
            return min(max(kept, low), high), state
        drive = min(max(wanted, low), high)
        back = min(max(wanted - drive, min(gained, 0.0)), max(gained, 0.0))
        return drive, PIDState(state.integral + gained - back, slope, error)

    def told(self) -> str:
        """The law and its gains."""
        return (
            "PID, u = kp e + ki int e + kd de/dt with e filtered over tau:\n"
            f"kp {self.kp:.5g} V/m, ki {self.ki:.5g} V/(m s), kd {self.kd:.5g} V s/m, tau "
            f"{self.tau:.3g} s"
        )

    def to_dict(self) -> dict[str, Any]:
        """Gains, SI units."""
        return {"kind": self.kind, **asdict(self)}

    def transfer_function(self, period: float) -> control.TransferFunction:
        """From the error to the drive, sampled at a period [s], away from the limits."""
        t, hold = period, self.tau + period
        # In z^-1: Kp + Ki T/2 (1 + z^-1)/(1 - z^-1) + Kd (1 - z^-1)/(tau + T - tau z^-1)
        one, lag = np.array([1.0, -1.0]), np.array([hold, -self.tau])
        top = (
            self.kp * np.convolve(one, lag)
            + self.ki * t / 2.0 * np.convolve([1.0, 1.0], lag)
            + self.kd * np.convolve(one, one)
        )
        return control.tf(top, np.convolve(one, lag), period)


@final
class PIDLaw:
    """The same law in the symbols of a program: gains kp, ki, kd, tau."""

    gains: Final = ("kp", "ki", "kd", "tau")
    memory: Final = 4
    recipe: Final = "pid, conditional integration without a jump"

    def act(
        self, memory: ca.SX, reference: ca.SX, reading: ca.SX, period: ca.SX, low: ca.SX,
        high: ca.SX, gains: ca.SX,
    ) -> tuple[ca.SX, ca.SX]:  # fmt: skip
        """The drive and the next memory: integral, slope, error, whether there was one."""
        kp, ki, kd, tau = ca.vertsplit(gains)
        integral, slope, last, begun = ca.vertsplit(memory)
        error = reference - reading
        last = ca.if_else(begun > 0.0, last, error)
        slope = (tau * slope + (error - last)) / (tau + period)
        gained = ki * period * (error + last) / 2.0
        wanted = kp * error + (integral + gained) + kd * slope
        drive = ca.fmin(ca.fmax(wanted, low), high)
        back = ca.fmin(ca.fmax(wanted - drive, ca.fmin(gained, 0.0)), ca.fmax(gained, 0.0))
        return drive, ca.vertcat(integral + gained - back, slope, error, 1.0)
