"""The closed loop: any controller around any plant, sampled, limited, late and noisy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.choosing import real, whole, words
from piezo_opt.control.plant import Plant
from piezo_opt.errors import InputError
from piezo_opt.units import show

FloatArray = NDArray[np.float64]


class Controller(Protocol):
    """What computes a drive from reference and reading; its state is handed in and out."""

    def begin(self) -> Any:
        """The state before the first sample."""
        ...

    def act(
        self, state: Any, reference: float, reading: float, period: float, low: float, high: float
    ) -> tuple[float, Any]:
        """The drive [V] from a reference and a reading [m], and the next state."""
        ...


@final
@dataclass(frozen=True)
class Limits:
    """Limits of the drive: its range [V] and its slew rate [V/s]."""

    low: float = float("-inf")
    high: float = float("inf")
    slew: float = float("inf")

    def __post_init__(self) -> None:
        for what in ("low", "high", "slew"):
            real(getattr(self, what), f"limits: {what}")
        if not self.low < self.high or not self.slew > 0.0:
            raise InputError(
                f"limits {self.low} .. {self.high} V, {self.slew} V/s: the lower one is below the "
                "upper one, and the slew rate is positive"
            )

    def around(self, drive: float, period: float) -> tuple[float, float]:
        """Lowest and highest drive [V] a period after another one.

        The range goes before the slew rate: from outside there is one way, to the nearer end.
        """
        low = min(max(self.low, drive - self.slew * period), self.high)
        return low, max(min(self.high, drive + self.slew * period), low)

    def told(self) -> str:
        """The range, and the slew rate where there is one."""
        slew = "" if self.slew == float("inf") else f" at {show(self.slew, 'V/s')} at most"
        return f"{self.low:g} .. {self.high:g} V{slew}"

    def to_dict(self) -> dict[str, float]:
        """SI units."""
        return {"low": self.low, "high": self.high, "slew": self.slew}


@final
@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """What happened, at the N instants of sampling.

    Attributes:
        time: (N,) [s].
        reference, position: (N,) [m]; the position is the plant's own reading, without the noise.
        reading: (N,) what the controller was given [m].
        drive: (N,) [V].
    """

    time: FloatArray
    reference: FloatArray
    position: FloatArray
    reading: FloatArray
    drive: FloatArray

    @property
    def error(self) -> FloatArray:
        """(N,) reference minus position [m]."""
        return self.reference - self.position

    @property
    def iae(self) -> float:
        """Integral of the absolute error [m s]."""
        return float(np.trapezoid(np.abs(self.error), self.time))

    @property
    def ise(self) -> float:
        """Integral of the squared error [m^2 s]."""
        return float(np.trapezoid(self.error**2, self.time))

    @property
    def itae(self) -> float:
        """Integral of the absolute error times time [m s^2]."""
        since = self.time - self.time[0]
        return float(np.trapezoid(since * np.abs(self.error), self.time))

    @property
    def rms(self) -> float:
        """Root mean square of the error [m]."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def largest(self) -> float:
        """Largest absolute error [m]."""
        return float(np.abs(self.error).max())

    @property
    def effort(self) -> float:
        """Total variation of the drive [V]."""
        return float(np.abs(np.diff(self.drive)).sum())

    @property
    def overshoot(self) -> float:
        """How far the position passes the last reference, as a share of the step to it.

        Raises:
            InputError: the reference ends where the position began.
        """
        step = self.reference[-1] - self.position[0]
        if step == 0.0:
            raise InputError("The reference ends where the position began: there is no step.")
        return float(max(0.0, np.max((self.position - self.reference[-1]) / step)))

    def settling(self, band: float = 0.02) -> float:
        """Time after which the position stays within a band around the last reference [s].

        The band is a share of the step; infinite where it does not settle.
        """
        width = band * abs(self.reference[-1] - self.position[0])
        outside = np.flatnonzero(np.abs(self.position - self.reference[-1]) > width)
        if outside.size == 0:
            return 0.0
        if outside[-1] == self.time.size - 1:
            return float("inf")
        return float(self.time[outside[-1] + 1] - self.time[0])


