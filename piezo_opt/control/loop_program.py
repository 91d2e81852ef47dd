"""The nonlinear program of a controller in its loop: cost, constraints and their exact slopes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeAlias, final

import control
import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.control.closed_loop import ClosedLoop, Limits, close_loop
from piezo_opt.control.cost import Criterion, integral, variation
from piezo_opt.control.linearise import linearise
from piezo_opt.control.margins import frequencies, response, sampled
from piezo_opt.control.plant import ModelPlant, system_of
from piezo_opt.control.rollout import Law, Rollout, Run, Setting
from piezo_opt.control.sqp import Valued
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]
Matrices: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""A, B, C, D of a sampled system with one input and one output."""

_CALM: Final = 3.0
"""Sensitivity peak from which on a start is taken back: beyond, a loop rings."""
_HALVINGS: Final = 60
"""Times that a start is made softer, before it is said that none is stable."""
_PEAKS: Final = 3
"""Of the sensitivity that are bounded: a loop with one resonance has one below it, one above it and
one at the highest frequencies."""
_STEP: Final = 1e-5
"""Of a central difference of the controller's own response, a rational function."""


@final
@dataclass(frozen=True, eq=False)
class Linear:
    """A plant for small motions, as a family of controllers begins with it.

    Attributes:
        continuous: the plant.
        sampled: A, B, C between drive and reading at the instants of sampling, delay included.
        period: [s].
        delay: whole periods.
        gain: of the plant at rest [m/V].
        rest: reading at rest without a drive [m].
    """

    continuous: control.StateSpace
    sampled: tuple[FloatArray, FloatArray, FloatArray]
    period: float
    delay: int
    gain: float
    rest: float


class Family(Protocol):
    """Controllers of one kind, as a function of unknowns theta (t,)."""

    @property
    def law(self) -> Law:
        """In the symbols of a program."""
        ...

    @property
    def low(self) -> FloatArray:
        """(t,) lower bounds."""
        ...

    @property
    def high(self) -> FloatArray:
        """(t,) upper bounds."""
        ...

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user is told of how the plant was taken."""
        ...

    def gains(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(g,) gains of the law, and their slopes (g, t)."""
        ...

    def linear(self, gains: FloatArray) -> Matrices:
        """The controller from the error to the drive, away from the limits."""
        ...

    def guesses(self) -> tuple[FloatArray, ...]:
        """Where to begin."""
        ...

    def softer(self, theta: FloatArray) -> FloatArray:
        """Gains of about half the size."""
        ...

    def calmer(self, theta: FloatArray, by: float) -> FloatArray:
        """Weaker feedback, by a factor of about exp(by), with the same filter."""
        ...

    def unknowns(self, given: Any) -> FloatArray:
        """Of what a user gives as a start."""
        ...

    def controller(self, theta: FloatArray) -> Any:
        """The controller of unknowns."""
        ...


@final
@dataclass(frozen=True, eq=False)
class Asked:
    """What the loop is asked to do; see :func:`~piezo_opt.control.tune_pid`."""

    references: tuple[FloatArray, ...]
    period: float
    limits: Limits
    delay: int
    criterion: Criterion
    effort: float
    overshoot: float | None
    drive: float | None
    peak: float | None
    noise: float
    disturbance: ArrayLike
    seed: int
    at: float


