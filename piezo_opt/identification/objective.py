"""Single shooting as a function: residuals of all records and their exact Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.problem import Identification, Loss, Shape, Start
from piezo_opt.identification.tall import inner, normal_equations, triangle
from piezo_opt.identification.unknowns import Unknowns
from piezo_opt.lazy import lazy
from piezo_opt.simulation import TOLERANCE, Accuracy, Initial, Simulator
from piezo_opt.simulation.accuracy import DIVERGED

FloatArray = NDArray[np.float64]

MOST_A_SAMPLE = 64
"""Sub-steps a sample beyond which a finer scheme costs more than it tells."""
ENOUGH_A_SAMPLE = 16
"""The same where models are compared, not estimated."""
OF_WHAT_IS_LEFT = 0.1
"""Error of the scheme over what is left, where models are compared: it adds half a per cent."""
FINEST = 1e-8
"""Scheme error as a share of the reading's range beyond which nothing is refined."""
_STRAYED = 0.5
"""Change of the reading over the residual at which sub-steps are too coarse even to compare, for an
eighth of the error is the scheme's..."""
_BEYOND = 4.0
"""...unless it is below so many times the error with which they were chosen."""


@final
@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals and their Jacobian at one point.

    Attributes:
        residual: (M,) modelled minus measured on counted samples [m], weighted; then one row for
            each prior, in units of the noise.
        jacobian: (M, k) by the unknowns in SI units.
        readings: modelled reading of each record, all samples [m].
    """

    residual: FloatArray
    jacobian: FloatArray
    readings: tuple[FloatArray, ...] = ()

    @lazy
    def squares(self) -> float:
        """``r'r``."""
        with np.errstate(over="ignore"):
            return inner(self.residual, self.residual)

    @lazy
    def normal(self) -> tuple[FloatArray, FloatArray]:
        """``J'r`` (k,) and ``J'J`` (k, k)."""
        return normal_equations(self.jacobian, self.residual)

    @lazy
    def root(self) -> FloatArray:
        """The triangle R (k, k) with ``R'R = J'J``, which keeps what that product rounds off."""
        return triangle(self.jacobian)

    @property
    def usable(self) -> bool:
        """Whether squares are finite: those of a simulation that diverges are not."""
        with np.errstate(over="ignore"):
            return bool(self.squares < DIVERGED and self.normal[1].trace() < DIVERGED)


