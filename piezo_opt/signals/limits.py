"""What amplifier and actuator allow, and drives that keep to it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np

from piezo_opt.choosing import expected
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.measurement import Between
from piezo_opt.modelfile import ModelFile
from piezo_opt.signals.drive import Drive, FloatArray
from piezo_opt.simulation import INITIAL, Initial, Simulator
from piezo_opt.units import show

_HALVINGS: Final = 30
"""Halvings of the interval in which the admissible share of the swing lies: nine digits."""
_SLACK: Final = 1e-9
"""Share of a limit by which rounding may pass it."""


@final
@dataclass(frozen=True)
class DriveLimits:
    """Limits of a drive.

    Args:
        low, high: of the amplifier [unit].
        slew: fastest change [unit/s].
        shortest, longest: of the position that a fit predicts [m].

    Raises:
        InputError: a range is empty, or the slew rate not positive.
    """

    low: float = -np.inf
    high: float = np.inf
    slew: float = np.inf
    shortest: float = -np.inf
    longest: float = np.inf

    def __post_init__(self) -> None:
        if not self.low < self.high or not self.shortest < self.longest or not self.slew > 0.0:
            raise InputError(
                f"limits {self.low:g}..{self.high:g} at {self.slew:g} a second, stroke "
                f"{self.shortest:g}..{self.longest:g} m: give low below high, and a positive slew"
            )

    @property
    def has_stroke(self) -> bool:
        """Whether the position is limited."""
        return self.shortest > -np.inf or self.longest < np.inf


def within(drive: Drive, limits: DriveLimits, fit: Fit | ModelFile | None = None) -> Drive:
    """The drive as it keeps to limits, and says how it was changed.

    A drive outside the range is moved and scaled into it. Edges of a square or a staircase become
    ramps at the slew limit; all other signals are scaled towards their first value, since clipping
    would change their frequencies. For a stroke limit the swing is scaled until the fit stays
    inside.

    Args:
        drive: what is to be played.
        limits: what is allowed.
        fit: predicts the position, or the model file of one; needed for stroke limits.

    Raises:
        InputError: a stroke limit without a fit, or one that even the drive's first value passes.
    """
    expected(Drive, drive, "drive", "a drive, such as triangle(...)")
    expected(DriveLimits, limits, "limits", "DriveLimits(...)")
    values, said = drive.values, []
    inside, scale = _into(values, limits)
    if inside is not values:
        values = inside
        said.append(f"scaled to {100.0 * scale:.0f} % for the amplitude limit")
    fastest = float(np.abs(np.diff(values)).max()) * drive.rate
    if fastest > limits.slew * (1.0 + _SLACK):
        if drive.steps:
            values = _ramped(values, limits.slew / drive.rate)
            said.append(f"edges at {show(limits.slew, f'{drive.unit}/s')}")
        else:
            share = limits.slew / fastest
            values = _scaled(values, share)
            said.append(f"scaled to {100.0 * share:.0f} % for the slew limit")
    if limits.has_stroke:
        if fit is None:
            raise InputError(
                "a stroke limit needs a fit that predicts the position: give fit=..., in a shell "
                "--fit FIT.json"
            )
        share = _share(replace(drive, values=values), limits, fit)
        if share < 1.0:
            values = _scaled(values, share)
            said.append(f"scaled to {100.0 * share:.0f} % for the stroke limit")
    if not said:
        return drive
    return replace(drive, values=values, description=f"{drive.description}, {', '.join(said)}")


def predicted(fit: Fit | ModelFile, drive: Drive) -> FloatArray:
    """Reading (N,) [m] of a fitted model, or that of a file, on a drive, from rest."""
    if isinstance(fit, Fit):
        between, values, free = fit.records[0].between, fit.values, fit.question.free
    else:
        between, values, free = fit.between or Between.LINEAR, fit.numbers, fit.free
    record = drive.played(between=between)
    numbers = {k: v for k, v in values.of_record(0).items() if not k.startswith(INITIAL)}
    simulator = Simulator(fit.model, record, numbers, initial=Initial.REST, runtime=free)
    return simulator.reading(numbers)


def _into(values: FloatArray, limits: DriveLimits) -> tuple[FloatArray, float]:
    low, high = float(values.min()), float(values.max())
    slack = _SLACK * (high - low)
    if low >= limits.low - slack and high <= limits.high + slack:
        return values, 1.0
    scale = min(1.0, (limits.high - limits.low) / (high - low))
    middle, half = 0.5 * (low + high), 0.5 * scale * (high - low)
    centre = min(max(middle, limits.low + half), limits.high - half)
    return np.clip(centre + scale * (values - middle), limits.low, limits.high), scale


def _scaled(values: FloatArray, share: float) -> FloatArray:
    return np.asarray(values[0] + share * (values - values[0]))


def _ramped(values: FloatArray, step: float) -> FloatArray:
    """Follow the values by at most a step a sample."""
    found = np.empty_like(values)
    now = float(values[0])
    for k, value in enumerate(values.tolist()):
        now += min(max(value - now, -step), step)
        found[k] = now
    return found


def _share(drive: Drive, limits: DriveLimits, fit: Fit | ModelFile) -> float:
    """Largest share of the swing at which the predicted position keeps to its limits."""

    def keeps(share: float) -> bool:
        reading = predicted(fit, replace(drive, values=_scaled(drive.values, share)))
        # At rest a reading of 0 is one but for its last digit.
        slack = _SLACK * max(abs(float(reading.min())), abs(float(reading.max())))
        low, high = limits.shortest - slack, limits.longest + slack
        return bool(reading.min() >= low and reading.max() <= high)

    if keeps(1.0):
        return 1.0
    low, high = 1e-3, 1.0
    if not keeps(low):
        raise InputError(
            f"{drive.name}: even at rest at its first value the position passes "
            f"{show(limits.shortest, 'm')}..{show(limits.longest, 'm')}: choose another range"
        )
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low
