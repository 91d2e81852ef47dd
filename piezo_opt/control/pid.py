"""PID control with a filtered derivative and an integral that does not wind up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

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

        u = Kp e + I + Kd s + feedforward,   I += Ki T e,   s' = (e' - s) / tau

    The integral is taken by the trapezoidal rule, the filter by the backward difference. Where the
    drive is limited the integral stands still while it would push further out (conditional
    integration).

    Args:
        kp: [V/m], ki: [V/(m s)], kd: [V s/m].
        tau: time constant of the derivative's filter [s].

    Raises:
        InputError: a gain or time that is negative or no number.

    Source: Astrom & Hagglund (2006), Advanced PID Control, chs. 2, 3 and 13.
    """

    kp: float
    ki: float = 0.0
    kd: float = 0.0
    tau: float = 0.0

    def __post_init__(self) -> None:
        for name in ("kp", "ki", "kd", "tau"):
            value = getattr(self, name)
            if not (0.0 <= value < float("inf")):
                raise InputError(f"{name} = {value}: a PID takes numbers from 0 on")

    def begin(self) -> PIDState:
        """Nothing remembered."""
        return PIDState()

    def act(
        self, state: PIDState, reference: float, reading: float, period: float,
        low: float, high: float,
    ) -> tuple[float, PIDState]:  # fmt: skip
        """The drive [V] within its limits, and what is remembered for the next sample."""
        error = reference - reading
        last = error if state.error is None else state.error
        slope = (self.tau * state.slope + (error - last)) / (self.tau + period)
        integral = state.integral + self.ki * period * (error + last) / 2.0
        wanted = self.kp * error + integral + self.kd * slope
        drive = min(max(wanted, low), high)
        outward = (wanted - drive) * (integral - state.integral) > 0.0
        return drive, PIDState(state.integral if outward else integral, slope, error)
