"""Gauss-Newton steps, damped where the quadratic model cannot be trusted, within bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.choosing import whole
from piezo_opt.errors import InputError
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.solvers.base import Solution

FloatArray = NDArray[np.float64]

_PATIENCE = 20
"""Iterations over which a crawl along a valley is judged."""

_SMALL = 1e-3
"""Share of its size below which an unknown is stepped straight: zero has no logarithm."""
_FAR = 1.5
"""Longest step of a logarithm."""
_NEAREST, _FARTHEST = float(np.expm1(-_FAR)), float(np.expm1(_FAR))
"""The same as a share of where it begins, down and up."""
_GROWTH = 4.0
"""Factor by which the damping grows at a refused step, three times as much at each further one:
a step refused lightly damped is refused by orders of magnitude."""
_FULL = 1e-12
"""Damping of a full step, which only keeps it from directions that rounding has made."""
_MOST = 1e-4
"""Least share of the cost that a step may promise to leave: a hundredth of the error. Where it says
less, the reading is anything but linear."""
_LIGHT = 1e-3
"""Damping up to which a step's predicted gain is what there is to be gained."""
_OPENING, _STALL = 5, 0.36
"""From so many iterations on a search that is too far off ends where one more lowers the cost by
less than this share (a fifth of the rms)."""
_SAME = 10.0
"""Change of the cost, in tolerances, up to which a refused step has changed nothing."""
_STILL = "no step lowers the cost further"
_DONE = "the cost would fall no further"


