"""Simulation of a record: system x values x drive -> response."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System, folded, named
from piezo_opt.choosing import chosen, expected, is_number, real
from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError, ModelError
from piezo_opt.lazy import lazy
from piezo_opt.measurement import Measurement
from piezo_opt.simulation.accuracy import Accuracy, Substeps, choose
from piezo_opt.simulation.dynamics import delay_of, dynamics
from piezo_opt.simulation.engine import Engine, engine
from piezo_opt.simulation.exponential import LENGTHS
from piezo_opt.simulation.runs import Ceiling, Run
from piezo_opt.simulation.schedule import Drive, Segment, corners, led_in, segments
from piezo_opt.simulation.scheme import INITIAL
from piezo_opt.units import quantity
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

_NEWTON: Final = 40
"""Iterations to a periodic state; it takes three or four."""

TOLERANCE = 5e-5
"""Default error of the scheme as a share of the reading's range; below a usual noise."""


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
    """A model on one record, ready to be run for many values, by several threads if wished.

    Args:
        model: a sum of effects.
        record: gives time, drive and channels; its position is read for a ceiling only.
        values: at these the number of sub-steps is chosen.
        directions: sensitivities wanted, parameter names or ``"initial." + state``.
        initial: rest or periodic steady state.
        runtime: declared-fixed parameters that shall be changeable at run time.
        tolerance: admissible error of the scheme as a share of the reading's range.
        prefer_compiled: False takes CasADi's virtual machine even where a compiler exists.
        substeps: given sub-steps instead of chosen ones.
        most: sub-steps in the whole record at which their choice ends.
        exact: whether chosen sub-steps may move linear blocks by their exponential; they do where
            there are any and the record is evenly sampled. Given sub-steps say it themselves.
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
        most: int | None = None,
        exact: bool = False,
    ) -> None:
        moved = [k for k, v in folded(model).items() if values.get(k, v) != v]
        self.system: System = named(model, folded(model, [*runtime, *moved, *directions]))
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
        self._names = self.system.parameter_names
        self._initials = tuple(INITIAL + n for n in self.system.state_names)
        self._constants = tuple(self.system.constants.items())
        self._drive: Drive = corners(record, self.system.channel_names)
        self._at = record.time - record.time[0]
        self._prefer_compiled = prefer_compiled
        self._delay = delay_of(self.system, prefer_compiled)
        self.exact = exact and self._worth_it() if substeps is None else substeps.exact
        # Kept from call to call, each replaced as a whole: threads may race, never mix.
        self._segment_at: tuple[float, Segment] | None = None
        self._cut_of: tuple[Segment, Substeps, IntArray] | None = None
        self._steady: FloatArray | None = None
        if substeps is None:
            self.accuracy = self.choose(values, tolerance, most)
        else:
            count = int(self._cut(self.segment(values), substeps).sum(dtype=np.int64))
            self.accuracy = Accuracy(substeps, float("nan"), count / record.time.size)

    @property
    def compiled(self) -> bool:
        """Whether machine code runs."""
        return self._plain.compiled

    @lazy
    def _plain(self) -> Engine:
        """The engine without directions; hundreds of searches ask for sensitivities only."""
        return self._engine(())

    @lazy
    def _sensitive(self) -> Engine:
        """The engine with all directions; a periodic start needs those of the start as well."""
        beside = self._initials if self.initial is Initial.PERIODIC else ()
        return self._engine((*self.directions, *beside))

    @lazy
    def _monodromy(self) -> Engine:
        return self._engine(self._initials)

    def _engine(self, directions: tuple[str, ...]) -> Engine:
        return engine(self.system, directions, self._prefer_compiled, self.exact)

    @lazy
    def _once(self) -> Segment:
        """One period, read at its samples, which shows how far each state moves."""
        closed = self._drive.closed
        assert closed is not None
        return self._timed(segments(closed, closed.channel_time))

    def choose(
        self, values: Mapping[str, float], tolerance: float = TOLERANCE, most: int | None = None
    ) -> Accuracy:
        """Sub-steps that keep the scheme's error at these values below the tolerance.

        With ``most`` sub-steps in the whole record the best that they allow is taken.
        """
        segment, p = self.segment(values), self._parameters(values)
        start, _ = self._plain.start(segment, p, self._deviation(values))

        def simulate(substeps: Substeps, cut: IntArray) -> FloatArray:
            if substeps.times == 1:  # which may be the one that is chosen
                self._cut_of = (segment, substeps, cut)
            return self._run(values, substeps, cut=cut).reading

        limit = {} if most is None else {"most": most}
        return choose(
            self.system, segment, p, start, simulate, tolerance, exact=self.exact, **limit
        )

    def substeps(self, values: Mapping[str, float]) -> int:
        """Number of sub-steps in the whole record."""
        return self.accuracy.substeps.count(self.segment(values))

    def reading(self, values: Mapping[str, float], most: float | None = None) -> FloatArray:
        """The reading (N,) [m]; ``most`` as for :meth:`with_sensitivities`."""
        return self._run(values, self.accuracy.substeps, most=most).reading

    def halving(self, values: Mapping[str, float], reading: FloatArray) -> float:
        """Root mean square by which a reading changes where every sub-step is cut in two [m]."""
        coarse = self.accuracy.substeps
        finer = self._run(values, replace(coarse, times=2 * coarse.times)).reading
        with np.errstate(over="ignore"):  # a search may have led where a model runs away
            return float(np.sqrt(np.mean((reading - finer) ** 2)))

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

    def with_sensitivities(
        self, values: Mapping[str, float], most: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """The reading (N,) [m] and its derivative by each direction (N, k).

        Args:
            values: of the parameters, and deviations of the states at the start.
            most: sum of squares of the misfit to the counted samples [m^2] above which nobody wants
                to know it: the reading may be NaN from some sample on then, and its derivatives
                mean nothing.
        """
        segment, p = self.segment(values), self._parameters(values)
        runner, substeps = self._sensitive, self.accuracy.substeps
        cut = self._cut(segment, substeps)
        if self.initial is Initial.REST:
            run = runner.from_rest(
                segment, cut, p, self._deviation(values), ceiling=self._ceiling(most)
            )
            return run.reading, run.sensitivities
        # x0 = x(period; x0, p), hence (1 - dx/dx0) dx0/dp = dx/dp; the reading follows x0.
        start, once = self._periodic(p, substeps), self._once
        n, k = start.size, len(self.directions)
        unit = np.hstack([np.zeros((n, k)), np.eye(n)])
        loop = runner.run(once, substeps.of(once), p, start, unit, states=True)
        around = loop.last_sensitivities
        if not np.isfinite(around).all():
            return self.reading(values), np.full((segment.readings, k), np.nan)
        closed = _solve(np.eye(n) - around[:, k:], around[:, :k], _sizes(loop))
        run = runner.run(segment, cut, p, start, unit)
        return run.reading, run.sensitivities[:, :k] + run.sensitivities[:, k:] @ closed

    def _run(
        self,
        values: Mapping[str, float],
        substeps: Substeps,
        *,
        cut: IntArray | None = None,
        states: bool = False,
        most: float | None = None,
    ) -> Run:
        segment, p, ceiling = self.segment(values), self._parameters(values), self._ceiling(most)
        cut = self._cut(segment, substeps) if cut is None else cut
        if self.initial is Initial.REST:
            return self._plain.from_rest(
                segment, cut, p, self._deviation(values), states=states, ceiling=ceiling
            )
        start = self._periodic(p, substeps)
        nothing = np.zeros((start.size, 0))
        return self._plain.run(segment, cut, p, start, nothing, states=states, ceiling=ceiling)

    def _ceiling(self, most: float | None) -> Ceiling | None:
        return None if most is None else Ceiling(self._measured, most)

    @lazy
    def _measured(self) -> FloatArray:
        """The record's counted positions, NaN elsewhere."""
        return np.where(self.record.counted, self.record.position, np.nan)

    def segment(self, values: Mapping[str, float]) -> Segment:
        """The time axis: stretches of straight drive, and where the reading is taken."""
        if self._delay is None:
            return self._timed(self._drive.sampled)
        delay = self._delay(self._parameters(values))
        kept = self._segment_at
        if kept is None or kept[0] != delay:
            drive = self._drive
            if self.initial is Initial.PERIODIC:
                length = float(self.record.period or np.inf)
                drive = led_in(drive, max(1, int(np.ceil(delay / length))))
            kept = (delay, self._timed(segments(drive, self._at, delay)))
            self._segment_at = kept
        return kept[1]

    def _worth_it(self) -> bool:
        """Whether something is linear, and the time even.

        What moves by an exponential asks for a new one whenever a sub-step has another length.
        """
        blocks = dynamics(self.system, True, self._prefer_compiled).blocks
        return blocks > 0 and self._drive.sampled.even.lengths <= LENGTHS

    def _timed(self, segment: Segment) -> Segment:
        """A time axis as this scheme goes along it."""
        return segment.even if self.exact else segment

    def _cut(self, segment: Segment, substeps: Substeps) -> IntArray:
        kept = self._cut_of
        if kept is None or kept[0] is not segment or kept[1] != substeps:
            kept = (segment, substeps, substeps.of(segment))
            self._cut_of = kept
        return kept[2]

    def _parameters(self, values: Mapping[str, float]) -> FloatArray:
        for name, constant in self._constants:
            if values.get(name, constant) != constant:
                raise ModelError(
                    f"'{name}' is folded into the compiled code at {constant:g} and cannot be "
                    f"{values[name]:g}; name it in Simulator(runtime=...)."
                )
        try:
            return np.array([values[n] for n in self._names], dtype=float)
        except KeyError as missing:
            raise ModelError(
                f"No value for the parameter {missing}; give one, or start from "
                "Values.nominal(model)."
            ) from None

    def _deviation(self, values: Mapping[str, float]) -> FloatArray:
        return np.array([values.get(n, 0.0) for n in self._initials], dtype=float)

    def _periodic(self, p: FloatArray, cut: Substeps) -> FloatArray:
        """Newton's method on x(period; x0) = x0; NaN where there is no such state."""
        runner, once = self._monodromy, self._once
        substeps = cut.of(once)
        n = len(self._initials)
        identity = np.eye(n)
        x = self._steady
        if x is None:
            x, _ = self._plain.start(once, p, np.zeros(n))
            # Once around from rest: play and hysteresis come near the loop that they end on.
            x = self._plain.run(once, substeps, p, x, np.zeros((n, 0))).last
        for _ in range(_NEWTON):
            run = runner.run(once, substeps, p, x, identity, states=True)
            gap = run.last - x
            if not np.isfinite(run.last_sensitivities).all() or not np.isfinite(gap).all():
                break
            sizes = _sizes(run)
            step = _solve(identity - run.last_sensitivities, gap[:, None], sizes)[:, 0]
            x = x + step
            if np.all(np.abs(step) <= 1e-9 * sizes):
                self._steady = x
                return x
        return np.full(n, np.nan)


