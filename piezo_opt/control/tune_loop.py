"""A controller tuned in its loop on the identified actuator, by single shooting."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Generic, Protocol, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.calm import calm
from piezo_opt.control.closed_loop import ClosedLoop, Controller, Limits
from piezo_opt.control.cost import Criterion
from piezo_opt.control.loop_program import Family, Linear, LoopProgram
from piezo_opt.control.margins import Margins, margins
from piezo_opt.control.scenarios import scenarios as drawn
from piezo_opt.control.simplex import simplex
from piezo_opt.control.sqp import MOST, PENALTY, Found, minimise
from piezo_opt.control.task import Task
from piezo_opt.errors import InputError
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

CHECKS = 1000
"""Further draws on which a robust design is checked: a share of 20 % is known to 1.3 points."""
SOFTEST: Final = 16.0
"""Logarithm of how far a loop that swings is made softer at most: gains of a ten-millionth."""
_FINE: Final = 0.25
"""Of that logarithm: the softness that is needed is found to it, 2 % of the error where tried."""
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
        swinging: cost of the loop that would follow closest, where that was made softer because a
            fault leaves it swinging; None where it was not.
        violation: largest violation of a constraint, relative; 0 where all hold.
        simulations: loops that were simulated, scenarios times references times evaluations.
        scenarios, seed: draws from the fit's covariance; 0 for the fit's values alone.
        violating: share of as many other draws (:data:`CHECKS`) that violate a constraint: what
            is to be expected of the actuator itself, if the fit is right; nan without scenarios.
        converged: whether the search ended by itself.
        calm: whether the loop comes to rest after a step, and after a fault of the sensor that has
            driven it into its limits; linear margins do not tell.
        trace: simulations until then and cost over that of the start, of every point accepted.
        remarks: sentences on the plant, the design and the start.
        interrupted: whether Ctrl-C or a limit of time ended the work; what was not done by then is
            left out.
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
    swinging: float | None
    violation: float
    simulations: int
    scenarios: int
    seed: int
    violating: float
    converged: bool
    calm: bool
    trace: tuple[tuple[int, float], ...]
    remarks: tuple[str, ...] = ()
    interrupted: bool = False

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
            others = (
                f"of {CHECKS} others {100 * self.violating:.1f} % violate a constraint"
                if np.isfinite(self.violating)
                else "it was not tried on others"
            )
            lines.append(
                f"{self.scenarios} actuators drawn from the fit's covariance (seed {self.seed}); "
                f"{others}"
            )
        if self.violation > 1e-3:
            lines.append(
                f"Not every constraint is met: one is violated by {100 * self.violation:.1f} %."
            )
        if self.swinging is not None and self.calm:
            lines.append(
                f"Made softer than the closest ({name} {self.swinging:.4g} {unit}), which a step "
                "or a fault of the sensor leaves swinging between the limits of its drive."
            )
        if not self.calm:
            lines.append(
                "A step or a fault of the sensor leaves it swinging between the limits of its "
                "drive: ask for a lower sensitivity peak, or give the drive's moves a weight."
            )
        if not self.converged:
            lines.append("The search ended before it had converged: this is the best so far.")
        return "\n".join([*lines, *self.remarks])

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
            "peak_asked": self.peak,
            "cost_swinging": self.swinging,
            "violation": self.violation,
            "simulations": self.simulations,
            "scenarios": self.scenarios,
            "seed": self.seed,
            "violating": self.violating,
            "converged": self.converged,
            "interrupted": self.interrupted,
            "calm": self.calm,
            "remarks": list(self.remarks),
        }


def tune(
    what: Task,
    family: Callable[[Linear], Family],
    start: Any = None,
    *,
    simplex_only: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Tuned[Any]:
    """The best controller of a family for a task.

    Where a step or a fault of the sensor leaves the best loop swinging between the limits of its
    drive, it is made softer until it comes to rest, and no further. Ctrl-C gives the best so far.

    Args:
        what: the task.
        family: makes the family for the plant.
        start: where to begin, as the family takes it; unless given the best of its guesses.
        simplex_only: Nelder-Mead on the same program, to compare with.
        progress: told how it goes.

    Raises:
        InputError: a plant without response, or no start from which the loop is stable.
    """
    asked, plant = what.asked, what.plant
    own = _designed(what, family, start, simplex_only, progress)
    swinging, violating = None, float("nan")
    interrupted = own.found.interrupted
    try:
        if not own.calm and not simplex_only and not interrupted:
            if progress is not None:
                progress("a fault leaves the loop swinging: looking for one that comes to rest")
            swinging, own = own.program.in_units(own.found.x), _calmed(own, what)
        if what.scenarios and not interrupted:
            if progress is not None:
                progress(f"checking {CHECKS} other actuators that the record allows")
            # Seeds that no draw of the design has; judged by what was asked.
            told = _program(what, family, CHECKS, asked.seed + _APART)
            violating = float(np.mean(told.violated(own.found.x) > _KEPT))
    except KeyboardInterrupt:
        interrupted = True
    linear = margins(
        plant.model, own.program.transfer(own.found.x), period=asked.period, delay=asked.delay,
        values=plant.numbers, at=asked.at,
    )  # fmt: skip
    if not linear.stable:
        raise InputError(
            "The tuned loop is unstable for small motions: sample faster, or bound the peak."
        )
    each = max(what.scenarios, 1) * len(asked.references)
    trace = tuple((k * each, float(np.exp(c - own.base))) for k, c in own.found.trace)
    return Tuned(
        own.controller, asked.period, asked.delay, asked.limits, asked.criterion,
        own.program.in_units(own.found.x), own.cost_at_start, own.program.loops(own.controller),
        linear, asked.peak, swinging, own.found.valued.violation, own.spent, what.scenarios,
        asked.seed, violating, own.found.converged, own.calm, trace,
        (*what.remarks, *own.program.family.remarks, *own.remarks), interrupted,
    )  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class _Designed:
    """One search.

    Attributes:
        program: over which; ``found`` its best point, ``controller`` that of it.
        base: logarithm of the cost at the start; ``cost_at_start`` the same in its units.
        spent: loops simulated.
        calm: whether the loop comes to rest.
        remarks: on the start.
    """

    program: LoopProgram
    found: Found
    controller: Any
    base: float
    cost_at_start: float
    spent: int
    calm: bool
    remarks: tuple[str, ...]


def _calmed(swinging: _Designed, what: Task) -> _Designed:
    """The same, softer until it comes to rest; as it is where the softest does not."""
    program, theta = swinging.program, swinging.found.x

    def softer(by: float) -> tuple[FloatArray, Any]:
        x = np.clip(program.family.calmer(theta, by), program.low, program.high)
        return x, replace(program.family.controller(x), largest=what.largest)

    low, high = 0.0, 1.0
    while not (program.steady(softer(high)[0]) and calm(softer(high)[1], what)):
        low, high = high, 2.0 * high
        if high > SOFTEST:
            return swinging
    while high - low > _FINE:
        middle = 0.5 * (low + high)
        x, controller = softer(middle)
        rests = program.steady(x) and calm(controller, what)
        low, high = (low, middle) if rests else (middle, high)
    x, controller = softer(high)
    valued = program.evaluate(x)
    if valued is None:
        return swinging
    found = replace(swinging.found, x=x, valued=valued)
    return replace(swinging, found=found, controller=controller, calm=True)


def _program(
    what: Task, family: Callable[[Linear], Family], count: int, seed: int
) -> LoopProgram:  # fmt: skip
    """The program over so many draws; none for the plant's own values."""
    plant, numbers = what.plant, what.plant.numbers
    draws = drawn(plant, count, seed) if count else ()
    sets = [numbers.with_(_own(d.of_record(0), numbers)) for d in draws]
    return LoopProgram(plant.model, numbers, sets, what.asked, family)


