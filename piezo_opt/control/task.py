"""What a loop is asked to do on an identified actuator, checked before any work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.choosing import chosen, expected, real, whole, words
from piezo_opt.control.closed_loop import Limits
from piezo_opt.control.cost import Criterion
from piezo_opt.control.identified import Identified, Source, identified
from piezo_opt.control.linearise import linearise
from piezo_opt.control.loop_program import Asked
from piezo_opt.control.observable import remarks
from piezo_opt.control.plant import without_delay
from piezo_opt.control.reach import reach
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.units import quantity, show
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

SLACK = 0.05
"""Of what the drive reaches: a reference that goes no further is followed but for its ends."""
FOLLOWED = 0.5
"""Of a reference's span, what a drive at its slew rate must cover: a step need not be followed at
once, but what covers less is no following."""
FAR_OFF = 3.0
"""Times the range that the drive reaches: an error beyond is none of the actuator's."""


@final
@dataclass(frozen=True, eq=False)
class Task:
    """A plant and what its loop is asked to do, as :func:`~piezo_opt.control.tune_pid` takes it.

    Attributes:
        plant: without its delay.
        asked: references, limits and bounds.
        scenarios: number of draws.
        width: of what the drive reaches [m]; without limits, of what the references span.
        remarks: sentences on the plant.
    """

    plant: Identified
    asked: Asked
    scenarios: int
    width: float
    remarks: tuple[str, ...] = ()

    @property
    def largest(self) -> float:
        """An error that cannot be [m]."""
        return FAR_OFF * self.width or float("inf")


def task(
    plant: Source,
    reference: ArrayLike | Sequence[ArrayLike],
    *,
    period: float | str | None = None,
    values: Mapping[str, float] | None = None,
    limits: Limits | None = None,
    delay: int = 0,
    criterion: Criterion | str = Criterion.IAE,
    effort: float = 0.0,
    overshoot: float | None = None,
    drive: float | None = None,
    peak: float | None = 2.0,
    scenarios: int = 0,
    seed: int = 0,
    noise: float | None = 0.0,
    disturbance: ArrayLike = 0.0,
    at: float = 0.0,
) -> Task:
    """Arguments as :func:`~piezo_opt.control.tune_pid` has them, checked.

    Raises:
        InputError: references or a period that are none, or that the limits do not let be
            followed; a plant that runs away by itself.
    """
    if values is not None:
        expected(Mapping, values, "values", "SI values by name")
    if limits is not None:
        expected(Limits, limits, "limits", "Limits(0.0, 100.0), in volts")
    whole(delay, "delay", 0)
    whole(seed, "seed", 0)
    if peak is not None:
        real(peak, "peak")
        if not peak > 1.0:
            raise InputError(f"peak is {peak:g}: no loop has a sensitivity peak below 1: give 2.0.")
    known = identified(plant, values)
    step = period_of(known, period)
    model, behind = without_delay(known.model, known.numbers, step)
    numbers = known.numbers
    asked = Asked(
        references_of(reference), step, limits or Limits(), delay + behind,
        chosen(Criterion, criterion, "criterion"),
        effort, overshoot, drive, peak, (known.noise or 0.0) if noise is None else noise,
        disturbance, seed, at,
    )  # fmt: skip
    own = {k: v for k, v in numbers.items() if k in model.parameters}
    said = remarks(linearise(model, own, at=at))
    width = _reachable(model, numbers, asked)
    shortest = min(one.size for one in asked.references)
    if asked.delay >= shortest:
        raise InputError(
            f"The delay of {asked.delay} periods is as long as the reference of {shortest}: give a "
            "longer reference."
        )
    plain = Identified(model, known.values.with_(own), known.names, known.covariance, known.bounds)
    return Task(plain, asked, scenarios, width, said)


def _reachable(model: Model, numbers: Values, asked: Asked) -> float:
    """How wide the range is that the drive reaches [m]; references beyond it are refused.

    Without limits of the drive that of the references.
    """
    limits = asked.limits
    if not np.isfinite([limits.low, limits.high]).all():
        return max(float(np.ptp(np.append(one, 0.0))) for one in asked.references)
    own = {k: v for k, v in numbers.items() if k in model.parameters}
    found = reach(model, Values(own), limits, asked.period)
    slack = SLACK * (found.high - found.low)
    for one in asked.references:
        if one.max() > found.high + slack or one.min() < found.low - slack:
            raise InputError(
                f"The reference goes from {show(float(one.min()), 'm')} to "
                f"{show(float(one.max()), 'm')}, and the drive's limits of {limits.low:g} V and "
                f"{limits.high:g} V reach {show(found.low, 'm')} to {show(found.high, 'm')}: ask "
                "for less, or widen the limits."
            )
        _refuse_too_slow(one, (found.high - found.low) / (limits.high - limits.low), asked)
    return found.high - found.low


def _refuse_too_slow(reference: FloatArray, gain: float, asked: Asked) -> None:
    """Refuse a reference of which a drive at its slew rate covers hardly anything."""
    most = asked.limits.slew * asked.period * gain
    if not np.isfinite(most):
        return
    at, low, high = reference[0], reference[0], reference[0]
    for goal in reference.tolist():
        at += min(max(goal - at, -most), most)
        low, high = min(low, at), max(high, at)
    if high - low < FOLLOWED * np.ptp(reference):
        raise InputError(
            f"The reference moves through {show(float(np.ptp(reference)), 'm')}, and at "
            f"{show(asked.limits.slew, 'V/s')} the drive covers only {show(high - low, 'm')} of "
            "it: ask for a slower reference, or allow a faster drive."
        )


def period_of(plant: Identified, period: float | str | None) -> float:
    """The period of the sampling [s]: as given, or that of the record.

    Raises:
        InputError: neither is there, or it is no time.
    """
    if period is None and plant.period is None:
        raise InputError("How often the loop is sampled is not known: give period='1 ms'.")
    found = plant.period if period is None else quantity(period, "s")
    if found is None or not 0.0 < found < np.inf:
        raise InputError(f"period = {period}: give the time between two samples, '1 ms'")
    return found


def references_of(reference: ArrayLike | Sequence[ArrayLike]) -> tuple[FloatArray, ...]:
    """One reference or several, as arrays.

    Raises:
        InputError: fewer than two values, or one that is not finite.
    """
    words(reference, "reference")
    several = isinstance(reference, list | tuple) and any(np.ndim(one) == 1 for one in reference)
    found = tuple(
        np.asarray(one, dtype=float)
        for one in (reference if several else [reference])  # type: ignore[union-attr]
    )
    for one in found:
        if one.ndim != 1 or one.size < 2 or not np.isfinite(one).all():
            raise InputError("reference: give at least two finite values, one for each period")
    return found
