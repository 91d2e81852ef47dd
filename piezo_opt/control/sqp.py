"""Sequential quadratic programming for a handful of unknowns and a dear function.

    min f(x)   with   c(x) <= 0,   low <= x <= high

Every step solves a quadratic program within a box around the point, with one slack for all
constraints, so that there is always a step; the box shrinks where the step disappoints. The Hessian
begins with the one that the caller knows and is updated by damped BFGS, at refused points too.

Sources: Nocedal & Wright (2006), Numerical Optimization, 2nd ed., chs. 4, 18; Powell (1978),
Lecture Notes in Mathematics 630, 144-157 (damping).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.quadratic import solve

FloatArray = NDArray[np.float64]

PENALTY: Final = 30.0
"""Of one unit of a violated constraint. Cost (a logarithm) and constraints are relative numbers: it
is exact where relaxing a limit by 1 % lowers the cost by less than 30 %."""

MOST: Final = 60
"""Evaluations of a search, unless it ends by itself."""


@final
@dataclass(frozen=True, eq=False)
class Valued:
    """A function at a point: cost, slope (n,), constraints (m,), their slopes (m, n).

    Attributes:
        hessian: (n, n), a first guess; only that of the start is looked at.
    """

    cost: float
    slope: FloatArray
    constraints: FloatArray
    slopes: FloatArray
    hessian: FloatArray

    @property
    def finite(self) -> bool:
        """Whether everything is a number."""
        parts = (self.slope, self.constraints, self.slopes)
        return bool(np.isfinite(self.cost) and all(np.isfinite(p).all() for p in parts))

    @property
    def violation(self) -> float:
        """What the most violated constraint is violated by."""
        return max(0.0, float(self.constraints.max(initial=0.0)))


@final
@dataclass(frozen=True, eq=False)
class Found:
    """Where the search ended.

    Attributes:
        x: (n,) the unknowns there.
        valued: the function there.
        evaluations: how many there were.
        converged: whether it ended by itself.
        trace: cost of every accepted point that keeps the constraints (to 1e-3), with the number of
            evaluations until then.
        interrupted: whether Ctrl-C or a limit of time ended it.
    """

    x: FloatArray
    valued: Valued
    evaluations: int
    converged: bool
    trace: tuple[tuple[int, float], ...]
    interrupted: bool = False


def minimise(
    evaluate: Callable[[FloatArray], Valued | None],
    start: FloatArray,
    low: FloatArray,
    high: FloatArray,
    *,
    radius: float = 0.7,
    tolerance: float = 1e-4,
    most: int = MOST,
    tell: Callable[[int, float], None] | None = None,
) -> Found:
    """From a start to a minimum; Ctrl-C gives the best so far.

    Args:
        evaluate: the function; None where it has no value, which refuses a step at no price.
        start: (n,) with a value.
        low, high: bounds of the unknowns.
        radius: half width of the first box.
        tolerance: fall of the cost that a step must promise to be tried.
        most: evaluations at most.
        tell: called with the evaluations so far and the best cost.
    """
    x = np.clip(start, low, high)
    now = evaluate(x)
    if now is None or not now.finite:
        raise ArithmeticError("the function has no value at the start")
    count, box, penalty = 1, radius, PENALTY
    hessian, trace = now.hessian, [(1, now.cost)] if now.violation < 1e-3 else []
    try:
        while count < most:
            step, multipliers = _step(
                now, hessian, np.maximum(low - x, -box), np.minimum(high - x, box)
            )
            promised = _merit(now, penalty) - _model(now, hessian, step, penalty)
            if promised <= tolerance or box < 1e-4:
                return Found(x, now, count, True, tuple(trace))
            trial = evaluate(x + step)
            if trial is None:
                box = 0.4 * float(np.abs(step).max())
                continue
            count += 1
            if not trial.finite:
                box = 0.3 * float(np.abs(step).max())
                continue
            gained = _merit(now, penalty) - _merit(trial, penalty)
            bend = trial.slope - now.slope + (trial.slopes - now.slopes).T @ multipliers
            hessian = _updated(hessian, step, bend)
            size = float(np.abs(step).max())
            if gained > 0.75 * promised and size > 0.9 * box:
                box = min(2.0 * box, 4.0)
            elif gained < 0.25 * promised:
                box = (0.5 if gained > 0.0 else 0.35) * size
            if gained > 1e-3 * promised:
                x, now = x + step, trial
                if now.violation < 1e-3:
                    trace.append((count, now.cost))
            if tell is not None:
                tell(count, now.cost)
    except KeyboardInterrupt:
        return Found(x, now, count, False, tuple(trace), interrupted=True)
    return Found(x, now, count, False, tuple(trace))


def _merit(at: Valued, penalty: float) -> float:
    return at.cost + penalty * at.violation


def _model(at: Valued, hessian: FloatArray, step: FloatArray, penalty: float) -> float:
    """The merit that the quadratic program promises."""
    ahead = at.constraints + at.slopes @ step
    return float(
        at.cost + at.slope @ step + 0.5 * step @ hessian @ step
        + penalty * max(0.0, float(ahead.max(initial=0.0)))
    )  # fmt: skip


def _step(
    at: Valued, hessian: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The step of the quadratic program, and the multipliers of the constraints."""
    reach = np.abs(at.slopes) @ np.maximum(np.abs(low), np.abs(high))
    near = at.constraints + reach > 0.0
    n, m = at.slope.size, int(near.sum())
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n] = hessian
    whole[n, n] = 1e-6
    slope = np.append(at.slope, PENALTY)
    unit = np.eye(n + 1)
    rows = np.vstack([np.hstack([at.slopes[near], -np.ones((m, 1))]), unit[:n], -unit])
    limits = np.concatenate([-at.constraints[near], high, -low, [0.0]])
    found, duals = solve(whole, slope, rows, limits)
    multipliers = np.zeros(at.constraints.size)
    multipliers[near] = duals[:m]
    return np.clip(found[:n], low, high), multipliers


def _updated(hessian: FloatArray, step: FloatArray, bend: FloatArray) -> FloatArray:
    """Damped BFGS: stays positive definite whatever the bend."""
    moved = hessian @ step
    curve = float(step @ moved)
    if curve <= 0.0:
        return hessian
    along = float(step @ bend)
    share = 1.0 if along >= 0.2 * curve else 0.8 * curve / (curve - along)
    bend = share * bend + (1.0 - share) * moved
    return np.asarray(
        hessian - np.outer(moved, moved) / curve + np.outer(bend, bend) / float(step @ bend)
    )