def _designed(
    what: Task, family: Callable[[Linear], Family], start: Any,
    simplex_only: bool, progress: Callable[[str], None] | None,
) -> _Designed:  # fmt: skip
    """A search from a start as a user gives it, or from the family's guesses."""
    seed = what.asked.seed
    program = _program(what, family, what.scenarios, seed)
    starts, spent, most = program.family.guesses(), 0, MOST
    said: tuple[str, ...] = ()
    if start is not None:
        starts = (program.family.unknowns(start),)
        if not program.steady(starts[0]):
            said = ("The start's gains make the loop unstable: the search began with softer ones.",)
    elif what.scenarios:
        # Which start is better is asked of the fit's own values: a tenth of the price or less.
        lone = _program(what, family, 0, seed)
        alone = _until_interrupted(
            lambda s: minimise(lone.evaluate, lone.stable(s), lone.low, lone.high), starts
        )
        starts, spent = (_better(alone).x,), lone.simulations
        most = 1 if alone[-1].interrupted else most
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
    low, high = program.low, program.high

    def search(begin: FloatArray) -> Found:
        if simplex_only:
            return simplex(program.bare, begin, low, high, tell=tell)
        return minimise(program.evaluate, begin, low, high, most=most, tell=tell)

    ends = _until_interrupted(search, begins)
    interrupted = ends[-1].interrupted or most == 1
    found = replace(_better(ends), interrupted=interrupted)
    spent += program.simulations
    controller = replace(program.family.controller(found.x), largest=what.largest)
    return _Designed(
        program, found, controller, base, program.in_units(begins[0]), spent,
        calm(controller, what), said,
    )  # fmt: skip


def _own(draw: Mapping[str, float], numbers: Mapping[str, float]) -> dict[str, float]:
    """What of a draw belongs to the actuator."""
    return {k: v for k, v in draw.items() if k in numbers}


def _until_interrupted(
    search: Callable[[FloatArray], Found], starts: Sequence[FloatArray]
) -> list[Found]:
    """Searches from starts, one after the other; none after one that was interrupted."""
    ends: list[Found] = []
    for start in starts:
        ends.append(search(start))
        if ends[-1].interrupted:
            break
    return ends


def _better(ends: Sequence[Found]) -> Found:
    """Of several ends the best: limits first, then cost."""
    return min(ends, key=lambda f: f.valued.cost + PENALTY * f.valued.violation)