@final
@dataclass(frozen=True)
class LevenbergMarquardt:
    """Levenberg-Marquardt on exact sensitivities, projected onto the bounds.

        (J'J + lambda D) step = -J'r,   D = largest column norms so far

    Unknowns at a bound whose gradient points outward are left out of the step; where it would cross
    one, that unknown stops short and the step of the others is found anew beside it. The damping is
    updated by the gain ratio (after Nielsen). Natural frequencies and forces per mass step in their
    logarithms: the valley along which omega^2 and a force grow together is straight there.

    Args:
        iterations: most steps taken; with 0 the answer is the start.
        tolerance: relative decrease of the cost below which it has converged.
        beyond: rms [m] at which a search that has slowed down is given up; never by default.
        crawl: share by which twenty iterations must lower the cost, or the search ends: it is on
            its way along a valley whose end the data cannot see (half as much in the rms). 0 goes
            to the end of every valley, which takes three times as long there.

    References: More (1978), The Levenberg-Marquardt algorithm, Lecture Notes in Mathematics 630;
    Madsen, Nielsen & Tingleff (2004), Methods for Non-Linear Least Squares Problems, DTU, ch. 3;
    Kanzow, Yamashita & Fukushima (2004), J. Comput. Appl. Math. 172(2), 375-397 (bounds);
    Stark & Parker (1995), Computational Statistics 10(2), 129-141 (least squares within a box).
    """

    iterations: int = 200
    tolerance: float = 1e-9
    beyond: float = float("inf")
    crawl: float = 1e-3

    def __post_init__(self) -> None:
        whole(self.iterations, "LevenbergMarquardt: iterations", 0)
        for what in ("tolerance", "beyond", "crawl"):
            if not getattr(self, what) >= 0.0:
                raise InputError(
                    f"LevenbergMarquardt: {what} is {getattr(self, what)!r}: give 0 or more."
                )

    @property
    def name(self) -> str:
        """Name in tables."""
        return "levenberg_marquardt"

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum."""
        unknowns = objective.unknowns
        low, high, usual = unknowns.low, unknowns.high, ~unknowns.relative
        ends = np.stack([low, high])
        theta = unknowns.clip(start)
        point = objective.linearised(theta)
        cost = objective.cost_at(point)
        if not np.isfinite(cost):
            return Solution(
                theta, Ending.FAILED,
                "The simulation is not finite at the start values; give other ones "
                "(values={...}) or tighter bounds.",
            )  # fmt: skip
        objective.monitor.saw(theta, cost)
        objective.monitor.iterate(theta, objective.rms_at(point), point.readings)
        damping, growth = 1e-4, _GROWTH
        floor = 1e-30 * max(cost, 1e-300)
        norms = np.zeros(theta.size)
        history = [cost]
        for taken in range(self.iterations + 1):
            weighted = objective.robust(point)
            straight = usual | (theta < _SMALL * unknowns.scale)
            scale = np.where(straight, unknowns.scale, theta)
            if not weighted.usable:
                return Solution(
                    theta, Ending.FAILED,
                    "The sensitivities are not finite at the best point; tighten the bounds.",
                )  # fmt: skip
            slope, bend = weighted.normal
            gradient, normal = scale * slope, scale[:, None] * bend * scale
            now = np.sqrt(normal.diagonal())
            norms = np.where(straight, np.maximum(norms, now), now)
            held = np.where(gradient > 0, theta <= low, theta >= high) & (gradient != 0.0)
            moving = np.flatnonzero(~held & (now > 0.0))
            size = np.where(norms > 0, norms, 1.0)
            steepest = np.abs(gradient[moving] / size[moving]).max(initial=0.0)
            if moving.size == 0 or cost <= floor or steepest <= 1e-10 * np.sqrt(cost):
                return Solution(theta, Ending.CONVERGED, "the gradient vanished", point=point)
            reach = _reach(theta, straight, scale, ends, unknowns.scale)
            if taken == self.iterations:
                break
            while True:
                step = _step(normal, gradient, size, damping, moving, reach)
                along = np.where(straight, step, np.expm1(np.where(straight, 0.0, step)))
                trial = unknowns.clip(theta + along * scale)
                predicted = -float(gradient @ step + 0.5 * step @ normal @ step)
                if damping <= _LIGHT and 0.0 <= predicted <= self.tolerance * cost:
                    return Solution(theta, Ending.CONVERGED, _DONE, point=point)
                # Two steps of three are taken, and sensitivities that are carried along cost a
                # third: one that is refused loses less by them than one that is taken saves. It is
                # given up where its cost is above what even a search that has ended would bear.
                ahead = objective.linearised(trial, most=(1.0 + _SAME * self.tolerance) * cost)
                trial_cost = objective.cost_at(ahead)
                gain = (cost - trial_cost) / predicted if predicted > 0 else -1.0
                if gain > 1e-4:
                    break
                if predicted <= self.tolerance * cost and abs(trial_cost - cost) <= (
                    _SAME * self.tolerance * cost
                ):
                    return Solution(theta, Ending.CONVERGED, _STILL, point=point)
                damping, growth = damping * growth, 3.0 * growth
                if damping > 1e16:
                    return Solution(theta, Ending.CONVERGED, _STILL, point=point)
            decrease = cost - trial_cost
            damping = max(1e-14, damping * max(1.0 / 5.0, 1.0 - (2.0 * gain - 1.0) ** 3))
            growth = _GROWTH
            theta, cost = trial, trial_cost
            objective.monitor.saw(theta, cost)
            objective.monitor.iterate(theta, objective.rms_at(ahead), ahead.readings)
            if decrease <= self.tolerance * cost and predicted <= self.tolerance * cost:
                return Solution(theta, Ending.CONVERGED, "the cost stopped falling", point=ahead)
            history.append(cost)
            if len(history) > _PATIENCE and history[-1 - _PATIENCE] < (1.0 + self.crawl) * cost:
                return Solution(
                    theta, Ending.CONVERGED, "the cost falls only along a valley without end",
                    point=ahead,
                )  # fmt: skip
            slowed = len(history) > _OPENING and decrease < _STALL * history[-2]
            if slowed and objective.rms_at(ahead) > self.beyond:
                return Solution(
                    theta, Ending.LIMIT,
                    f"Given up after {len(history) - 1} iterations: still above the rms of "
                    f"{self.beyond:.3g} m that it was to reach, and hardly falling.",
                    point=ahead,
                )  # fmt: skip
            point = ahead
        step = _step(normal, gradient, size, _FULL, moving, reach)
        share = 1.0 + float(gradient @ step + 0.5 * step @ normal @ step) / cost
        return Solution(
            theta, Ending.LIMIT,
            f"Stopped after {self.iterations} iterations while the cost was still falling; go on "
            "with solve(question, start=fit), or raise iterations.",
            point=point, promised=max(share, _MOST),
        )  # fmt: skip


def _reach(
    theta: FloatArray,
    straight: NDArray[np.bool_],
    scale: FloatArray,
    ends: FloatArray,
    size: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """How far each unknown may step down and up, in its own coordinate.

    A bound is approached by nine tenths of the way and only touched from close by: a gate that
    jumps onto its null would take the derivatives of its shapes with it.
    """
    gap = ends - theta
    way = np.where(np.abs(gap) > 1e-4 * size, 0.9 * gap, gap) / scale
    logarithm = np.log1p(np.minimum(np.maximum(way, _NEAREST), _FARTHEST))
    way = np.where(straight, way, logarithm)
    return way[0], way[1]


def _step(
    normal: FloatArray, gradient: FloatArray, sizes: FloatArray, damping: float,
    moving: NDArray[np.intp], reach: tuple[FloatArray, FloatArray],
) -> FloatArray:  # fmt: skip
    """The damped step within reach.

    Whoever would go farthest beyond stops there and the step of the others is found anew, until all
    are within reach: merely cut off, it would leave the others on their way to a point that is no
    longer aimed at, and correlated ones uphill.
    """
    step = np.zeros(gradient.size)
    free = moving
    while free.size:
        size = sizes[free]
        pulled = gradient[free] + normal[free] @ step
        system = normal[free[:, None], free] / (size[:, None] * size)
        system.flat[:: free.size + 1] += damping
        step[free] = np.linalg.solve(system, -pulled / size) / size
        way = np.where(step[free] < 0, reach[0][free], reach[1][free])
        beyond = np.abs(step[free]) > np.abs(way)
        if not beyond.any():
            break
        wish = np.abs(step[free])
        first = int((wish / np.maximum(np.abs(way), 1e-9 * wish + 1e-300)).argmax())
        step[free] = 0.0
        step[free[first]] = way[first]
        free = np.delete(free, first)
    return step
