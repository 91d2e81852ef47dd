"""A PID tuned on the identified actuator, as a nonlinear program by single shooting."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.control.closed_loop import ClosedLoop, Limits
from piezo_opt.control.cost import Criterion
from piezo_opt.control.margins import Margins, margins
from piezo_opt.control.pid import PID
from piezo_opt.control.pid_program import Asked, PIDProgram
from piezo_opt.control.plant import without_delay
from piezo_opt.control.scenarios import scenarios as drawn
from piezo_opt.control.simplex import simplex
from piezo_opt.control.sqp import PENALTY, Found, minimise
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit

FloatArray = NDArray[np.float64]

CHECKS = 500
"""Further draws on which a robust design is checked: a share of 5 % is known to 1 % of all."""
_APART = 1_000_003
_KEPT = 1e-4
"""Relative violation that counts as none: the search leaves less."""

SCHEMA = "piezo_opt/tune_pid/1"


@final
@dataclass(frozen=True, eq=False)
class TunedPID:
    """A tuned PID, and what it does.

    Attributes:
        controller: the gains.
        criterion: what was made small; ``cost`` its mean over references and scenarios [SI].
        cost_at_start: the same at the start.
        loops: the loop on each reference, with the values of the fit itself.
        margins: of the linearised loop.
        violation: largest violation of a constraint, relative; 0 where all hold.
        simulations: loops that were simulated, scenarios times references times evaluations.
        scenarios, seed: draws from the fit's covariance; 0 for the fit's values alone.
        violating: share of as many other draws (:data:`CHECKS`) that violate a constraint: what
            is to be expected of the actuator itself, if the fit is right; nan without scenarios.
        converged: whether the search ended by itself.
        trace: simulations until then and cost over that of the start, of every point accepted.
    """

    controller: PID
    criterion: Criterion
    cost: float
    cost_at_start: float
    loops: tuple[ClosedLoop, ...]
    margins: Margins
    violation: float
    simulations: int
    scenarios: int
    seed: int
    violating: float
    converged: bool
    trace: tuple[tuple[int, float], ...]

    def __str__(self) -> str:
        c, m = self.controller, self.margins
        unit = {"iae": "m s", "ise": "m^2 s", "itae": "m s^2"}[self.criterion.value]
        lines = [
            f"kp {c.kp:.5g} V/m, ki {c.ki:.5g} V/(m s), kd {c.kd:.5g} V s/m, tau {c.tau:.3g} s",
            f"{self.criterion.value.upper()} {self.cost:.4g} {unit} ({self.cost_at_start:.4g} at "
            f"the start), {self.simulations} simulations",
            f"error {1e9 * max(one.rms for one in self.loops):.4g} nm rms, "
            f"{1e9 * max(one.largest for one in self.loops):.4g} nm at most",
            f"gain margin {m.gain:.3g}, phase margin {np.degrees(m.phase):.0f} deg, sensitivity "
            f"peak {m.peak:.3g}",
        ]
        if self.scenarios:
            lines.append(
                f"{self.scenarios} scenarios drawn from the fit's covariance (seed {self.seed}); "
                f"of {CHECKS} others {100 * self.violating:.1f} % violate a constraint"
            )
        if self.violation > 1e-3:
            lines.append(
                f"Not every constraint can be met: one is violated by {100 * self.violation:.1f} %."
            )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        c, m = self.controller, self.margins
        return {
            "schema": SCHEMA,
            "controller": {"kp": c.kp, "ki": c.ki, "kd": c.kd, "tau": c.tau},
            "period": float(self.loops[0].time[1] - self.loops[0].time[0]),
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
        }


def tune_pid(
    plant: Fit | Model,
    reference: ArrayLike | Sequence[ArrayLike],
    *,
    period: float,
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
    noise: float = 0.0,
    disturbance: ArrayLike = 0.0,
    at: float = 0.0,
    start: PID | None = None,
    simplex_only: bool = False,
    progress: Callable[[str], None] | None = None,
) -> TunedPID:
    """Choose kp, ki, kd and the filter's tau of a :class:`PID` for given references.

        min  mean of IAE (or ISE, ITAE) / its scale + effort * sum du^2 / (N U^2)
        with overshoot, drive and sensitivity peak of every scenario within their limits

    by single shooting through the sampled loop, with exact derivatives: computing delay, limits of
    drive and slew rate, derivative filter and anti-windup included. U is the drive that the
    reference's span takes. The logarithms of the gains are searched.

    Args:
        plant: a fit, or a model with ``values``. A delay in it is rounded up to whole periods.
        reference: (N,) [m], one value a period, or several of them; a measured record's position
            will do.
        period: of the sampling [s].
        limits: of the drive.
        delay: whole periods that computing takes.
        criterion: "iae", "ise" or "itae".
        effort: weight of the drive's moves.
        overshoot: most of it, as a share of each reference's last step.
        drive: highest drive that is used [V], below the limit at which it is cut off.
        peak: largest sensitivity peak of the linearised loop; None for none.
        scenarios: draws from the fit's covariance over which cost and constraints are taken; 0 for
            the fit's own values alone.
        seed: of the draws, and of the noise.
        noise: standard deviation of the sensor [m].
        disturbance: added to the position [m], (N,) or one value.
        at: drive around which the loop is linearised for the peak [V].
        start: gains to begin with; unless given the better of two that follow from the plant.
        simplex_only: Nelder-Mead on the same program, to compare with.
        progress: told how it goes.

    Raises:
        InputError: references that are none, a plant without response, or no start from which the
            loop is stable.
    """
    model, behind = without_delay(plant, values, period)
    chosen = Criterion(criterion)
    draws = drawn(plant, scenarios, seed) if scenarios and isinstance(plant, Fit) else ()
    if scenarios and not isinstance(plant, Fit):
        raise InputError("scenarios are drawn from a fit's covariance: give the fit, not a model")
    asked = Asked(
        references_of(reference), period, limits or Limits(), delay + behind, chosen, effort,
        overshoot, drive, peak, noise, disturbance, seed, at,
    )  # fmt: skip
    program = PIDProgram(plant, model, values, draws, asked)
    starts = (program.unknowns(start),) if start else program.guesses()
    if draws and start is None:
        # Which start is better is asked of the fit's own values: a tenth of the price or less.
        lone = PIDProgram(plant, model, values, (), asked)
        alone = [minimise(lone.evaluate, lone.stable(s), lone.low, lone.high) for s in starts]
        starts, spent = (_better(alone).x,), lone.simulations
    else:
        spent = 0

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
    each = len(draws or (1,)) * len(asked.references)
    controller = program.controller(found.x)
    linear = margins(
        model, controller, period=period, delay=asked.delay, values=program.numbers, at=at
    )
    if not linear.stable:
        raise InputError(
            "The tuned loop is unstable for small motions: sample faster, or bound the peak."
        )
    violating = float("nan")
    if draws and isinstance(plant, Fit):
        # Seeds that no draw of the design has.
        others = drawn(plant, CHECKS, seed + _APART)
        told = PIDProgram(plant, model, values, others, asked)
        violating = float(np.mean(told.violated(controller) > _KEPT))
    return TunedPID(
        controller, chosen, program.in_units(found.x), program.in_units(begins[0]),
        program.loops(controller), linear, found.valued.violation, spent, scenarios, seed,
        violating, found.converged,
        tuple((k * each, float(np.exp(c - base))) for k, c in found.trace),
    )  # fmt: skip


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
