"""One side of a profile: outward from the estimate until the data object."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.identification.log import Entry
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.result import Fit
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.unknowns import Unknowns
from piezo_opt.lazy import lazy

FloatArray = NDArray[np.float64]

_STRIDES: Final = 3
"""Steps to the limit where the model is linear: enough to see that it is not."""
_MOST: Final = 40
"""Points of one side; a side that doubles its stride meets any bound before."""
_CLOSE: Final = 0.02
"""Distance of tau from its limit, as a share, at which the end is read off the curve between the
points: the curve is smooth, and what is left is of third order in this."""
_MARGIN: Final = 0.02
"""Share of a bracket near whose ends another point tells nothing new."""
_NARROW: Final = 1e-4
"""Width of the bracket over its distance, at which its middle is the end: tau jumps there."""
_FAR: Final = 1e3
"""Limits beyond which tau is not told apart: a simulation that diverges has none."""
_LOWER: Final = 1e-6
"""Share of the cost by which another minimum must lie below the fit to be one."""


@final
@dataclass(frozen=True, eq=False)
class Walk:
    """What all walks of a profile share.

    Attributes:
        fit: the fit.
        unknown: its unknowns (k).
        centre: (k,) the estimates.
        limit: |tau| at which a walk ends.
    """

    fit: Fit
    unknown: Unknowns
    centre: FloatArray
    limit: float

    def objective(self, unknown: Unknowns) -> Objective:
        """The fit's own cost on its own sub-steps."""
        fit = self.fit
        monitor = Monitor(unknown.names)
        return Objective(fit.question, unknown, self.centre, monitor, accuracy=fit.accuracy)

    @lazy
    def least(self) -> float:
        """Cost at the estimate."""
        objective = self.objective(self.unknown)
        return objective.cost(objective.residual(self.centre))

    @lazy
    def plain_std(self) -> FloatArray:
        """(k,) deviations as if the residuals were white; infinite for what is not seen."""
        objective = self.objective(self.unknown)
        point = objective.robust(objective.linearised(self.centre))
        scaled = point.jacobian * self.unknown.scale
        free = np.array([n not in self.fit.at_bound for n in self.unknown.names])
        freedom = max(1, objective.samples - self.centre.size)
        variance = float(point.residual @ point.residual) / freedom
        _, size, right = np.linalg.svd(scaled[:, free], full_matrices=False)
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = np.sqrt(variance * np.sum((right.T / size) ** 2, axis=1))
        std = np.full(self.centre.size, np.inf)
        std[free] = spread * self.unknown.scale[free]
        return std

    def inflation(self, index: int) -> float:
        """How many times larger the fit's deviation is for correlated residuals, at least 1."""
        stated = self.fit.std[self.unknown.names[index]]
        ratio = stated / self.plain_std[index]
        return float(max(1.0, ratio)) if self.fit.coloured and np.isfinite(ratio) else 1.0


def walk(task: Walk, job: tuple[int, int]) -> Entry:
    """Hold one unknown ever farther from its estimate and fit the others there.

    Args:
        task: what all walks share.
        job: index of the unknown, and -1 or 1 for the direction.

    Returns:
        an entry with ``values`` and ``tau`` on the way, ``end`` (NaN where there is none) and
        ``remark``.
    """
    index, sign = job
    bound = float((task.unknown.low if sign < 0 else task.unknown.high)[index])
    start = float(task.centre[index])
    std = float(task.plain_std[index]) * task.inflation(index)
    size = max(abs(start), task.unknown.scale[index])
    stride = min(task.limit * std, size) / _STRIDES
    way = _Way([start], [0.0], [task.centre])
    remark = ""
    while len(way.values) <= _MOST and way.taus[-1] < task.limit and way.values[-1] != bound:
        trial = way.values[-1] + sign * stride
        trial = min(trial, bound) if sign > 0 else max(trial, bound)
        if trial == way.values[-1]:
            break
        if _held(task, index, trial, way):
            remark = "a lower cost was found on the way: solve again from there"
        # A linear model keeps its stride; where the others follow without resistance it doubles.
        if way.taus[-1] - way.taus[-2] < 0.5 * task.limit / _STRIDES:
            stride *= 2.0
    end = _crossing(task, index, way) if way.taus[-1] >= task.limit else float("nan")
    order = np.argsort(np.abs(np.array(way.values) - start))[1:]
    arrays = {"values": np.array(way.values)[order], "tau": sign * np.array(way.taus)[order]}
    return Entry(2 * index + (sign > 0), arrays, {"end": end, "remark": remark})


@final
@dataclass(frozen=True, eq=False)
class _Way:
    """Where a walk has been: values, sizes of tau, and all unknowns."""

    values: list[float]
    taus: list[float]
    thetas: list[FloatArray]

    def guess(self, value: float) -> FloatArray:
        """All unknowns at a value, on the line through the two points nearest to it."""
        near = np.argsort(np.abs(np.array(self.values) - value))[:2]
        one, two = (self.thetas[k] for k in near[[0, -1]])
        gap = self.values[near[-1]] - self.values[near[0]]
        share = (value - self.values[near[0]]) / gap if gap else 0.0
        return np.asarray(one + share * (two - one))


def _held(task: Walk, index: int, value: float, way: _Way) -> bool:
    """Fit the others at a value, which joins the way; whether they went below the fit."""
    members = list(task.unknown.members)
    members[index] = replace(members[index], low=value, high=value)
    unknown = replace(task.unknown, members=tuple(members))
    objective = task.objective(unknown)
    near = unknown.clip(way.guess(value))
    if not np.isfinite(objective.cost(objective.residual(near))):
        near = unknown.clip(way.thetas[-1])
    found = LevenbergMarquardt().minimise(objective, near)
    cost = objective.monitor.best_cost
    freedom = max(1, objective.samples - task.centre.size)
    variance = 2.0 * task.least / freedom
    above = max(0.0, 2.0 * (cost - task.least))
    tau = float(np.sqrt(above / variance)) / task.inflation(index) if variance > 0 else np.inf
    way.values.append(value)
    way.taus.append(min(tau, _FAR * task.limit))
    way.thetas.append(found.theta)
    return cost < (1.0 - _LOWER) * task.least


def _crossing(task: Walk, index: int, way: _Way) -> float:
    """Where tau is at its limit; points that are fitted on the way join the others.

    Between the last point within and the first one beyond: where a smooth curve through all points
    says, or in the middle where that is no progress.
    """
    start = way.values[0]
    for _ in range(_MOST):
        order = np.argsort(np.abs(np.array(way.values) - start))
        at, size = np.array(way.values)[order], np.array(way.taus)[order]
        beyond = int(np.argmax(size >= task.limit))
        rising, first = np.unique(np.maximum.accumulate(size[: beyond + 1]), return_index=True)
        inner, outer = at[beyond - 1], at[beyond]
        end = float(scipy.interpolate.PchipInterpolator(rising, at[first])(task.limit))
        if np.min(np.abs(size - task.limit)) <= _CLOSE * task.limit:
            return end
        share = (end - inner) / (outer - inner)
        if not _MARGIN < share < 1.0 - _MARGIN:
            end = float(0.5 * (inner + outer))
        if abs(outer - inner) <= _NARROW * abs(outer - start):
            return end
        _held(task, index, end, way)
    return end