@final
class Objective:
    """``r(theta)`` of a question, simulated from each record's start to its end.

    Args:
        question: the identification.
        unknowns: names, bounds and kept values.
        at: point at which the number of sub-steps is chosen.
        monitor: counts the simulations.
        tolerance: first admissible error of the scheme as a share of the reading's range.
        accuracy: sub-steps of each record, where they have been chosen before.
        most: sub-steps a sample at which the first choice ends.
        exact: whether chosen sub-steps may move linear blocks by their exponential.
    """

    def __init__(
        self,
        question: Identification,
        unknowns: Unknowns,
        at: FloatArray,
        monitor: Monitor,
        tolerance: float = TOLERANCE,
        accuracy: tuple[Accuracy, ...] = (),
        most: int = MOST_A_SAMPLE,
        exact: bool = False,
    ) -> None:
        self.question = question
        self.unknowns = unknowns
        self.monitor = monitor
        records = question.campaign.records
        weights = question.weights or (1.0,) * len(records)
        self._root_weights = [float(np.sqrt(w)) for w in weights]
        self._columns = [unknowns.columns(i) for i in range(len(records))]
        self.simulators = [
            Simulator(
                question.model, record, unknowns.of_record(i, at),
                directions=tuple(unknowns.members[k].local for k in self._columns[i]),
                initial=(
                    Initial.PERIODIC
                    if question.start_of(record) is Start.PERIODIC
                    else Initial.REST
                ),
                runtime=question.free,
                tolerance=tolerance,
                substeps=accuracy[i].substeps if accuracy else None,
                most=most * len(record),
                exact=exact,
            )
            for i, record in enumerate(records)
        ]  # fmt: skip
        for simulator, known in zip(self.simulators, accuracy, strict=bool(accuracy)):
            simulator.accuracy = known
        self.counted = [r.counted for r in records]
        self.samples = int(sum(c.sum() for c in self.counted))
        self._plain = set(self._root_weights) == {1.0} and all(c.all() for c in self.counted)
        self._priors = [(k, m.prior) for k, m in enumerate(unknowns.members) if m.prior is not None]

    @property
    def accuracy(self) -> tuple[Accuracy, ...]:
        """Sub-steps and scheme error of each record."""
        return tuple(s.accuracy for s in self.simulators)

    def refine(self, theta: FloatArray) -> bool:
        """Choose the sub-steps anew at a point; True when they had been too coarse.

        The scheme's error must stay far below what one standard deviation of an unknown does to the
        reading, rms / sqrt(N) over the record: its error looks just like a shift of the resonance.
        """
        coarser = False
        rms = self.rms(self.residual(theta))
        share = 0.1 * rms / np.sqrt(max(1, self.samples))
        for i, simulator in enumerate(self.simulators):
            theta_i = self.unknowns.of_record(i, theta)
            tolerance = self._tolerance(i, share)
            before = simulator.accuracy.substeps
            most = max(MOST_A_SAMPLE * self.counted[i].size, 4 * simulator.substeps(theta_i))
            chosen = simulator.choose(theta_i, tolerance, most)
            if chosen.substeps.longest < 0.99 * before.longest or (
                chosen.substeps.largest_move < 0.99 * before.largest_move
            ):
                coarser = True
            simulator.accuracy = chosen
        return coarser

    def _tolerance(self, i: int, error: float) -> float:
        """A scheme error [m] as a share of a record's range, no coarser than usual."""
        span = float(np.ptp(self.question.campaign.records[i].position)) or 1.0
        return float(np.clip(error / span, FINEST, TOLERANCE))

    def mended(self, theta: FloatArray, point: Linearised | None = None) -> bool:
        """Choose anew, at a point, sub-steps that have become far too coarse; True for any.

        Args:
            theta: the point.
            point: what is known there; simulated unless given.
        """
        readings = self.readings(theta) if point is None else point.readings
        astray = self.strayed(theta, readings)
        admissible = OF_WHAT_IS_LEFT * self.rms(self._residual(readings, theta))
        for i in astray:
            simulator = self.simulators[i]
            most = ENOUGH_A_SAMPLE * self.counted[i].size
            tolerance = self._tolerance(i, admissible)
            simulator.accuracy = simulator.choose(
                self.unknowns.of_record(i, theta), tolerance, most
            )
        return bool(astray)

    def strayed(self, theta: FloatArray, readings: Sequence[FloatArray]) -> list[int]:
        """Records whose sub-steps have become far too coarse, even to compare models by.

        Those are sub-steps that, each cut in two, change the reading by a good part of the
        residual, and by far more than where they were chosen.

        Args:
            theta: a point.
            readings: (N,) modelled readings there, of each record.
        """
        rms = self.rms(self._residual(readings, theta))
        astray = []
        for i, simulator in enumerate(self.simulators):
            span = float(np.ptp(self.question.campaign.records[i].position))
            change = simulator.halving(self.unknowns.of_record(i, theta), readings[i])
            chosen_for = max(simulator.accuracy.error, FINEST * span)
            if not change <= max(_STRAYED * rms, _BEYOND * chosen_for):
                astray.append(i)
        return astray

    def readings(self, theta: FloatArray, most: float = np.inf) -> list[FloatArray]:
        """Modelled reading of each record, all samples; ``most`` as for :meth:`linearised`."""
        self.monitor.simulations += len(self.simulators)
        readings: list[FloatArray] = []
        for i, simulator in enumerate(self.simulators):
            ceiling = self._ceiling(readings, most)
            readings.append(simulator.reading(self.unknowns.of_record(i, theta), ceiling))
        return readings

    def residual(self, theta: FloatArray, most: float = np.inf) -> FloatArray:
        """Residuals at a point, as in :class:`Linearised`; ``most`` as for :meth:`linearised`."""
        return self._residual(self.readings(theta, most), theta)

    def _ceiling(self, known: Sequence[FloatArray], most: float) -> float | None:
        """Sum of squares of the next record's misfit from which on the cost is above ``most``.

        Args:
            known: modelled readings of the records before it.
            most: the cost.
        """
        if most == np.inf or self.question.loss.shape is not Shape.SQUARE:
            return None
        with np.errstate(over="ignore"):
            spent = [np.sum(self._misfit(i, reading) ** 2) for i, reading in enumerate(known)]
        return (2.0 * most - float(sum(spent))) / self._root_weights[len(known)] ** 2

    def _misfit(self, index: int, reading: FloatArray) -> FloatArray:
        """Weighted residuals of one record on its counted samples."""
        off = reading - self.question.campaign.records[index].position
        if self._plain:
            return np.asarray(off)
        return np.asarray(self._root_weights[index] * off[self.counted[index]])

    def _residual(self, readings: Sequence[FloatArray], theta: FloatArray) -> FloatArray:
        return self._stacked([self._misfit(i, one) for i, one in enumerate(readings)], theta)

    def _stacked(self, parts: list[FloatArray], theta: FloatArray) -> FloatArray:
        if len(parts) == 1 and not self._priors:
            return parts[0]
        return np.concatenate([*parts, self._prior_rows(theta)])

    def linearised(self, theta: FloatArray, most: float = np.inf) -> Linearised:
        """Residuals and Jacobian at a point.

        Args:
            theta: the point.
            most: cost above which nobody wants to know more than that it is: residuals need not be
                finite then, and the Jacobian means nothing.
        """
        self.monitor.with_sensitivities += len(self.simulators)
        residuals, blocks = [], []
        readings: list[FloatArray] = []
        for i, simulator in enumerate(self.simulators):
            mask = self.counted[i]
            reading, slopes = simulator.with_sensitivities(
                self.unknowns.of_record(i, theta), self._ceiling(readings, most)
            )
            readings.append(reading)
            residuals.append(self._misfit(i, reading))
            if len(self.simulators) == 1 and self._plain:
                blocks.append(slopes)
                continue
            block = np.zeros((int(mask.sum()), theta.size))
            if np.isfinite(reading).all():
                block[:, self._columns[i]] = self._root_weights[i] * slopes[mask]
            blocks.append(block)
        if self._priors:
            noise = float(self.question.noise or 1.0)
            rows = np.zeros((len(self._priors), theta.size))
            for row, (k, prior) in enumerate(self._priors):
                rows[row, k] = noise / prior.std
            blocks.append(rows)
        residual = self._stacked(residuals, theta)
        jacobian = blocks[0] if len(blocks) == 1 else np.vstack(blocks)
        return Linearised(residual, jacobian, tuple(readings))

    def _prior_rows(self, theta: FloatArray) -> FloatArray:
        noise = float(self.question.noise or 1.0)
        return np.array([noise * (theta[k] - p.mean) / p.std for k, p in self._priors])

    def cost(self, residual: FloatArray) -> float:
        """Half the sum of the loss over the residuals [m^2]."""
        if self.question.loss.shape is Shape.SQUARE:
            with np.errstate(over="ignore"):
                squares = inner(residual, residual)
            if squares < DIVERGED:
                return 0.5 * squares
        # A diverging simulation is no better than an infinite one, and must not overflow.
        if not np.isfinite(residual).all() or float(np.abs(residual).max(initial=0.0)) > DIVERGED:
            return float("inf")
        return 0.5 * float(np.sum(_rho(residual, self.question.loss)))

    def cost_at(self, point: Linearised) -> float:
        """The same at a point, whose squares are summed once."""
        if self.question.loss.shape is Shape.SQUARE and point.squares < DIVERGED:
            return 0.5 * point.squares
        return self.cost(point.residual)

    def foreseen(self, point: Linearised, step: FloatArray) -> float:
        """The cost after a step, were the reading linear in the unknowns."""
        if self.question.loss.shape is Shape.SQUARE:
            slope, bend = point.normal
            return 0.5 * point.squares + float(slope @ step + 0.5 * step @ bend @ step)
        return self.cost(point.residual + point.jacobian @ step)

    def rms_at(self, point: Linearised) -> float:
        """The same as :meth:`rms` at a point."""
        if self._priors:
            return self.rms(point.residual)
        return float(np.sqrt(point.squares / max(1, self.samples)))

    def rms(self, residual: FloatArray) -> float:
        """Root mean square of the (weighted) residuals without prior rows [m]."""
        counted = residual[: self.samples]
        with np.errstate(over="ignore"):
            return float(np.sqrt(inner(counted, counted) / max(1, self.samples)))

    def robust(self, point: Linearised) -> Linearised:
        """Residual and Jacobian whose plain least squares step is that of the robust loss."""
        loss = self.question.loss
        if loss.shape is Shape.SQUARE:
            return point
        weight = np.sqrt(_rho_slope(point.residual, loss))
        slopes = weight[:, None] * point.jacobian
        return replace(point, residual=weight * point.residual, jacobian=slopes)


def _rho(residual: FloatArray, loss: Loss) -> FloatArray:
    if loss.shape is Shape.SQUARE:
        return residual**2
    z = (residual / loss.scale) ** 2
    if loss.shape is Shape.SOFT_L1:
        rho = 2.0 * (np.sqrt(1.0 + z) - 1.0)
    elif loss.shape is Shape.HUBER:
        rho = np.where(z <= 1.0, z, 2.0 * np.sqrt(np.maximum(z, 1.0)) - 1.0)
    else:
        rho = np.log1p(z)
    return np.asarray(loss.scale**2 * rho)


def _rho_slope(residual: FloatArray, loss: Loss) -> FloatArray:
    z = (residual / loss.scale) ** 2
    if loss.shape is Shape.SOFT_L1:
        return np.asarray(1.0 / np.sqrt(1.0 + z))
    if loss.shape is Shape.HUBER:
        return np.where(z <= 1.0, 1.0, 1.0 / np.sqrt(np.maximum(z, 1.0)))
    return np.asarray(1.0 / (1.0 + z))
