"""Inverse compensation: the drive that a hysteretic actuator needs, without an inverse model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import copysign, exp, isfinite, log1p
from typing import final

from piezo_opt.effects import BoucWen, Model, PiezoGain
from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification import Fit

ROUNDS = 60
"""Steps of the fixed point at most: each shrinks the error by h'/d_e, below one half, so that sixty
reach the last digit."""


@final
@dataclass(frozen=True)
class InverseState:
    """The drive [V] and the hysteretic displacement [m] that go with it."""

    drive: float
    loop: float = 0.0


@final
@dataclass(frozen=True)
class InverseCompensation:
    """The multiplicative-inverse structure of a Bouc-Wen actuator.

        u = (r + h) / d_e,   h' = alpha u' - beta |u'| h - gamma u' |h|

    h at the new drive is found with it, by repetition, and h moves along a monotone drive by its
    closed form. No reading is used.

    Args:
        gain: d_e [m/V].
        alpha: [m/V]; beta, gamma: [1/V].

    Raises:
        InputError: no gain, or a loop as steep as the gain (alpha >= d_e), which has no inverse.

    Source: Rakotondrabe (2011), IEEE Trans. Autom. Sci. Eng. 8(2), 428-431.
    """

    gain: float
    alpha: float
    beta: float
    gamma: float

    def __post_init__(self) -> None:
        if self.gain == 0.0 or abs(self.alpha) >= abs(self.gain):
            raise InputError(
                f"gain = {self.gain} m/V, alpha = {self.alpha} m/V: the loop must be less steep "
                "than the gain, else the drive cannot be found from the position."
            )

    @staticmethod
    def of(fit: Fit) -> InverseCompensation:
        """The compensator of a fitted gain and Bouc-Wen loop with the exponent 1.

        Raises:
            ModelError: the model has none, or another exponent.
        """
        return InverseCompensation.of_values(fit.model, fit.values)

    @staticmethod
    def of_values(model: Model, values: Mapping[str, float]) -> InverseCompensation:
        """The same of a model with values by full name."""
        numbers = values
        names = {type(e): n for n, e in model}
        if PiezoGain not in names or BoucWen not in names:
            raise ModelError("Inverse compensation takes a model with piezo_gain and bouc_wen.")
        g, b = names[PiezoGain], names[BoucWen]
        if numbers.get(f"{b}.n", 1.0) != 1.0:
            raise ModelError(f"Inverse compensation takes {b}.n = 1: fit the loop with it fixed.")
        return InverseCompensation(
            numbers[f"{g}.d"], numbers[f"{b}.alpha"], numbers[f"{b}.beta"], numbers[f"{b}.gamma"]
        )

    def begin(self) -> InverseState:
        """At rest, without a drive."""
        return InverseState(0.0)

    def act(
        self, state: InverseState, reference: float, reading: float, period: float,
        low: float, high: float,
    ) -> tuple[float, InverseState]:  # fmt: skip
        """The drive [V] for a reference [m]; neither reading nor period is used."""
        drive = state.drive
        for _ in range(ROUNDS):
            again = (reference + self.loop_at(state, drive)) / self.gain
            if again == drive:
                break
            drive = again
        # A reference that is no number has no drive: it is held.
        drive = min(max(drive if isfinite(drive) else state.drive, low), high)
        return drive, InverseState(drive, self.loop_at(state, drive))

    def loop_at(self, state: InverseState, drive: float) -> float:
        """h [m] after a monotone move of the drive, by its closed form on either side of h = 0.

        dh/du = alpha - (beta s + gamma sign h) h,   s = sign u'
        """
        left, h = drive - state.drive, state.loop
        way = copysign(1.0, left)
        for _ in range(2):
            side = copysign(1.0, h) if h != 0.0 else copysign(1.0, self.alpha * left)
            rate = self.beta * way + self.gamma * side
            end = _relaxed(h, self.alpha, rate, left)
            if end * side >= 0.0:
                return end
            # It crosses zero on the way, where the slope of the law changes.
            used = _until_zero(h, self.alpha, rate)
            left, h = left - used, 0.0
        return end


def _relaxed(h: float, alpha: float, rate: float, length: float) -> float:
    """h after dh/du = alpha - rate h over a length [V]."""
    if abs(rate * length) < 1e-12:
        return h + (alpha - rate * h) * length
    fixed = alpha / rate
    return fixed + (h - fixed) * exp(-rate * length)


def _until_zero(h: float, alpha: float, rate: float) -> float:
    """Length [V] after which h = 0."""
    return -h / alpha if rate == 0.0 else log1p(-rate * h / alpha) / rate
