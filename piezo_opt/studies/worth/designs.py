"""Controllers as a user designs them on a fit, by one call each, and their loops on a plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, final

from piezo_opt.control import (
    MPC,
    InverseCompensation,
    Limits,
    identified,
    optimal_feedforward,
    tune_lqr,
    tune_mpc,
    tune_pid,
)
from piezo_opt.effects import BoucWen, PiezoGain, SecondOrder
from piezo_opt.errors import ModelError
from piezo_opt.identification import Fit
from piezo_opt.measurement import FloatArray

HORIZON: Final = 20
"""Periods that the MPC looks ahead: more than one of the slowest resonance."""
_TUNED_ON: Final = 200
"""Samples of the reference on which weight and filter of the MPC are searched: 25 loops of it."""


@final
@dataclass(frozen=True, eq=False)
class Wanted:
    """What is to be followed: reference (N,) [m] from rest at 0, period [s], limits, noise [m]."""

    reference: FloatArray
    period: float
    limits: Limits
    noise: float

    def noise_for(self, fit: Fit) -> float:
        """What a design takes for noise: all that its model leaves of the record [m]."""
        return max(fit.rms, self.noise)


@final
@dataclass(frozen=True, eq=False)
class Played:
    """A drive that was computed before, as a controller that looks at nothing."""

    drive: FloatArray

    def begin(self) -> int:
        """At the first sample."""
        return 0

    def act(
        self, state: int, reference: float, reading: float, period: float, low: float, high: float
    ) -> tuple[float, int]:
        """The next drive [V]."""
        return float(self.drive[state]), state + 1


def _pid(fit: Fit, wanted: Wanted) -> Any:
    return tune_pid(
        fit, wanted.reference, period=wanted.period, limits=wanted.limits,
        noise=wanted.noise_for(fit),
    ).controller  # fmt: skip


def _lqr(fit: Fit, wanted: Wanted) -> Any:
    return tune_lqr(
        fit, wanted.reference, period=wanted.period, limits=wanted.limits,
        noise=wanted.noise_for(fit),
    ).controller  # fmt: skip


def _inverse(fit: Fit, _: Wanted) -> Any:
    beyond = [
        name for name, effect in fit.model if type(effect) not in (PiezoGain, BoucWen, SecondOrder)
    ]
    if beyond:
        raise ModelError(f"The inverse compensation has no {', '.join(beyond)}.")
    return InverseCompensation.of(fit)


def _feedforward(fit: Fit, wanted: Wanted) -> Any:
    found = optimal_feedforward(fit, wanted.reference, period=wanted.period, limits=wanted.limits)
    return Played(found.drive)


def _mpc(fit: Fit, wanted: Wanted) -> Any:
    """Weight and filter from the beginning of the reference, then the same with all of it."""
    found = tune_mpc(
        fit, wanted.reference[:_TUNED_ON], period=wanted.period, limits=wanted.limits,
        noise=wanted.noise_for(fit), horizon=HORIZON,
    )  # fmt: skip
    actuator = identified(fit)
    return MPC(
        actuator.model, actuator.numbers, period=wanted.period, span=found.controller.span,
        horizon=HORIZON, limits=wanted.limits, weight=found.weight, noise=found.noise,
        drive_noise=found.drive_noise, gate=found.gate, reference=wanted.reference,
    )  # fmt: skip


DESIGNS: Final[Mapping[str, Callable[[Fit, Wanted], Any]]] = MappingProxyType(
    {"PID": _pid, "LQR": _lqr, "inverse": _inverse, "feedforward": _feedforward, "MPC": _mpc}
)
CONTROLLERS: Final = tuple(DESIGNS)
"""Names of the controllers that are compared."""
