"""Simulation of a record: system x values x drive -> response."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System, assemble, folded
from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError, ModelError
from piezo_opt.measurement import Measurement
from piezo_opt.simulation.accuracy import Accuracy, Substeps, choose
from piezo_opt.simulation.engine import Run, engine
from piezo_opt.simulation.schedule import Drive, Segment, corners, segments
from piezo_opt.simulation.scheme import INITIAL
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

TOLERANCE = 5e-5
"""Default error of the scheme as a share of the reading's range; below any noise."""


class Initial(Enum):
    """Where the states start."""

    REST = "rest"
    """At rest under the first drive, plus the ``initial.*`` deviations among the values."""
    PERIODIC = "periodic"
    """On the periodic steady state of a record that has a period."""


@final
@dataclass(frozen=True, eq=False)
class Response:
    """A simulated record.

    Attributes:
        time: (N,) [s], as in the record.
        reading: (N,) [m].
        states: (N, n) states at the readings, in the order of ``state_names``.
        state_names: names of the states.
        sensitivities: (N, k) derivative of the reading by each of ``directions``.
        directions: names of the sensitivity columns.
        accuracy: sub-steps used and the error of the scheme they leave.
        compiled: whether machine code ran (else CasADi's virtual machine).
    """

    time: FloatArray
    reading: FloatArray
    states: FloatArray
    state_names: tuple[str, ...]
    sensitivities: FloatArray
    directions: tuple[str, ...]
    accuracy: Accuracy
    compiled: bool


