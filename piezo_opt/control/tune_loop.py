"""A controller tuned in its loop on the identified actuator, by single shooting."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.control.closed_loop import ClosedLoop, Controller, Limits, close_loop
from piezo_opt.control.cost import Criterion
from piezo_opt.control.identified import Identified, Source, identified
from piezo_opt.control.loop_program import Asked, Family, Linear, LoopProgram
from piezo_opt.control.margins import Margins, margins
from piezo_opt.control.plant import ModelPlant, without_delay
from piezo_opt.control.reach import reach
from piezo_opt.control.scenarios import scenarios as drawn
from piezo_opt.control.simplex import simplex
from piezo_opt.control.sqp import PENALTY, Found, minimise
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.units import quantity, show
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

CHECKS = 500
"""Further draws on which a robust design is checked: a share of 5 % is known to 1 % of all."""
SLACK = 0.05
"""Of what the drive reaches: a reference that goes no further is followed but for its ends."""
SHAKEN, CALMED = 60, 600
"""Samples of a fault of the sensor, and after it, by which a loop is tried."""
FOLLOWED = 0.5
"""Of a reference's span, what a drive at its slew rate must cover: a step need not be followed at
once, but what covers less is no following."""
FAR_OFF = 3.0
"""Times the range that the drive reaches: an error beyond is none of the actuator's."""
_APART = 1_000_003
_KEPT = 1e-4
"""Relative violation that counts as none: the search leaves less."""


