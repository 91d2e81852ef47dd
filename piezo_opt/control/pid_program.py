"""The nonlinear program of a PID: cost, constraints and their exact slopes by the gains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

import control
import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.assembly import assemble
from piezo_opt.control.closed_loop import ClosedLoop, Limits, close_loop
from piezo_opt.control.cost import Criterion, integral, variation
from piezo_opt.control.linearise import linearise
from piezo_opt.control.margins import frequencies, response, sampled
from piezo_opt.control.pid import PID, PIDLaw
from piezo_opt.control.plant import ModelPlant, system_of
from piezo_opt.control.rollout import Rollout, Run, Setting
from piezo_opt.control.sqp import Valued
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

_WIDE: Final = np.log(1e5)
"""Half width of the search in the logarithm of each gain around its scale."""
_CALM: Final = 3.0
"""Sensitivity peak from which on a start is taken back: beyond, a loop rings."""
_HALVINGS: Final = 60
"""Of the gains, before it is said that no start is stable: 1e-18 of them."""
_PEAKS: Final = 3
"""Of the sensitivity that are bounded: a loop with one resonance has one below it, one above it and
one at the highest frequencies."""


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
class PIDProgram:
    """Cost and constraints over the logarithms of kp, ki, kd, tau in units of the plant's.

    Args:
        plant: what is controlled, ``model`` without its delay, ``values`` of the user's.
        draws: scenarios; without them the plant's own values are the only one.
        asked: the task.
    """

    def __init__(
        self, plant: Fit | Model, model: Model, values: Mapping[str, float] | None,
        draws: Sequence[Values], asked: Asked,
    ) -> None:  # fmt: skip
        known = plant.values.of_record(0) if isinstance(plant, Fit) else Values()
        self.numbers: Mapping[str, float] = {
            k: v for k, v in {**known, **(values or {})}.items() if k in model.parameters
        }
        self.asked, self.model, self.simulations = asked, model, 0
        system, own = system_of(model, self.numbers)
        nominal = Values.nominal(model)
        sets = [nominal.with_({**d.of_record(0), **(values or {})}) for d in draws]
        self._p = [s.vector(system.parameter_names) for s in sets] or [own]
        self._rollout = Rollout(assemble(model, {}), PIDLaw())
        self._settings = tuple(self._setting(k, r) for k, r in enumerate(asked.references))
        known_as = [*sets] or [Values(self.numbers)]
        linear = [linearise(model, s, at=asked.at) for s in known_as]
        self._matrices = [sampled(one, asked.period, asked.delay) for one in linear]
        self._turn = np.exp(1j * frequencies(asked.period) * asked.period)
        self._responses = np.array([response(one, self._turn) for one in self._matrices])
        self._slowest = _slowest(linear[0])
        gain = float(np.asarray(linear[0].dcgain()).real.ravel()[0])
        if not np.isfinite(gain) or gain == 0.0:
            raise InputError("The position does not follow the drive: there is nothing to tune.")
        if gain < 0.0:
            raise InputError(
                "The position falls with the drive, and a PID takes gains from 0 on: turn the sign "
                "of the drive round."
            )
        for one in asked.references:
            if asked.overshoot is not None and one[-1] == one[0]:
                raise InputError("A reference that ends where it began has no overshoot to bound.")
            if not one.any() and not np.any(asked.disturbance) and not asked.noise:
                raise InputError("A reference that is zero throughout asks for nothing.")
        t = asked.period
        self.scale = np.array([1.0 / gain, 1.0 / (gain * t), t / gain, t])
        self.low = np.array([-_WIDE, -_WIDE, -_WIDE, np.log(0.1)])
        self.high = np.array([_WIDE, _WIDE, _WIDE, np.log(1e3)])
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

    def guesses(self) -> tuple[FloatArray, ...]:
        """Unknowns of two starts: a slow integral, and zeros on the plant's slowest two poles.

        u = k int (e + 2 zeta e' / omega + e'' / omega^2),  k = 1 / (4 (1 + delay) T d)
        """
        reach, t = 4.0 * (1.0 + self.asked.delay), self.asked.period
        slow = np.array([0.1, 1.0, 0.01, reach]) / reach
        twice, square = self._slowest
        lead = np.array([max(twice / t, 0.1), 1.0, max(square / t**2, 0.01), reach]) / reach
        return tuple(
            np.clip(np.log(one), self.low, self.high) for one in (slow, lead)
        )  # fmt: skip

    def unknowns(self, controller: PID) -> FloatArray:
        """Of given gains; what is zero there begins at the bound."""
        gains = np.array([controller.kp, controller.ki, controller.kd, controller.tau])
        with np.errstate(divide="ignore"):
            return np.asarray(np.clip(np.log(gains / self.scale), self.low, self.high))

    def controller(self, theta: FloatArray) -> PID:
        """The PID of unknowns."""
        return PID(*(self.scale * np.exp(theta)).tolist())

    def stable(self, theta: FloatArray) -> FloatArray:
        """The same gains, halved until every scenario's linear loop is stable and calm.

        Raises:
            InputError: none is.
        """
        for _ in range(_HALVINGS):
            gains = self.scale * np.exp(theta)
            if self._steady(gains):
                height = self._peaks(gains)[0].max()
                if height <= max(_CALM, self.asked.peak or 0.0):
                    return theta
            theta = theta - np.array([1.0, 1.0, 1.0, 0.0]) * np.log(2.0)
        raise InputError("No gains were found for which the loop is stable: the plant is not.")

    def bare(self, theta: FloatArray) -> Valued | None:
        """Cost and constraints as :meth:`evaluate` gives them, all slopes zero."""
        return self.evaluate(theta, slopes=False)

    def evaluate(self, theta: FloatArray, *, slopes: bool = True) -> Valued | None:
        """Cost, constraints and slopes; None where a linearised loop is unstable."""
        gains = self.scale * np.exp(theta)
        if not self._steady(gains):
            return None
        a, n = self.asked, len(self._p) * len(self._settings)
        cost, slope, hessian = 0.0, np.zeros(4), np.zeros((4, 4))
        rows: list[tuple[float, FloatArray]] = []
        for p in self._p:
            for setting, unit in zip(self._settings, self._unit, strict=True):
                run = self._rollout.run(p, gains, setting, slopes=slopes)
                self.simulations += 1
                error, by = setting.reference - run.position, -run.position_by * gains
                value, outer = integral(a.criterion, error, a.period)
                cost += value / unit / n
                slope += outer @ by / unit / n
                weight = np.abs(outer) / np.maximum(np.abs(error), 0.05 * np.mean(np.abs(error)))
                hessian += by.T @ (weight[:, np.newaxis] * by) / unit / n
                if a.effort:
                    size = setting.reference.size * self._volt**2
                    moved, moves = variation(run.drive, setting.drive)
                    cost += a.effort * moved / size / n
                    slope += a.effort * moves @ (run.drive_by * gains) / size / n
                rows += self._limited(run, setting, gains)
        if a.peak is not None:
            heights, steeps = self._peaks(gains)
            rows += [
                (h / a.peak - 1.0, s / a.peak)
                for h, s in zip(heights.ravel(), steeps.reshape(-1, 4), strict=True)
            ]
        bound = np.array([v for v, _ in rows])
        bounds = np.array([s for _, s in rows]).reshape(-1, 4)
        # The logarithm of a cost that spans decades is nearly linear in those of the gains.
        slope, hessian = slope / cost, hessian / cost + 1e-6 * np.eye(4)
        return Valued(float(np.log(cost)), slope, bound, bounds, hessian)

    def _limited(
        self, run: Run, setting: Setting, gains: FloatArray
    ) -> list[tuple[float, FloatArray]]:  # fmt: skip
        """Overshoot and drive of one loop above what is allowed, relative, with their slopes."""
        a, rows = self.asked, []
        if a.overshoot is not None:
            goal = setting.reference[-1]
            step = goal - run.position[0]
            k = int(np.argmax((run.position - goal) / step))
            rows.append(
                ((run.position[k] - goal) / step - a.overshoot, run.position_by[k] * gains / step)
            )
        if a.drive is not None:
            k = int(np.argmax(run.drive))
            rows.append((run.drive[k] / a.drive - 1.0, run.drive_by[k] * gains / a.drive))
        return rows

    def _peaks(self, gains: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The highest sensitivity peaks (S, k) of the scenarios, and their slopes (S, k, 4).

        Several of each: where two are as high, the highest alone would have a corner.
        """
        kp, ki, kd, tau = gains
        t, z = self.asked.period, self._turn
        whole = t / 2.0 * (z + 1.0) / (z - 1.0)
        change = (z - 1.0) / ((tau + t) * z - tau)
        # d/dtau of (z - 1)/((tau + T) z - tau) is -change^2.
        by = np.array([np.ones_like(z), whole, change, -kd * change * change])
        law = kp + ki * whole + kd * change
        away = 1.0 / (1.0 + self._responses * law)
        size = np.abs(away)
        padded = np.pad(size, ((0, 0), (1, 1)), constant_values=-1.0)
        tops = np.where((size >= padded[:, :-2]) & (size >= padded[:, 2:]), size, -1.0)
        at = np.argsort(-tops, axis=1)[:, :_PEAKS]
        rows = np.arange(at.shape[0])[:, np.newaxis]
        there, plant = away[rows, at], self._responses[rows, at]
        moved = -(there * there * plant)[..., np.newaxis] * by[:, at].transpose(1, 2, 0)
        slopes = np.real(np.conj(there)[..., np.newaxis] * moved) / np.abs(there)[..., np.newaxis]
        return np.abs(there), slopes * gains

    def _steady(self, gains: FloatArray) -> bool:
        """Whether every scenario's linearised loop has its poles inside the unit circle."""
        kp, ki, kd, tau = gains
        t = self.asked.period
        half, hold = ki * t / 2.0, tau + t
        # Memory: integral, slope, last error.
        inner = np.array([[1.0, 0.0, half], [0.0, tau / hold, -1.0 / hold], [0.0, 0.0, 0.0]])
        into = np.array([half, 1.0 / hold, 1.0])
        out = np.array([1.0, kd * tau / hold, half - kd / hold])
        through = kp + half + kd / hold
        for a, b, c in self._matrices:
            whole = np.block([[a - through * b @ c, b * out], [-into[:, np.newaxis] @ c, inner]])
            if np.abs(np.linalg.eigvals(whole)).max() >= 1.0:
                return False
        return True

    def in_units(self, theta: FloatArray) -> float:
        """The criterion's mean over references and scenarios, in its own units."""
        gains, a = self.scale * np.exp(theta), self.asked
        values = [
            integral(a.criterion, s.reference - run.position, a.period)[0]
            for p in self._p
            for s in self._settings
            for run in [self._rollout.run(p, gains, s, slopes=False)]
        ]
        return float(np.mean(values))

    def violated(self, gains: PID) -> FloatArray:
        """(S,) the largest relative violation in each scenario; below 0 where all hold."""
        theta = self.unknowns(gains)
        at = self.evaluate(theta)
        if at is None:
            return np.ones(len(self._p))
        scenarios = len(self._p)
        peaks = 0 if self.asked.peak is None else _PEAKS * scenarios
        split = at.constraints.size - peaks
        rows = [at.constraints[:split].reshape(scenarios, -1)]
        rows.append(at.constraints[split:].reshape(scenarios, -1))
        return np.asarray(np.hstack(rows).max(axis=1, initial=-1.0))

    def loops(self, controller: PID) -> tuple[ClosedLoop, ...]:
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


def _slowest(system: control.StateSpace) -> tuple[float, float]:
    """(2 zeta / omega, 1 / omega^2) of (1 + ...) with the two slowest poles of a plant.

    One pole gives (1 / |p|, 0), none (0, 0); poles at the origin are left out.
    """
    poles = np.asarray(system.poles())
    poles = poles[np.abs(poles) > 0.0]
    poles = poles[np.argsort(np.abs(poles))][:2]
    slow = -1.0 / poles
    return float(slow.sum().real), float(np.prod(slow).real) if slow.size == 2 else 0.0
