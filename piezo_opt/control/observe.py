"""An extended Kalman filter on the identified, hysteretic model: only displacement is measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.horizon import Horizon
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.simulation.composed import address

FloatArray = NDArray[np.float64]

PATIENCE: Final = 10
"""Readings in a row that may be further off than the gate: a broken sensor shouts for less, or says
the same again and again, and then nothing helps."""


@final
@dataclass(frozen=True, eq=False)
class Estimate:
    """What is known at an instant.

    Attributes:
        time: [s].
        states: (n + 1,) the model's states, and a disturbance of the reading [m].
        covariance: (n + 1, n + 1).
        before, drive: drives held in the period that ended and in the one before it [V].
        used: whether the last reading was one.
        off: how many readings in a row were numbers and further off than the gate.
    """

    time: float
    states: FloatArray
    covariance: FloatArray
    before: float
    drive: float
    used: bool = True
    off: int = 0


@final
class Observer:
    """States of hysteresis, creep and mechanics, and a disturbance, from readings and drives.

        x' = f(x, u),  d' = 0,  y = g(x, u) + d,   linearised at every sample

    The drive is uncertain by ``drive_noise``, the disturbance walks by ``drift`` a period, the
    reading has white noise. A reading that is no number, or further off than ``gate``, is a sample
    of no weight: the estimate goes on by the model alone. Where readings stay off for
    :data:`PATIENCE` samples it is the estimate that is wrong: the next one is taken, and the
    disturbance may be as far off as the gate.

    Args:
        plant: a fit, or a model with ``values``.
        values: SI values by full name.
        period: of the sampling [s].
        noise: standard deviation of the reading [m].
        drive_noise: of the drive [V].
        drift: of the disturbance's step in a period [m]; a tenth of the noise unless given.
        gate: distance from what is expected beyond which a reading is none [m].

    Attributes:
        noises: (4,) of the drive [V], of the disturbance, of the reading, and the gate [m].

    Raises:
        InputError: noises that are not positive.

    Source: Anderson & Moore (1979), Optimal Filtering, ch. 8.
    """

    def __init__(
        self, plant: Fit | Model, values: Mapping[str, float] | None = None, *, period: float,
        noise: float, drive_noise: float = 0.1, drift: float | None = None,
        gate: float = float("inf"),
    ) -> None:  # fmt: skip
        walk = 0.1 * noise if drift is None else drift
        if not (noise > 0.0 and drive_noise >= 0.0 and walk >= 0.0 and gate > 0.0):
            raise InputError(
                f"noise = {noise} m, drive_noise = {drive_noise} V, drift = {walk} m, gate = "
                f"{gate} m: the noise and the gate are positive, the others not negative"
            )
        self.horizon = Horizon(plant, values, period)
        self.noises = np.array([drive_noise, walk, noise, min(gate, 1e300)])

    def begin(self, drive: float = 0.0, uncertainty: float | None = None) -> Estimate:
        """At rest at a drive [V]; the disturbance may be anywhere within ``uncertainty`` [m].

        Without one it is a thousand noises: the first readings tell it.
        """
        states = np.append(self.horizon.rest(drive), 0.0)
        spread = np.zeros((states.size, states.size))
        spread[-1, -1] = (1e3 * self.noises[2] if uncertainty is None else uncertainty) ** 2
        return Estimate(0.0, states, spread, drive, drive)

    def first(self, estimate: Estimate, reading: float) -> Estimate:
        """With a reading at the very instant of the estimate."""
        x, p, used = estimate.states.copy(), estimate.covariance.copy(), np.zeros(1)
        h = self.horizon
        h.library.po_correct(
            address(h.p), estimate.time, estimate.drive, reading,
            *map(address, (self.noises, x, p, used)),
        )  # fmt: skip
        return replace(estimate, states=x, covariance=p, used=bool(used[0]))

    def after(self, estimate: Estimate, drive: float, reading: float) -> Estimate:
        """One period later: the drive [V] that was held in it, and the reading [m] at its end."""
        x, p, used = estimate.states.copy(), estimate.covariance.copy(), np.zeros(1)
        h, time, noises = self.horizon, estimate.time + self.horizon.period, self.noises
        if estimate.off >= PATIENCE:
            p[-1, -1] += noises[3] ** 2
            noises = np.array([*noises[:3], 1e300])
        h.library.po_filter(
            address(h.p), time, h.period, estimate.drive, drive, h.steps.rise, h.steps.held,
            reading, *map(address, (noises, x, p, used)),
        )  # fmt: skip
        if used[0] < 0.0:
            # What is known leads to what is no number: begin anew at rest.
            lost = replace(self.begin(drive), time=time, before=estimate.drive)
            return self.first(lost, reading)
        taken = bool(used[0])
        off = 0 if taken else estimate.off + isfinite(reading)
        return Estimate(time, x, p, estimate.drive, drive, taken, off)