class Told(Controller, Protocol):
    """A controller that says what it is."""

    @property
    def kind(self) -> str:
        """Its usual name."""
        ...

    def told(self) -> str:
        """Its law and its gains, with units."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """Its numbers, SI units."""
        ...


C = TypeVar("C", bound=Told)


@final
@dataclass(frozen=True, eq=False)
class Tuned(Generic[C]):
    """A tuned controller, and what it does.

    Attributes:
        controller: with its gains.
        period: of the sampling [s].
        delay: whole periods, those of the plant included.
        limits: of the drive.
        criterion: what was made small; ``cost`` its mean over references and scenarios [SI].
        cost_at_start: the same at the start.
        loops: the loop on each reference, with the values of the fit itself.
        margins: of the linearised loop.
        peak: sensitivity peak that was allowed; None for any.
        violation: largest violation of a constraint, relative; 0 where all hold.
        simulations: loops that were simulated, scenarios times references times evaluations.
        scenarios, seed: draws from the fit's covariance; 0 for the fit's values alone.
        violating: share of as many other draws (:data:`CHECKS`) that violate a constraint: what
            is to be expected of the actuator itself, if the fit is right; nan without scenarios.
        converged: whether the search ended by itself.
        calm: whether the loop comes to rest after a step, and after a fault of the sensor that has
            driven it into its limits; linear margins do not tell.
        trace: simulations until then and cost over that of the start, of every point accepted.
    """

    controller: C
    period: float
    delay: int
    limits: Limits
    criterion: Criterion
    cost: float
    cost_at_start: float
    loops: tuple[ClosedLoop, ...]
    margins: Margins
    peak: float | None
    violation: float
    simulations: int
    scenarios: int
    seed: int
    violating: float
    converged: bool
    calm: bool
    trace: tuple[tuple[int, float], ...]

    def __str__(self) -> str:
        m, name = self.margins, self.criterion.value.upper()
        unit = {"iae": "m s", "ise": "m^2 s", "itae": "m s^2"}[self.criterion.value]
        low = min(float(one.drive.min()) for one in self.loops)
        high = max(float(one.drive.max()) for one in self.loops)
        asked = "" if self.peak is None else f" (at most {self.peak:g} was asked)"
        late = f", {self.delay} of delay" if self.delay else ""
        lines = [
            f"{self.controller.told()}",
            f"sampled every {show(self.period, 's')}{late}; drive within "
            f"{self.limits.told()}, {low:.4g} to {high:.4g} V used",
            f"expected error {show(max(one.rms for one in self.loops), 'm')} rms, "
            f"{show(max(one.largest for one in self.loops), 'm')} at most; {name} "
            f"{self.cost:.4g} {unit} ({self.cost_at_start:.4g} at the start), "
            f"{self.simulations} simulations",
            f"gain margin {m.gain:.3g}, phase margin {np.degrees(m.phase):.0f} deg, sensitivity "
            f"peak {m.peak:.3g}{asked}",
        ]
        if self.scenarios:
            lines.append(
                f"{self.scenarios} actuators drawn from the fit's covariance (seed {self.seed}); "
                f"of {CHECKS} others {100 * self.violating:.1f} % violate a constraint"
            )
        if self.violation > 1e-3:
            lines.append(
                f"Not every constraint can be met: one is violated by {100 * self.violation:.1f} %."
            )
        if not self.calm:
            lines.append(
                "A step or a fault of the sensor leaves it swinging between the limits of its "
                "drive: ask for a lower sensitivity peak, or give the drive's moves a weight."
            )
        if not self.converged:
            lines.append("The search ended before it had converged: this is the best so far.")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        m = self.margins
        return {
            "schema": f"piezo_opt/tune_{self.controller.kind}/1",
            "controller": self.controller.to_dict(),
            "period": self.period,
            "delay": self.delay,
            "limits": self.limits.to_dict(),
            "criterion": self.criterion.value,
            "cost": self.cost,
            "cost_at_start": self.cost_at_start,
            "rms": [one.rms for one in self.loops],
            "largest": [one.largest for one in self.loops],
            "effort": [one.effort for one in self.loops],
            "margins": {"gain": m.gain, "phase": m.phase, "peak": m.peak, "stable": m.stable},
            "violation": self.violation,
            "simulations": self.simulations,
            "scenarios": self.scenarios,
            "seed": self.seed,
            "violating": self.violating,
            "converged": self.converged,
            "calm": self.calm,
        }


@final
@dataclass(frozen=True, eq=False)
class Task:
    """A plant and what its loop is asked to do, as :func:`~piezo_opt.control.tune_pid` takes it.

    ``largest`` is an error that cannot be [m].
    """

    plant: Identified
    asked: Asked
    scenarios: int
    largest: float


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
        InputError: references or a period that are none.
    """
    known = identified(plant, values)
    step = period_of(known, period)
    model, behind = without_delay(known.model, known.numbers, step)
    numbers = known.numbers
    asked = Asked(
        references_of(reference), step, limits or Limits(), delay + behind, Criterion(criterion),
        effort, overshoot, drive, peak, (known.noise or 0.0) if noise is None else noise,
        disturbance, seed, at,
    )  # fmt: skip
    far = FAR_OFF * _reachable(model, numbers, asked)
    shortest = min(one.size for one in asked.references)
    if asked.delay >= shortest:
        raise InputError(
            f"The delay of {asked.delay} periods is as long as the reference of {shortest}: give a "
            "longer reference."
        )
    own = {k: v for k, v in numbers.items() if k in model.parameters}
    return Task(Identified(
        model, known.values.with_(own), known.names, known.covariance, known.bounds
    ), asked, scenarios, far)  # fmt: skip


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


