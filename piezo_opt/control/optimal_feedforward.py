"""The drive that makes an identified actuator follow a reference, without a sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.control.closed_loop import Limits
from piezo_opt.control.horizon import Along, Horizon
from piezo_opt.control.identified import Source
from piezo_opt.control.qp import FAR, HorizonProgram, solve_program
from piezo_opt.control.task import task
from piezo_opt.errors import InputError
from piezo_opt.signals import Drive
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

FINER: Final = 4
"""Times as many steps as a controller takes, which is corrected by its sensor: a drive that nothing
corrects errs by what the steps err."""
_MOST: Final = 200
"""Linearisations at most: 5 where no limit matters, some 120 where reversals move along limits."""
_ENOUGH: Final = 1e-6
"""Fall of the cost, as a share, that a step must promise."""


@final
@dataclass(frozen=True, eq=False)
class Feedforward:
    """A drive, and what the model says of it.

    Attributes:
        time: (N,) [s].
        reference, predicted: (N,) [m].
        drive: (N,) [V]; each value is held from its instant to the next one.
        period: [s].
        limits: of the drive.
        iterations: linearisations and programs.
        converged: whether no step promised anything at the end.
        interrupted: whether Ctrl-C or a limit of time ended the search.
    """

    time: FloatArray
    reference: FloatArray
    predicted: FloatArray
    drive: FloatArray
    period: float
    limits: Limits
    iterations: int
    converged: bool
    interrupted: bool = False

    @property
    def error(self) -> FloatArray:
        """(N,) reference minus prediction [m]."""
        return self.reference - self.predicted

    @property
    def rms(self) -> float:
        """Root mean square of the predicted error [m]."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def largest(self) -> float:
        """Largest predicted error [m]."""
        return float(np.abs(self.error).max())

    def to_drive(self) -> Drive:
        """To play or to write: ``.to_drive().write("drive.csv")``."""
        return Drive(
            "feedforward", f"follows a reference to {show(self.rms, 'm')} rms, by the model",
            self.drive, 1.0 / self.period, steps=True,
        )  # fmt: skip

    def __str__(self) -> str:
        slew = float(np.abs(np.diff(self.drive)).max(initial=0.0)) / self.period
        lines = [
            f"feedforward of {self.drive.size} samples every {show(self.period, 's')}: the model "
            f"errs by {show(self.rms, 'm')} rms, {show(self.largest, 'm')} at most",
            f"drive within {self.limits.told()}; {self.drive.min():.4g} to {self.drive.max():.4g} "
            f"V, {show(slew, 'V/s')} at most used; {self.iterations} iterations",
        ]
        if not self.converged:
            lines.append("The search ended before it had converged: this is the best so far.")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        return {
            "schema": "piezo_opt/feedforward/1",
            "period": self.period,
            "limits": self.limits.to_dict(),
            "rms": self.rms,
            "largest": self.largest,
            "iterations": self.iterations,
            "converged": self.converged,
            "interrupted": self.interrupted,
            "drive": self.drive.tolist(),
            "reference": self.reference.tolist(),
            "predicted": self.predicted.tolist(),
        }


def optimal_feedforward(
    plant: Source,
    reference: ArrayLike,
    *,
    period: float | str | None = None,
    values: Mapping[str, float] | None = None,
    limits: Limits | None = None,
    effort: float = 1e-7,
    progress: Callable[[str], None] | None = None,
) -> Feedforward:
    """Invert a model as a nonlinear program over the moves w of the drive.

        min  sum ((y_k - r_k) / Y)^2 + effort (w_k / U)^2,   u_k = u_(k-1) + w_k
        with  u and w within the drive's range and slew rate

    by a Gauss-Newton method in a box of trust: the model is linearised along the moves, exactly,
    with its loop, creep and every mode, and one quadratic program over the whole reference gives
    the step. Y is the reference's span and U the drive that takes it. Ctrl-C gives the best so far.

    Args:
        plant: a fit, the JSON of one, or a model with ``values``. The drive comes as much earlier
            as a delay of the model in whole periods asks, as far as there is time.
        reference: (N,) [m], one value a period; it begins where the actuator rests.
        period: of the drive [s]; that of the record unless given.
        values: SI values by full name, which go before those of the plant.
        limits: of the drive.
        effort: weight of the moves; it also smooths what the drive's period does not resolve.
        progress: told how it goes.

    Raises:
        InputError: a reference that is none or that the limits do not reach.

    Source: Nocedal & Wright (2006), Numerical Optimization, 2nd ed., ch. 10 and sec. 18.5.
    """
    what = task(plant, reference, period=period, values=values, limits=limits)
    if len(what.asked.references) != 1:
        raise InputError("reference: give one; a drive follows one.")
    if not effort > 0.0:
        raise InputError(f"effort = {effort}: give a positive weight, 1e-7")
    asked, goals = what.asked, what.asked.references[0]
    model = Horizon(what.plant.model, what.plant.numbers, asked.period, FINER)
    begin = min(max(0.0, asked.limits.low), asked.limits.high)
    x = model.rest(begin)
    still = model.reading(0.0, x, begin)
    gain = abs(model.reading(0.0, model.rest(begin + 1.0), begin + 1.0) - still)
    span = float(np.ptp(goals)) or float(np.abs(goals).max())
    if not span > 0.0 or not gain > 0.0:
        raise InputError(
            "The reference asks for nothing, or the position does not follow the drive."
        )
    late = asked.delay
    wanted = goals[1 + late :]
    search = _Search(model, x, begin, wanted, span, span / gain, effort, asked.limits)
    interrupted = search.run(progress)
    w = search.w
    predicted = np.concatenate([np.full(1 + late, still), search.now.reading])
    # Sums of moves end at the limits but for their last digit.
    moved = np.clip(begin + np.cumsum(w), asked.limits.low, asked.limits.high)
    drive = np.append(moved, np.full(1 + late, moved[-1]))
    return Feedforward(
        asked.period * np.arange(goals.size, dtype=float), goals, predicted, drive, asked.period,
        asked.limits, search.count, search.converged, interrupted,
    )  # fmt: skip


