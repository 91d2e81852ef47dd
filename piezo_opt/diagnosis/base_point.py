"""A fit as the point from which absent effects are scored."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.colour import Colour
from piezo_opt.effects.base import Effect
from piezo_opt.identification import Fit, Start
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.shapes import resolving, shape_grid
from piezo_opt.identification.tall import triangle
from piezo_opt.identification.unknowns import theta_of, unknowns
from piezo_opt.lazy import lazy
from piezo_opt.simulation import Initial, Simulator, Substeps

FloatArray = NDArray[np.float64]

_LARGEST = float(np.finfo(np.float64).max) ** 0.25
"""Derivative of a reading [m] by an unknown up to which sums of squares are numbers. One that
explodes (a state far faster than the steps) says nothing."""
GONE = 1e-6
"""Share of a column, or of its square, below which other columns have explained it away: far more
than rounding and the error of a linearisation leave of it, far less than a record would show."""
ROUGH = 1e-3
"""Error of the scheme, as a share of the reading's range, in the directions of absent effects."""


@final
@dataclass(frozen=True, eq=False)
class Direction:
    """How the reading moves when a gate is opened, for one set of shapes.

    Attributes:
        shapes: own shape values.
        whole: (M,) derivative of the counted readings by the gate.
        projected: (M,) what is left after the fitted parameters have explained their share.
    """

    shapes: dict[str, float]
    whole: FloatArray
    projected: FloatArray


@final
class BasePoint:
    """Residual, Jacobian and their projector at a fit; derivatives by absent gates.

    Args:
        fit: the fit.
        sharp: derivatives by absent gates as exact as the fit itself, else to 0.1 %.
        colour: of the noise; residual, Jacobian and directions are those after its filter.
    """

    def __init__(self, fit: Fit, *, sharp: bool = False, colour: Colour | None = None) -> None:
        self.fit = fit
        counted = tuple(int(record.counted.sum()) for record in fit.records)
        self.colour = Colour.white(counted) if colour is None else colour
        weights = fit.question.weights or (1.0,) * len(counted)
        self._weight = np.repeat(np.sqrt(weights), counted)
        self.question = fit.question
        start = {**fit.values}
        self._unknowns = unknowns(self.question, fit.values)
        theta = theta_of(self._unknowns, start)
        self._sharp = sharp
        self._objective = Objective(
            self.question, self._unknowns, theta, Monitor(fit.names), accuracy=fit.accuracy
        )
        point = self._objective.linearised(theta)
        self._theta = theta
        m = self._objective.samples
        sane = np.abs(point.jacobian[:m]).max(axis=0, initial=0.0) < _LARGEST
        free = [k for k, n in enumerate(fit.names) if n not in fit.at_bound and sane[k]]
        scaled = self.colour.whitened((point.jacobian * self._unknowns.scale)[:m, free])
        norms = np.linalg.norm(scaled, axis=0)
        kept = norms > 1e-14 * norms.max(initial=0.0)
        columns = scaled[:, kept] / norms[kept]
        _, s, rows = np.linalg.svd(triangle(columns), full_matrices=False)
        seen = s > 1e-9 * s.max(initial=0.0)
        self._basis = columns @ (rows[seen].T / s[seen])
        self.residual = self.project(self.colour.whitened(-point.residual[:m]))
        """Measured minus modelled (M,), less what a Gauss-Newton step would still explain."""

    @property
    def samples(self) -> int:
        """Counted samples."""
        return self._objective.samples

    @property
    def basis(self) -> FloatArray:
        """(M, rank) orthonormal basis of what the fitted parameters explain."""
        return np.asarray(self._basis)

    @property
    def unknowns(self) -> int:
        """Rank of the Jacobian."""
        return int(self._basis.shape[1])

    def project(self, column: FloatArray) -> FloatArray:
        """What the fitted parameters do not explain of a column."""
        return np.asarray(column - self._basis @ (self._basis.T @ column))

    def directions(
        self, effect: Effect, grid: Sequence[Mapping[str, float]] | None = None
    ) -> Iterator[Direction]:
        """Derivatives by the gate of an effect that is not in the model, one for each shape.

        One after the other, because of a long record each is large. Shapes whose derivatives
        explode are left out.

        Args:
            effect: the effect.
            grid: own shape values to try; those that the record suggests unless given.

        Raises:
            ModelError: the model cannot take the effect.
        """
        model = self.question.model + effect
        name = model.names[-1]
        gate = f"{name}.{effect.gate}"
        null = effect.parameters[effect.gate or ""].null
        records = self.question.campaign.records
        if grid is None:
            grid = self.grid(effect)
        simulators: dict[tuple[float, float], list[Simulator]] = {}
        for shapes in grid:
            own = {f"{name}.{k}": v for k, v in shapes.items()}
            longest, farthest = key = resolving(effect, shapes)
            columns = []
            for index, record in enumerate(records):
                numbers = {
                    **{f"{name}.{k}": p.nominal for k, p in effect.parameters.items()},
                    **self._unknowns.of_record(index, self._theta),
                    **own,
                    gate: float(null if null is not None else 0.0),
                }
                if key not in simulators:
                    simulators[key] = []
                if len(simulators[key]) <= index:
                    base = self.substeps[index]
                    simulators[key].append(
                        Simulator(
                            model,
                            record,
                            numbers,
                            directions=(gate,),
                            initial=(
                                Initial.PERIODIC
                                if self.question.start_of(record) is Start.PERIODIC
                                else Initial.REST
                            ),
                            runtime=self.question.free,
                            substeps=replace(
                                base, longest=min(base.longest, longest), farthest=farthest
                            ),
                        )
                    )
                _, slope = simulators[key][index].with_sensitivities(numbers)
                columns.append(slope[record.counted, 0])
            whole = self.colour.whitened(self._weight * np.concatenate(columns))
            if not np.abs(whole).max(initial=0.0) < _LARGEST:
                continue
            yield Direction(dict(shapes), whole, self.project(whole))

    @lazy
    def substeps(self) -> tuple[Substeps, ...]:
        """Those on which derivatives by absent gates are simulated, for each record.

        A direction need not be as sharp as the residual that it is held against, unless it is to
        be told from what the fitted parameters do exactly.

        Raises:
            ModelError: no sub-steps make the simulation finite.
        """
        if self._sharp:
            return tuple(accuracy.substeps for accuracy in self.fit.accuracy)
        return tuple(
            simulator.choose(self._unknowns.of_record(index, self._theta), ROUGH).substeps
            for index, simulator in enumerate(self._objective.simulators)
        )

    def grid(self, effect: Effect) -> list[dict[str, float]]:
        """Shape values that the records suggest for an absent effect."""
        record = self.question.campaign.records[0]
        return shape_grid(effect, record, record.position - self.fit.readings[0])