def tune(
    what: Task,
    family: Callable[[Linear], Family],
    start: Any = None,
    *,
    simplex_only: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Tuned[Any]:
    """The best controller of a family for a task.

    Args:
        what: the task.
        family: makes the family for the plant.
        start: where to begin, as the family takes it; unless given the best of its guesses.
        simplex_only: Nelder-Mead on the same program, to compare with.
        progress: told how it goes.

    Raises:
        InputError: a plant without response, or no start from which the loop is stable.
    """
    plant, asked = what.plant, what.asked
    model, numbers = plant.model, plant.numbers

    def program_of(count: int, seed: int) -> LoopProgram:
        draws = drawn(plant, count, seed) if count else ()
        nominal = [numbers.with_(_own(d.of_record(0), numbers)) for d in draws]
        return LoopProgram(model, numbers, nominal, asked, family)

    program = program_of(what.scenarios, asked.seed)
    starts = program.family.guesses() if start is None else (program.family.unknowns(start),)
    spent = 0
    if what.scenarios and start is None:
        # Which start is better is asked of the fit's own values: a tenth of the price or less.
        lone = program_of(0, asked.seed)
        alone = [minimise(lone.evaluate, lone.stable(s), lone.low, lone.high) for s in starts]
        starts, spent = (_better(alone).x,), lone.simulations
    begins = [program.stable(one) for one in starts]
    first = program.evaluate(begins[0])
    if first is None or not first.finite:
        raise InputError(
            "The loop diverges from the start gains: give a start that is stable, or limits."
        )
    base = first.cost

    def tell(count: int, cost: float) -> None:
        if progress is not None:
            progress(f"evaluation {count}, cost {np.exp(cost - base):.4g} of the start's")

    program.simulations = 0
    search, function = (simplex, program.bare) if simplex_only else (minimise, program.evaluate)
    found = _better([search(function, b, program.low, program.high, tell=tell) for b in begins])
    spent += program.simulations
    each = max(what.scenarios, 1) * len(asked.references)
    controller = replace(program.family.controller(found.x), largest=what.largest or np.inf)
    linear = margins(
        model, program.transfer(found.x), period=asked.period, delay=asked.delay, values=numbers,
        at=asked.at,
    )  # fmt: skip
    if not linear.stable:
        raise InputError(
            "The tuned loop is unstable for small motions: sample faster, or bound the peak."
        )
    calm = _calm(controller, what)
    violating = float("nan")
    if what.scenarios:
        if progress is not None:
            progress(f"checking {CHECKS} other actuators that the record allows")
        # Seeds that no draw of the design has.
        told = program_of(CHECKS, asked.seed + _APART)
        violating = float(np.mean(told.violated(found.x) > _KEPT))
    return Tuned(
        controller, asked.period, asked.delay, asked.limits, asked.criterion,
        program.in_units(found.x), program.in_units(begins[0]), program.loops(controller), linear,
        asked.peak, found.valued.violation, spent, what.scenarios, asked.seed, violating,
        found.converged, calm, tuple((k * each, float(np.exp(c - base))) for k, c in found.trace),
    )  # fmt: skip


def _calm(controller: Any, what: Task) -> bool:
    """Whether a loop comes to rest at a constant reference, from rest and after a fault.

    The sensor is off by half of what the drive reaches, the other way every second sample. A cycle
    between limits of the drive, which no linear margin tells, moves more than 1 % of that.
    """
    asked, plant = what.asked, what.plant
    width = what.largest / FAR_OFF
    goal = np.full(SHAKEN + CALMED, float(np.mean(asked.references[0])))
    sign = 1.0 - 2.0 * ((np.arange(SHAKEN) // 2) % 2)
    shaking = np.concatenate([0.5 * width * sign, np.zeros(CALMED)])
    for off in (np.zeros(goal.size), shaking):
        loop = close_loop(
            ModelPlant(plant.model, plant.numbers), controller, goal, period=asked.period,
            limits=asked.limits, delay=asked.delay, noise=asked.noise, disturbance=off,
            seed=asked.seed,
        )  # fmt: skip
        steady = loop.position[-CALMED // 4 :]
        moving = steady - np.linspace(steady[0], steady[-1], steady.size)
        if float(np.std(moving)) > 0.01 * width + 3.0 * asked.noise:
            return False
    return True


def _own(draw: Mapping[str, float], numbers: Mapping[str, float]) -> dict[str, float]:
    """What of a draw belongs to the actuator."""
    return {k: v for k, v in draw.items() if k in numbers}


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


def _better(ends: Sequence[Found]) -> Found:
    """Of several ends the best: limits first, then cost."""
    return min(ends, key=lambda f: f.valued.cost + PENALTY * f.valued.violation)


def references_of(reference: ArrayLike | Sequence[ArrayLike]) -> tuple[FloatArray, ...]:
    """One reference or several, as arrays.

    Raises:
        InputError: fewer than two values, or one that is not finite.
    """
    several = isinstance(reference, list | tuple) and np.ndim(reference[0]) == 1
    found = tuple(
        np.asarray(one, dtype=float)
        for one in (reference if several else [reference])  # type: ignore[union-attr]
    )
    for one in found:
        if one.ndim != 1 or one.size < 2 or not np.isfinite(one).all():
            raise InputError("reference: give at least two finite values, one for each period")
    return found
