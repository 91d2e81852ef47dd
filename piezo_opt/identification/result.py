"""The answer: values with their uncertainty, what happened, and what the record cannot see."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError
from piezo_opt.files import replacing
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Evaluations, Outcome, Trace
from piezo_opt.identification.problem import Identification, Start, plain
from piezo_opt.identification.shapes import elsewhere
from piezo_opt.identification.solvers.levenberg_marquardt import LevenbergMarquardt
from piezo_opt.identification.tall import inner
from piezo_opt.identification.unknowns import Unknowns, theta_of, unknowns
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import INITIAL, Accuracy
from piezo_opt.units import show
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

SCHEMA = "piezo_opt/fit/1"
_CLOSE = 1e-5
"""Decrease of the cost at which the start of a record is known well enough to compare models."""


@final
@dataclass(frozen=True)
class StartResult:
    """One start of a multi-start: its number, where it led, and how."""

    index: int
    rms: float
    ending: str
    values: Mapping[str, float]
    evaluations: int


@final
@dataclass(frozen=True, eq=False)
class Fit:
    """Result of an identification.

    Attributes:
        question: what was asked.
        values: every value, estimated and kept, in SI units.
        names: the estimated unknowns.
        covariance: (k, k) of the unknowns, NaN rows for those at a bound.
        coloured: whether the covariance allows for correlated residuals.
        at_bound: unknowns that ended at a bound.
        readings: modelled reading (N,) [m] of each record, uncounted samples included.
        outcome: how it ended.
        trace: every iterate.
        evaluations: simulations spent.
        wall_s: seconds spent.
        blind: what the data cannot see, in sentences.
        remarks: what else the reader should know, in sentences.
        accuracy: sub-steps and scheme error for each record.
        compiled: whether machine code ran.
        solver, transcription: what was used.
        starts: results of a multi-start, best first; empty for one start.
    """

    question: Identification
    values: Values
    names: tuple[str, ...]
    covariance: FloatArray
    coloured: bool
    at_bound: tuple[str, ...]
    readings: tuple[FloatArray, ...]
    outcome: Outcome
    trace: Trace
    evaluations: Evaluations
    wall_s: float
    blind: tuple[str, ...]
    remarks: tuple[str, ...]
    accuracy: tuple[Accuracy, ...]
    compiled: bool
    solver: str
    transcription: str
    starts: tuple[StartResult, ...] = field(default=())

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self.question.model

    @property
    def records(self) -> tuple[Measurement, ...]:
        """The records fitted to."""
        return self.question.campaign.records

    def residual(self, index: int = 0) -> FloatArray:
        """Measured minus modelled on the counted samples of one record [m]."""
        record = self.records[index]
        return np.asarray((record.position - self.readings[index])[record.counted])

    @property
    def residuals(self) -> FloatArray:
        """Measured minus modelled on the counted samples of all records [m]."""
        # Not kept: a search has hundreds of fits, and each has its readings already.
        return np.concatenate([self.residual(i) for i in range(len(self.records))])

    @cached_property
    def rms(self) -> float:
        """Root mean square of the residuals [m]."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def fit_percent(self) -> float:
        """``100 (1 - |y - yhat| / |y - mean y|)`` over all records."""
        spread = np.concatenate(
            [r.position[r.counted] - r.position[r.counted].mean() for r in self.records]
        )
        left = self.residuals
        return 100.0 * (1.0 - float(np.sqrt(inner(left, left) / inner(spread, spread))))

    @property
    def std(self) -> Mapping[str, float]:
        """Standard deviation of each unknown; NaN for one at a bound."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Confidence interval of an unknown (Student's t)."""
        counted = sum(int(record.counted.sum()) for record in self.records)
        free = max(1, counted - len(self.names))
        half = float(scipy.special.stdtrit(free, 0.5 + 0.5 * level)) * self.std[name]
        return self.values[name] - half, self.values[name] + half

    @property
    def correlation(self) -> FloatArray:
        """(k, k) correlation of the unknowns."""
        size = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.covariance / np.outer(size, size))

    def predict(self, record: Measurement, *, refine: bool = True) -> FloatArray:
        """Reading (N,) [m] of the fitted model on another record.

        A record that begins as a fitted one does (the whole of a record of which a part was
        fitted) is simulated through from the fitted start. Of any other record the start and
        the per-record parameters are not known: they, and only they, are estimated on it, save
        those that the question fixed for every record.

        Args:
            record: what is predicted; its drive moves between samples as the fitted one's did,
                where nobody has said how.
            refine: whether sub-steps are chosen anew as finely as a fit's own; without it the
                scheme errs by up to 5e-5 of the stroke, which is enough to compare models.

        Raises:
            InputError: the record has other units, or lacks a channel that the model needs.
        """
        first = self.records[0]
        for what in ("drive_unit", "position_unit"):
            mine, other = getattr(first, what), getattr(record, what)
            if mine != other:
                raise InputError(
                    f"{record.name} has {what} {other} and the fit was made in {mine}: give a "
                    "record of the same units"
                )
        record = record.driven(self.records[0].between)
        for index, own in enumerate(self.records):
            if _same_start(own, record):
                question = self.question.with_records(record)
                start = self.values.of_record(index)
                unknown = unknowns(question, start)
                theta = theta_of(unknown, start)
                objective = self._objective(question, unknown, theta)
                if refine:
                    objective.refine(theta)
                return objective.readings(theta)[0]
        free = {n for n, p in self.model.parameters.items() if p.per_record}
        free |= {plain(n) for n in self.question.per_record}
        free -= set(self.question.fixed)
        shared = {
            n: self.values[n] for n in self.model.parameters if n not in free and n in self.values
        }
        # Where a hysteresis was reached from is as unknown there as any other start.
        past = {n for n in free if self.model.parameters[n].fixed}
        asked = {n for n in self.question.free if n in free}
        asked |= set() if self.question.start is Start.REST else past
        question = Identification(
            self.model, record, fixed=shared, start=self.question.start,
            bounds={n: limits for n, limits in self.question.bounds.items() if n == plain(n)},
            values={n: v for n, v in self.values.of_record(0).items() if n in free},
            free=tuple(sorted(asked)),
        )  # fmt: skip
        given = question.given()
        unknown = unknowns(question, Values({**Values.nominal(self.model), **given}))
        theta = theta_of(unknown, given)
        objective = self._objective(question, unknown, theta)
        point = None
        if theta.size:
            solver = LevenbergMarquardt(tolerance=1e-7 if refine else _CLOSE)
            found = solver.minimise(objective, theta)
            for begun in elsewhere(question):
                other = solver.minimise(objective, theta_of(unknown, {**given, **begun}))
                costs = (objective.cost(objective.residual(one.theta)) for one in (found, other))
                found = found if next(costs) <= next(costs) else other
            theta, point = found.theta, found.point
        if refine:
            objective.refine(theta)
        elif point is not None:
            return point.readings[0]
        return objective.readings(theta)[0]

    def _objective(
        self, question: Identification, unknown: Unknowns, theta: FloatArray
    ) -> Objective:
        """What a prediction is simulated with: the scheme of this fit, on sub-steps of its own."""
        exact = any(accuracy.substeps.exact for accuracy in self.accuracy)
        return Objective(question, unknown, theta, Monitor(unknown.names), exact=exact)

    def unit(self, name: str) -> str:
        """SI unit of an unknown."""
        if name.startswith(INITIAL):
            state = name.removeprefix(INITIAL).split("[")[0]
            effect, _, own = state.rpartition(".")
            return self.model[effect].declared_states[own].unit
        return self.model.parameters[plain(name)].unit

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        shown = [n for n in self.values if not n.startswith(INITIAL) or n in self.names]
        std = self.std
        return {
            "schema": SCHEMA,
            "outcome": {
                "success": self.outcome.success,
                "ending": self.outcome.ending.value,
                "sentence": self.outcome.sentence,
            },
            "rms": self.rms,
            "fit_percent": self.fit_percent,
            "model": self.model.to_dict(),
            "records": [r.name for r in self.records],
            "sampling": [
                {
                    "samples": len(r), "step": r.step, "between": r.between.value,
                    "drive": [float(r.drive.min()), float(r.drive.max())],
                }
                for r in self.records
            ],
            "parameters": {
                n: {
                    "value": self.values[n],
                    "std": _finite(std.get(n)),
                    "unit": self.unit(n),
                    "estimated": n in self.names,
                    "at_bound": n in self.at_bound,
                }
                for n in shown
            },
            "correlation": {
                "names": list(self.names),
                "matrix": [[_finite(v) for v in row] for row in self.correlation.tolist()],
            },
            "blind": list(self.blind),
            "remarks": list(self.remarks),
            "evaluations": {
                "total": self.evaluations.total,
                "simulations": self.evaluations.simulations,
                "with_sensitivities": self.evaluations.with_sensitivities,
            },
            "iterations": int(self.trace.rms.size),
            "wall_s": self.wall_s,
            "solver": self.solver,
            "transcription": self.transcription,
            "compiled": self.compiled,
            "scheme_error_rms": [a.error for a in self.accuracy],
            "starts": [
                {
                    "index": s.index, "rms": s.rms, "ending": s.ending,
                    "values": dict(s.values), "evaluations": s.evaluations,
                }
                for s in self.starts
            ],
        }  # fmt: skip

    def write_json(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write :meth:`to_dict` to a file, whole or not at all.

        Raises `InputError` when it exists and ``overwrite`` is not given, or cannot be written.
        """
        with replacing(path, overwrite=overwrite) as scratch:
            scratch.write_text(json.dumps(self.to_dict(), indent=2) + "\n", encoding="utf-8")

    def __str__(self) -> str:
        lines = [
            self.outcome.sentence,
            f"rms {show(self.rms, 'm')}, fit {self.fit_percent:.2f} %, "
            f"{self.evaluations.total} simulations, {self.wall_s:.2f} s"
            f"{'' if self.compiled else ' (no C compiler: slower virtual machine)'}",
            "",
            f"  {'parameter':<28} {'value':>14} {'± 95 %':>12}  unit",
        ]
        for name in self.values:
            if name.startswith(INITIAL) and name not in self.names:
                continue
            value = self.values[name]
            if name not in self.names:
                note = "fixed"
            elif name in self.at_bound:
                note = "at bound"
            else:
                low, high = self.interval(name)
                note = f"{0.5 * (high - low):.2g}"
            lines.append(f"  {name:<28} {value:>14.6g} {note:>12}  {self.unit(name)}")
        if self.coloured:
            lines.append("  (residuals are correlated in time; the intervals allow for it)")
        if self.blind:
            lines += ["", "What the data cannot see:"]
            lines += [f"  - {sentence}" for sentence in self.blind]
        if self.remarks:
            lines += ["", "Remarks:"]
            lines += [f"  - {sentence}" for sentence in self.remarks]
        return "\n".join(lines)


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


def _same_start(one: Measurement, other: Measurement) -> bool:
    """Whether two records begin alike: same instants, drive and reading."""
    n = min(len(one), len(other))
    return bool(
        np.array_equal(one.time[:n], other.time[:n])
        and np.array_equal(one.drive[:n], other.drive[:n])
        and np.array_equal(one.position[:n], other.position[:n])
    )