@final
class _Called:
    """A function as a plant; a period of 0 asks it for the reading at rest."""

    def __init__(self, function: Callable[[float, float], float]) -> None:
        self._function = function

    def begin(self, drive: float) -> float:
        """The reading [m] at rest at a drive [V]."""
        return float(self._function(drive, 0.0))

    def advance(self, drive: float, period: float) -> float:
        """The reading [m] after a drive [V] was held for a period [s]."""
        return float(self._function(drive, period))


def close_loop(
    plant: Plant | Callable[[float, float], float],
    controller: Controller,
    reference: ArrayLike,
    *,
    period: float,
    limits: Limits | None = None,
    delay: int = 0,
    resolution: float = 0.0,
    noise: float = 0.0,
    disturbance: ArrayLike | Callable[[float], float] = 0.0,
    seed: int = 0,
    drive: float = 0.0,
) -> ClosedLoop:
    """Run a controller around a plant.

    At each sample the controller is given the reference and one reading, and nothing else of the
    plant. Its drive is limited, and held from ``delay`` samples later on.

    Args:
        plant: a :class:`ModelPlant`, an object of your own with ``begin`` and ``advance``, or a
            function of drive [V] and period [s] that holds the drive so long and gives the reading
            [m] after it; first it is called with a period of 0.
        controller: a :class:`PID`, an :class:`InverseCompensation`, a :class:`LinearLaw` of
            python-control's, or one of your own.
        reference: (N,) [m], one value a period.
        period: of the sampling [s].
        limits: of the drive.
        delay: whole periods that computing takes.
        resolution: step of the sensor [m]; 0 for none.
        noise: standard deviation of the sensor's white noise [m].
        disturbance: adds to the position [m]: (N,) values, one value, or a function of time.
        seed: of the noise.
        drive: at which the plant rests before the first sample [V].

    Raises:
        InputError: no period, a reference that is not finite, fewer than two samples, a negative
            noise, resolution or delay, or a drive or position that is no finite number.

    Returns:
        the loop at its N samples.
    """
    for what in ("begin", "act"):
        if not hasattr(controller, what):
            raise InputError(
                f"The controller is {controller!r}: give one, such as PID(kp, ki, kd)."
            )
    if not isinstance(plant, Plant) and not callable(plant):
        raise InputError(f"The plant is {plant!r}: give ModelPlant(fit), or a function.")
    words(reference, "reference")
    for what, value in (("period", period), ("noise", noise), ("resolution", resolution)):
        real(value, what)
    whole(seed, "seed", 0)
    wanted: FloatArray = np.atleast_1d(np.asarray(reference, dtype=float))
    if wanted.ndim != 1 or wanted.size < 2 or not np.isfinite(wanted).all():
        raise InputError("reference: give at least two finite values, one for each period")
    if not (np.isfinite(period) and period > 0.0):
        raise InputError(f"period = {period} s: give a positive time")
    if min(noise, resolution, delay) < 0:
        raise InputError(
            f"noise = {noise} m, resolution = {resolution} m, delay = {delay}: none is negative"
        )
    held = Limits() if limits is None else limits
    n = wanted.size
    time: FloatArray = period * np.arange(n, dtype=float)
    if callable(disturbance):
        added = np.array([disturbance(t) for t in time.tolist()], dtype=float)
    else:
        added = np.broadcast_to(np.asarray(disturbance, dtype=float), (n,))
    errors: FloatArray = noise * np.random.default_rng(seed).normal(size=n)
    position, reading, drives = np.empty(n), np.empty(n), np.empty(n)
    state = controller.begin()
    waiting = [drive] * delay
    acting = drive
    driven = plant if isinstance(plant, Plant) else _Called(plant)
    output = driven.begin(drive)
    for k in range(n):
        position[k] = output + added[k]
        seen = position[k] + errors[k]
        reading[k] = resolution * np.round(seen / resolution) if resolution > 0.0 else seen
        before = waiting[-1] if waiting else acting
        low, high = held.around(before, period)
        asked, state = controller.act(state, float(wanted[k]), float(reading[k]), period, low, high)
        if not np.isfinite(asked) or not np.isfinite(position[k]):
            raise InputError(
                f"At {time[k]:g} s the controller's drive is {asked} V and the position "
                f"{position[k]} m: the loop is unstable, or the controller cannot take this "
                "reading."
            )
        waiting.append(min(max(asked, low), high))
        acting = waiting.pop(0)
        drives[k] = acting
        output = driven.advance(acting, period)
    return ClosedLoop(time, wanted, position, reading, drives)