@final
class _Search:
    """Moves, and the model along them."""

    def __init__(
        self, model: Horizon, x: FloatArray, begin: float, wanted: FloatArray, span: float,
        volts: float, effort: float, limits: Limits,
    ) -> None:  # fmt: skip
        self._model, self._x, self._begin = model, x, begin
        self._wanted, self._volts = wanted, volts
        self._weight, self._price = 1.0 / span**2, effort / volts**2
        far = min(limits.slew * model.period, FAR)
        self._ends = (-far, far, max(limits.low, -FAR), min(limits.high, FAR))
        # What the gain alone would ask for, within the limits.
        w, drive = np.empty(wanted.size), begin
        offset = model.reading(0.0, x, begin)
        for k, goal in enumerate(wanted.tolist()):
            ask = begin + (goal - offset) * volts / span
            after = float(np.clip(ask, max(limits.low, drive - far), min(limits.high, drive + far)))
            w[k], drive = after - drive, after
        self.w = w
        self.now = self._along(w)
        self.count, self.converged = 0, False

    def _along(self, w: FloatArray) -> Along:
        return self._model.along(0.0, self._x, self._begin, w)

    def _cost(self, w: FloatArray, reading: FloatArray) -> float:
        off = reading - self._wanted
        return 0.5 * float(self._weight * off @ off + self._price * w @ w)

    def run(self, progress: Callable[[str], None] | None) -> bool:
        """Better the moves until it converges; whether Ctrl-C ended that before."""
        try:
            self._run(progress)
        except KeyboardInterrupt:
            return True
        return False

    def _run(self, progress: Callable[[str], None] | None) -> None:
        cost, box = self._cost(self.w, self.now.reading), self._volts
        for self.count in range(1, _MOST + 1):
            step = self._step(box)
            # What the linearisation promises.
            ahead = self._cost(self.w + step, self._linear(step))
            promised = cost - ahead
            if promised <= _ENOUGH * cost:
                self.converged = True
                return
            trial = self._along(self.w + step)
            gained = cost - self._cost(self.w + step, trial.reading)
            size = float(np.abs(step).max())
            if gained > 0.75 * promised:
                box = max(box, 2.0 * size)
            elif not gained > 0.25 * promised:
                box = 0.3 * size
            if gained > 1e-4 * promised:
                self.w, self.now, cost = self.w + step, trial, cost - gained
            if progress is not None:
                error = float(np.sqrt(np.mean((self.now.reading - self._wanted) ** 2)))
                progress(f"iteration {self.count}, error {show(error, 'm')} rms")

    def _step(self, box: float) -> FloatArray:
        """The change of the moves by one quadratic program, none of them larger than the box."""
        n, low, high = self.w.size, *self._ends[:2]
        drive = self._begin + np.cumsum(self.w)
        limits = np.empty((n, 6))
        limits[:, 0], limits[:, 1] = np.maximum(low - self.w, -box), np.minimum(high - self.w, box)
        limits[:, 2], limits[:, 3] = self._ends[2] - drive, self._ends[3] - drive
        limits[:, 4], limits[:, 5] = -FAR, FAR
        # A move at its limit leaves no room on one side.
        room = 1e-9 * self._volts
        limits[:, ::2] = np.minimum(limits[:, ::2], -room)
        limits[:, 1::2] = np.maximum(limits[:, 1::2], room)
        program = HorizonProgram(
            self.now.a, self.now.b, self.now.c, self._wanted - self.now.reading,
            np.full(n, self._weight), self._price * self.w, self._price, np.clip(limits, -FAR, FAR),
        )  # fmt: skip
        return solve_program(program).w

    def _linear(self, step: FloatArray) -> FloatArray:
        """Readings that the linearisation expects."""
        z, made = np.zeros(self.now.b.shape[1]), self.now.reading.copy()
        for k in range(step.size):
            z = self.now.a[k] @ z + self.now.b[k] * step[k]
            made[k] += self.now.c[k] @ z
        return made