@final
class Simulator:
    """A model on one record, ready to be run for many values.

    Args:
        model: a sum of effects.
        record: gives time, drive and channels; its position is not read.
        values: at these the number of sub-steps is chosen.
        directions: sensitivities wanted, parameter names or ``"initial." + state``.
        initial: rest or periodic steady state.
        runtime: declared-fixed parameters that shall be changeable at run time.
        tolerance: admissible error of the scheme as a share of the reading's range.
        prefer_compiled: False takes CasADi's virtual machine even where a compiler exists.
        substeps: given sub-steps instead of chosen ones.
    """

    def __init__(
        self,
        model: Model,
        record: Measurement,
        values: Mapping[str, float],
        *,
        directions: Sequence[str] = (),
        initial: Initial = Initial.REST,
        runtime: Sequence[str] = (),
        tolerance: float = TOLERANCE,
        prefer_compiled: bool = True,
        substeps: Substeps | None = None,
    ) -> None:
        moved = [k for k, v in folded(model).items() if values.get(k, v) != v]
        self.system: System = assemble(model, folded(model, [*runtime, *moved, *directions]))
        missing = [c for c in self.system.channel_names if c not in record.channels]
        if missing:
            raise InputError(
                f"{record.name}: the model needs the channel '{missing[0]}' and the record has "
                f"none; record it, or use model.without(...)."
            )
        if initial is Initial.PERIODIC and record.period is None:
            raise InputError(
                f"{record.name}: a periodic steady state needs a period; read the record with "
                "period=..., or start from rest."
            )
        self.record = record
        self.directions = tuple(directions)
        self.initial = initial
        self._compiled = prefer_compiled
        self._drive: Drive = corners(record, self.system.channel_names)
        self._at = record.time - record.time[0]
        self._plain = engine(self.system, (), prefer_compiled)
        self._start_jacobian = self.system.start.jacobian() if self.system.state_names else None
        self._fixed: Segment | None = None
        if self.system.delay is None:
            self._fixed = segments(self._drive, self._at)
        self._steady: FloatArray | None = None
        if substeps is None:
            self.accuracy = self.choose(values, tolerance)
        else:
            self.accuracy = Accuracy(substeps, float("nan"), float("nan"))

    @property
    def compiled(self) -> bool:
        """Whether machine code runs."""
        return self._plain.compiled

    @property
    def _all_directions(self) -> tuple[str, ...]:
        if self.initial is Initial.REST:
            return self.directions
        return (*self.directions, *(INITIAL + n for n in self.system.state_names))

    def choose(
        self, values: Mapping[str, float], tolerance: float = TOLERANCE, most: int | None = None
    ) -> Accuracy:
        """Sub-steps that keep the scheme's error at these values below the tolerance.

        With ``most`` sub-steps in the whole record the best that they allow is taken.
        """
        segment, p = self._segment(values), self._parameters(values)
        start = self._start(segment, p, self._deviation(values))

        def simulate(substeps: Substeps) -> FloatArray:
            return self._run(values, substeps).reading

        limit = {} if most is None else {"most": most}
        return choose(self.system, segment, p, start, simulate, tolerance, **limit)

    def substeps(self, values: Mapping[str, float]) -> int:
        """Number of sub-steps in the whole record."""
        return int(self.accuracy.substeps.of(self._segment(values)).sum())

    def reading(self, values: Mapping[str, float]) -> FloatArray:
        """The reading (N,) [m]."""
        return self._run(values, self.accuracy.substeps).reading

    def response(self, values: Mapping[str, float]) -> Response:
        """Reading, states and sensitivities."""
        plain = self._run(values, self.accuracy.substeps, states=True)
        assert plain.states is not None
        slopes = np.zeros((plain.reading.size, 0))
        if self.directions:
            _, slopes = self.with_sensitivities(values)
        return Response(
            self.record.time, plain.reading, plain.states, self.system.state_names, slopes,
            self.directions, self.accuracy, self.compiled,
        )  # fmt: skip

    def with_sensitivities(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """The reading (N,) [m] and its derivative by each direction (N, k)."""
        segment, p = self._segment(values), self._parameters(values)
        runner = engine(self.system, self._all_directions, self._compiled)
        substeps = self.accuracy.substeps.of(segment)
        if self.initial is Initial.PERIODIC:
            start = self._periodic(values, self.accuracy.substeps)
            n, k = start.size, len(self.directions)
            cycle, cut = self._cycle(values), self.accuracy.substeps
            s0 = np.hstack([np.zeros((n, k)), np.eye(n)])
            around = runner.run(cycle, cut.of(cycle), p, start, s0).last_sensitivities
            closed = np.linalg.lstsq(np.eye(n) - around[:, k:], around[:, :k], rcond=None)[0]
            run = runner.run(segment, substeps, p, start, s0)
            return run.reading, run.sensitivities[:, :k] + run.sensitivities[:, k:] @ closed
        deviation = self._deviation(values)
        start = self._start(segment, p, deviation)
        slopes = self._start_sensitivities(segment, p, deviation, self.directions)
        run = runner.run(segment, substeps, p, start, slopes)
        return run.reading, run.sensitivities

    def _run(self, values: Mapping[str, float], cut: Substeps, *, states: bool = False) -> Run:
        segment, p = self._segment(values), self._parameters(values)
        if self.initial is Initial.PERIODIC:
            start = self._periodic(values, cut)
        else:
            start = self._start(segment, p, self._deviation(values))
        nothing = np.zeros((start.size, 0))
        return self._plain.run(segment, cut.of(segment), p, start, nothing, states=states)

    def _segment(self, values: Mapping[str, float]) -> Segment:
        if self._fixed is not None:
            return self._fixed
        assert self.system.delay is not None
        delay = float(self.system.delay(self._parameters(values)))
        return segments(self._drive, self._at, delay)

    def _parameters(self, values: Mapping[str, float]) -> FloatArray:
        try:
            return np.array([values[n] for n in self.system.parameter_names], dtype=float)
        except KeyError as missing:
            raise ModelError(
                f"No value for the parameter {missing}; give one, or start from "
                "Values.nominal(model)."
            ) from None

    def _deviation(self, values: Mapping[str, float]) -> FloatArray:
        return np.array([values.get(INITIAL + n, 0.0) for n in self.system.state_names])

    def _start(self, segment: Segment, p: FloatArray, deviation: FloatArray) -> FloatArray:
        given = (segment.time[0], segment.drive[0], segment.channels[0], p, deviation)
        return np.array(self.system.start(*given), dtype=float).ravel()

    def _start_sensitivities(
        self, segment: Segment, p: FloatArray, deviation: FloatArray, directions: tuple[str, ...]
    ) -> FloatArray:
        slopes = np.zeros((deviation.size, len(directions)))
        if self._start_jacobian is None:
            return slopes
        given = (segment.time[0], segment.drive[0], segment.channels[0], p, deviation)
        blocks = self._start_jacobian(*given, np.zeros(deviation.size))
        by_parameter, by_deviation = np.array(blocks[3]), np.array(blocks[4])
        for column, name in enumerate(directions):
            if name in self.system.parameter_names:
                slopes[:, column] = by_parameter[:, self.system.parameter_names.index(name)]
            else:
                state = self.system.state_names.index(name.removeprefix(INITIAL))
                slopes[:, column] = by_deviation[:, state]
        return slopes

    def _cycle(self, values: Mapping[str, float]) -> Segment:
        """One period of the drive, closed on itself."""
        period = float(self.record.period or 0.0)
        inside = self._drive.time < period * (1.0 - 1e-9)
        time = np.append(self._drive.time[inside], period)
        value = np.append(self._drive.value[inside], self._drive.value[0])
        beside = self._drive.channel_time < period * (1.0 - 1e-9)
        drive = Drive(
            time,
            value,
            np.append(self._drive.channel_time[beside], period),
            np.vstack([self._drive.channels[beside], self._drive.channels[:1]]),
        )
        return segments(drive, np.array([0.0, period]))

    def _periodic(self, values: Mapping[str, float], cut: Substeps) -> FloatArray:
        """Newton's method on x(period; x0) = x0."""
        names = tuple(INITIAL + n for n in self.system.state_names)
        runner = engine(self.system, names, self._compiled)
        cycle, p = self._cycle(values), self._parameters(values)
        identity = np.eye(len(names))
        x = self._steady
        if x is None:
            x = self._start(cycle, p, np.zeros(len(names)))
        for _ in range(40):
            run = runner.run(cycle, cut.of(cycle), p, x, identity)
            gap = run.last - x
            if not np.isfinite(gap).all():
                break
            step = np.linalg.lstsq(identity - run.last_sensitivities, gap, rcond=None)[0]
            x = x + step
            if np.all(np.abs(step) <= 1e-9 * (np.abs(x) + np.abs(run.last).max(initial=0.0))):
                self._steady = x
                return x
        if np.isfinite(x).all():
            return x
        return self._start(cycle, p, np.zeros(len(names)))


def simulate(
    model: Model,
    record: Measurement,
    values: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    initial: Initial = Initial.REST,
    tolerance: float = TOLERANCE,
    prefer_compiled: bool = True,
) -> Response:
    """Simulate a model on the drive of a record.

    Args:
        model: a sum of effects.
        record: gives time, drive and channels; its position is not read.
        values: SI values by full name; nominal ones where none are given.
        sensitivities: parameters (or ``"initial." + state``) to differentiate by.
        initial: rest or periodic steady state.
        tolerance: admissible error of the scheme as a share of the reading's range.
        prefer_compiled: False takes CasADi's virtual machine even where a compiler exists.

    Raises:
        InputError: the record lacks a channel or a period that is needed.
        ModelError: the model's needs are not met, or it is too stiff for the record.
    """
    numbers = {**Values.nominal(model), **(values or {})}
    unknown = [k for k in (values or {}) if k not in numbers or not _known(k, model)]
    if unknown:
        raise ModelError(
            f"The model has no parameter '{unknown[0]}'; it has {', '.join(model.parameters)}."
        )
    simulator = Simulator(
        model, record, numbers, directions=sensitivities, initial=initial, tolerance=tolerance,
        prefer_compiled=prefer_compiled,
    )  # fmt: skip
    return simulator.response(numbers)


def _known(name: str, model: Model) -> bool:
    return name in model.parameters or name.startswith(INITIAL) or name.endswith("]")