@final
class LoopProgram:
    """Cost and constraints over the unknowns of a family of controllers.

    Args:
        model: what is controlled, without its delay.
        numbers: a value for every parameter of it.
        draws: the same of scenarios; without them the plant's own values are the only one.
        asked: the task.
        family: makes the family for the plant.

    Raises:
        InputError: the position does not follow the drive, or falls with it; a reference that asks
            for nothing.
    """

    def __init__(
        self, model: Model, numbers: Values, draws: Sequence[Values], asked: Asked,
        family: Callable[[Linear], Family],
    ) -> None:  # fmt: skip
        self.numbers, self.asked, self.model, self.simulations = numbers, asked, model, 0
        sets = [*draws] or [numbers]
        system, _ = system_of(model, numbers)
        self._p = [s.vector(system.parameter_names) for s in sets]
        linear = [linearise(model, s, at=asked.at) for s in sets]
        own = linear[0] if not draws else linearise(model, numbers, at=asked.at)
        self._matrices = [sampled(one, asked.period, asked.delay) for one in linear]
        self._turn = np.exp(1j * frequencies(asked.period) * asked.period)
        self._responses = np.array([response(one, self._turn) for one in self._matrices])
        gain = float(np.asarray(own.dcgain()).real.ravel()[0])
        if not np.isfinite(gain) or gain == 0.0:
            raise InputError("The position does not follow the drive: there is nothing to tune.")
        if gain < 0.0:
            raise InputError(
                "The position falls with the drive, and a controller takes gains from 0 on: turn "
                "the sign of the drive round."
            )
        for one in asked.references:
            if asked.overshoot is not None and one[-1] == one[0]:
                raise InputError("A reference that ends where it began has no overshoot to bound.")
            if not one.any() and not np.any(asked.disturbance) and not asked.noise:
                raise InputError("A reference that is zero throughout asks for nothing.")
        self.family = family(
            Linear(
                own,
                sampled(own, asked.period, asked.delay),
                asked.period,
                asked.delay,
                gain,
                ModelPlant(model, numbers).begin(0.0),
            )
        )
        self._size = self.family.low.size
        self._rollout = Rollout(system, self.family.law, self._size)
        self._settings = tuple(self._setting(k, r) for k, r in enumerate(asked.references))
        spans = [float(np.ptp(r)) or float(np.abs(r).max()) or 1.0 for r in asked.references]
        self._unit = self._units(spans)
        self._volt = max(spans) / gain

    def _setting(self, index: int, reference: FloatArray) -> Setting:
        a, n = self.asked, reference.size
        generator = np.random.default_rng(a.seed + index)
        added = np.broadcast_to(np.asarray(a.disturbance, dtype=float), (n,))
        return Setting(
            reference, a.period, a.limits, a.delay, added, a.noise * generator.normal(size=n)
        )

    def _units(self, spans: Sequence[float]) -> FloatArray:
        """What each reference's criterion is measured in."""
        n = np.array([r.size for r in self.asked.references])
        size, seconds = np.array(spans), n * self.asked.period
        return {
            Criterion.IAE: size * seconds,
            Criterion.ISE: size**2 * seconds,
            Criterion.ITAE: size * seconds**2 / 2.0,
        }[self.asked.criterion]

    def stable(self, theta: FloatArray) -> FloatArray:
        """The same controller, made softer until every scenario's linear loop is stable and calm.

        Raises:
            InputError: none is.
        """
        for _ in range(_HALVINGS):
            gains, _ = self.family.gains(theta)
            if self._steady(gains):
                height = self._peaks(gains)[0].max()
                if height <= max(_CALM, self.asked.peak or 0.0):
                    return theta
            theta = np.clip(self.family.softer(theta), self.family.low, self.family.high)
        raise InputError("No gains were found for which the loop is stable: the plant is not.")

    def steady(self, theta: FloatArray) -> bool:
        """Whether every scenario's linearised loop is stable."""
        return self._steady(self.family.gains(theta)[0])

    @property
    def low(self) -> FloatArray:
        """Lower bounds of the unknowns."""
        return self.family.low

    @property
    def high(self) -> FloatArray:
        """Upper bounds of the unknowns."""
        return self.family.high

    def transfer(self, theta: FloatArray) -> control.StateSpace:
        """The controller from the error to the drive, sampled."""
        return control.ss(*self.family.linear(self.family.gains(theta)[0]), self.asked.period)

    def bare(self, theta: FloatArray) -> Valued | None:
        """Cost and constraints as :meth:`evaluate` gives them, all slopes zero."""
        return self.evaluate(theta, slopes=False)

    def evaluate(self, theta: FloatArray, *, slopes: bool = True) -> Valued | None:
        """Cost, constraints and slopes; None where a linearised loop is unstable."""
        gains, by_theta = self.family.gains(theta)
        if not self._steady(gains):
            return None
        seeds, size = by_theta if slopes else None, self._size
        a, n = self.asked, len(self._p) * len(self._settings)
        cost, slope, hessian = 0.0, np.zeros(size), np.zeros((size, size))
        rows: list[tuple[float, FloatArray]] = []
        for p in self._p:
            for setting, unit in zip(self._settings, self._unit, strict=True):
                run = self._rollout.run(p, gains, setting, seeds)
                self.simulations += 1
                error, by = setting.reference - run.position, -run.position_by
                value, outer = integral(a.criterion, error, a.period)
                cost += value / unit / n
                slope += outer @ by / unit / n
                weight = np.abs(outer) / np.maximum(np.abs(error), 0.05 * np.mean(np.abs(error)))
                hessian += by.T @ (weight[:, np.newaxis] * by) / unit / n
                if a.effort:
                    whole = setting.reference.size * self._volt**2
                    moved, moves = variation(run.drive, setting.drive)
                    cost += a.effort * moved / whole / n
                    slope += a.effort * moves @ run.drive_by / whole / n
                rows += self._limited(run, setting)
        if a.peak is not None:
            heights, steeps = self._peaks(gains, seeds)
            rows += [
                (h / a.peak - 1.0, s / a.peak)
                for h, s in zip(heights.ravel(), steeps.reshape(-1, size), strict=True)
            ]
        bound = np.array([v for v, _ in rows])
        bounds = np.array([s for _, s in rows]).reshape(-1, size)
        # The logarithm of a cost that spans decades is nearly linear in those of the gains.
        slope, hessian = slope / cost, hessian / cost + 1e-6 * np.eye(size)
        return Valued(float(np.log(cost)), slope, bound, bounds, hessian)

    def _limited(self, run: Run, setting: Setting) -> list[tuple[float, FloatArray]]:
        """Overshoot and drive of one loop above what is allowed, relative, with their slopes."""
        a, rows = self.asked, []
        if a.overshoot is not None:
            goal = setting.reference[-1]
            step = goal - run.position[0]
            k = int(np.argmax((run.position - goal) / step))
            rows.append(((run.position[k] - goal) / step - a.overshoot, run.position_by[k] / step))
        if a.drive is not None:
            k = int(np.argmax(run.drive))
            rows.append((run.drive[k] / a.drive - 1.0, run.drive_by[k] / a.drive))
        return rows

    def _peaks(
        self, gains: FloatArray, seeds: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """The highest sensitivity peaks (S, k) of the scenarios, and their slopes (S, k, t).

        Several of each: where two are as high, the highest alone would have a corner.
        """
        law = _response(self.family.linear(gains), self._turn)
        away = 1.0 / (1.0 + self._responses * law)
        size = np.abs(away)
        padded = np.pad(size, ((0, 0), (1, 1)), constant_values=-1.0)
        tops = np.where((size >= padded[:, :-2]) & (size >= padded[:, 2:]), size, -1.0)
        at = np.argsort(-tops, axis=1)[:, :_PEAKS]
        rows = np.arange(at.shape[0])[:, np.newaxis]
        there, plant = away[rows, at], self._responses[rows, at]
        steeps = np.zeros((*at.shape, self._size))
        if seeds is not None:
            z = self._turn[at].ravel()
            for k, step in enumerate(_STEP * seeds.T):
                up, down = (
                    _response(self.family.linear(gains + s * step), z).reshape(at.shape)
                    for s in (1.0, -1.0)
                )
                moved = -(there * there * plant) * (up - down) / (2.0 * _STEP)
                steeps[..., k] = np.real(np.conj(there) * moved) / np.abs(there)
        return np.abs(there), steeps

    def _steady(self, gains: FloatArray) -> bool:
        """Whether every scenario's linearised loop has its poles inside the unit circle."""
        if not np.isfinite(gains).all():
            return False
        inner, into, out, through = self.family.linear(gains)
        for a, b, c in self._matrices:
            whole = np.block([[a - b @ through @ c, b @ out], [-into @ c, inner]])
            if np.abs(np.linalg.eigvals(whole)).max() >= 1.0:
                return False
        return True

    def in_units(self, theta: FloatArray) -> float:
        """The criterion's mean over references and scenarios, in its own units."""
        (gains, _), a = self.family.gains(theta), self.asked
        values = [
            integral(a.criterion, s.reference - run.position, a.period)[0]
            for p in self._p
            for s in self._settings
            for run in [self._rollout.run(p, gains, s)]
        ]
        return float(np.mean(values))

    def violated(self, theta: FloatArray) -> FloatArray:
        """(S,) the largest relative violation in each scenario; below 0 where all hold."""
        at = self.bare(theta)
        if at is None:
            return np.ones(len(self._p))
        scenarios = len(self._p)
        peaks = 0 if self.asked.peak is None else _PEAKS * scenarios
        split = at.constraints.size - peaks
        rows = [at.constraints[:split].reshape(scenarios, -1)]
        rows.append(at.constraints[split:].reshape(scenarios, -1))
        return np.asarray(np.hstack(rows).max(axis=1, initial=-1.0))

    def loops(self, controller: Any) -> tuple[ClosedLoop, ...]:
        """The loop on each reference, sample by sample, with the plant's own values."""
        a = self.asked
        return tuple(
            close_loop(
                ModelPlant(self.model, self.numbers), controller, s.reference, period=a.period,
                limits=a.limits, delay=a.delay, noise=a.noise, disturbance=s.disturbance,
                seed=a.seed + k,
            )
            for k, s in enumerate(self._settings)
        )  # fmt: skip


def _response(law: Matrices, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """C (z - A)^-1 B + D at points z."""
    return np.asarray(response(law[:3], z) + law[3][0, 0])