def _sizes(run: Run) -> FloatArray:
    """How large each state becomes, 1 for one that never moves."""
    assert run.states is not None
    largest = np.abs(run.states).max(axis=0)
    return np.where(largest > 1e-200, largest, 1.0)


def _solve(matrix: FloatArray, right: FloatArray, sizes: FloatArray) -> FloatArray:
    """Solution of ``matrix x = right`` by least squares, every state in its own size.

    Least squares, because a memory that nothing fades leaves its start undetermined; scaled,
    because volts beside metres would drown them in rounding.
    """
    if sizes.size == 0:
        return right
    scaled = matrix * sizes[None, :] / sizes[:, None]
    found = np.linalg.lstsq(scaled, right / sizes[:, None], rcond=None)[0]
    return np.asarray(found * sizes[:, None])


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
        values: SI values by full name, or texts with units, ``"0.1 um/V"``; nominal ones where
            none are given.
        sensitivities: parameters (or ``"initial." + state``) to differentiate by.
        initial: rest or periodic steady state.
        tolerance: admissible error of the scheme as a share of the reading's range.
        prefer_compiled: False takes CasADi's virtual machine even where a compiler exists.

    Raises:
        InputError: the record lacks a channel or a period that is needed.
        ModelError: the model's needs are not met, or it is too stiff for the record.
    """
    expected(Model, model, "The model", "a sum of effects, PiezoGain() + BoucWen()")
    expected(Measurement, record, "The record", "what read returns")
    initial = chosen(Initial, initial, "initial")
    if not (is_number(tolerance) and tolerance > 0.0):
        raise InputError(f"tolerance is {tolerance!r}: give a share of the range, such as 5e-5.")
    given = {
        name: quantity(value, model.parameters[name].unit)
        if isinstance(value, str) and name in model.parameters
        else value
        for name, value in (values or {}).items()
    }
    for name, value in given.items():
        real(value, name)
    numbers = {**Values.nominal(model), **given}
    # "initial.creep.z" beside "initial.creep.z[0]" is what of_record() makes of the latter.
    unknown = [k for k in given if not _known(k, model) and f"{k}[0]" not in numbers]
    if unknown:
        raise ModelError(
            f"The model has no parameter or initial state '{unknown[0]}'; its parameters are "
            f"{', '.join(model.parameters)}."
        )
    simulator = Simulator(
        model, record, numbers, directions=sensitivities, initial=initial, tolerance=tolerance,
        prefer_compiled=prefer_compiled,
    )  # fmt: skip
    return simulator.response(numbers)


def _known(name: str, model: Model) -> bool:
    """Whether it names a parameter or a state's start, with or without a record's number."""
    starts = (
        f"{INITIAL}{effect}.{state}" if size == 1 else f"{INITIAL}{effect}.{state}[{i}]"
        for effect, declared in model
        for state, size in declared.states.items()
        for i in range(size)
    )
    return bool({name, re.sub(r"\[\d+\]$", "", name)} & {*model.parameters, *starts})
