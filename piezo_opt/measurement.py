"""Records of an actuator: time, drive, position, and what is known about how they were taken."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from functools import cached_property
from types import MappingProxyType
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.interpolate import CubicSpline

from piezo_opt.errors import InputError
from piezo_opt.units import quantity, show, to_si

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]

FEWEST_SAMPLES = 8
"""A record shorter than this determines nothing."""

_COMMON_UNITS = frozenset({"V", "m", "N", "A", "K", "C", "1"})
_FINEST_GRID = 2000.0


class Between(Enum):
    """How the drive moves between two samples."""

    LINEAR = "linear"
    """On a straight line: a measured voltage, a ramp."""
    HELD = "held"
    """Constant, then a step at the next sample: a digital-to-analogue converter."""
    BANDLIMITED = "bandlimited"
    """The one smooth signal without content above half the sampling rate: a filtered multisine."""


@final
@dataclass(frozen=True, eq=False)
class Measurement:
    """One record: N samples of time [s], drive [drive_unit] and position [position_unit].

    Args:
        time: (N,) instants [s], strictly increasing; the steps may differ.
        drive: (N,) what was applied [drive_unit], usually volts.
        position: (N,) what was read [position_unit], usually metres.
        channels: further (N,) signals by name in SI units, such as ``"temperature"`` [K].
        name: what messages and tables call the record.
        drive_unit, position_unit: SI units of the two signals.
        between: how the drive moves between samples.
        period: [s], when the record is a steady state that repeats with this period.
        startup: [s]; samples in [t0, t0 + startup) are simulated but not counted in errors.
        source: where the record comes from.
        allow_saturated: accept a reading that is stuck at its end while the drive moves on.
        channel_units: SI units of further channels by name, kept for files and pictures.

    Raises:
        InputError: the record is empty, too short, of unequal lengths, not finite, out of order,
            without a change of drive, saturated, or does not have the period it claims.
    """

    time: FloatArray
    drive: FloatArray
    position: FloatArray
    channels: Mapping[str, FloatArray] = field(default_factory=dict)
    name: str = "record"
    drive_unit: str = "V"
    position_unit: str = "m"
    between: Between = Between.LINEAR
    period: float | None = None
    startup: float = 0.0
    source: str = ""
    allow_saturated: bool = False
    channel_units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        signals = {
            "time": _frozen(self.time, "time", self.name),
            "drive": _frozen(self.drive, "drive", self.name),
            "position": _frozen(self.position, "position", self.name),
        }
        channels = {
            str(name): _frozen(values, str(name), self.name)
            for name, values in self.channels.items()
        }
        for name in channels:
            if name in signals:
                raise InputError(f"{self.name}: a further channel cannot be called {name!r}")
        for name, values in signals.items():
            object.__setattr__(self, name, values)
        object.__setattr__(self, "channels", MappingProxyType(channels))
        units = {name: str(self.channel_units.get(name, "1")) for name in channels}
        object.__setattr__(self, "channel_units", MappingProxyType(units))
        _check_signals(self.name, {**signals, **channels})
        for unit in (self.drive_unit, self.position_unit, *units.values()):
            _check_unit(self.name, unit)
        _check_startup(self)
        if self.period is not None:
            _check_period(self, self.period)
        if not self.allow_saturated:
            _check_saturation(self)

    def __reduce__(self) -> tuple[Callable[..., Measurement], tuple[dict[str, Any]]]:
        # A mapping proxy cannot be pickled, and records travel to worker processes.
        state = {one.name: getattr(self, one.name) for one in fields(self)}
        mappings = {name: dict(state[name]) for name in ("channels", "channel_units")}
        return _rebuild, ({**state, **mappings},)

    def __len__(self) -> int:
        return int(self.time.size)

    def __repr__(self) -> str:
        pieces = [f"{len(self)} samples", show(self.duration, "s")]
        if self.uniform:
            pieces.append(f"{self.rate:.6g} Hz")
        if self.period is not None:
            pieces.append(f"{self.periods} periods of {show(self.period, 's')}")
        for label, values, unit in (
            ("drive", self.drive, self.drive_unit),
            ("position", self.position, self.position_unit),
        ):
            pieces.append(f"{label} {show(values.min(), unit)} .. {show(values.max(), unit)}")
        return f"<{self.name}: {', '.join(pieces)}>"

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def uniform(self) -> bool:
        """Whether every sample lies within 1 % of a step of an even grid."""
        even = np.linspace(self.time[0], self.time[-1], len(self))
        return bool(np.max(np.abs(self.time - even)) <= 0.01 * self.duration / (len(self) - 1))

    @cached_property
    def step(self) -> float:
        """Sampling interval [s]: the median one, or the exact one of a uniform record.

        Times printed with few digits make the median slightly wrong; over an even record the
        mean has no such error.
        """
        if self.uniform:
            return self.duration / (len(self) - 1)
        return float(np.median(np.diff(self.time)))

    @property
    def rate(self) -> float:
        """Samples a second [Hz]."""
        return 1.0 / self.step

    @cached_property
    def counted(self) -> BoolArray:
        """(N,) mask of the samples that errors are counted on: those after the start-up."""
        # Half a rounding error of slack, so that "40 s" means the sample printed as 40 s.
        mask: BoolArray = self.time >= self.time[0] + self.startup - 1e-9 * max(
            self.step, self.startup
        )
        mask.flags.writeable = False
        return mask

    @cached_property
    def gaps(self) -> tuple[tuple[float, float], ...]:
        """(last instant before, first instant after) [s] of every interval over 1.5 steps."""
        wide = np.flatnonzero(np.diff(self.time) > 1.5 * self.step)
        return tuple((float(self.time[i]), float(self.time[i + 1])) for i in wide)

    @cached_property
    def resolution(self) -> float | None:
        """Step of the reading's quantisation [position_unit]; None when none is found.

        The widest grid that holds at least 70 % of the samples, on five levels or more. Steps
        below 1/2000 of the range are not looked for: noise hides them.
        """
        correlation = np.corrcoef(self.drive, self.position)[0, 1] if np.ptp(self.position) else 1.0
        if abs(correlation) > 1.0 - 1e-11:
            return None  # computed, not read: the levels are the drive's
        return _grid_step(self.position)

    @cached_property
    def periods(self) -> int:
        """Number of whole periods after the start-up; 0 for a record without a period."""
        if self.period is None:
            return 0
        first = int(np.argmax(self.counted))
        covered = float(self.time[-1] - self.time[first]) + self.step
        return int(np.floor(covered / self.period + 1e-6))

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """What the sampling hides, in sentences; empty for a record without flaws."""
        return (*_gap_remarks(self), *_resolution_remarks(self), *_aliasing_remarks(self))

    def with_(self, **changes: Any) -> Measurement:
        """The same record with some fields changed; checked like a new one."""
        unknown = set(changes) - {one.name for one in fields(self)}
        if unknown:
            raise InputError(
                f"a measurement has no {', '.join(sorted(unknown))}: "
                f"it has {', '.join(one.name for one in fields(self))}"
            )
        return replace(self, **changes)

    def rename(self, name: str) -> Measurement:
        """The same record under another name."""
        return replace(self, name=name)

    def slice(
        self, start: float | str | None = None, stop: float | str | None = None
    ) -> Measurement:
        """The samples with start <= time < stop, both on the record's clock ([s] or "40 s").

        What is left of the start-up stays not counted. A stretch shorter than the period
        loses the period.
        """
        begin = -np.inf if start is None else quantity(start, "s")
        end = np.inf if stop is None else quantity(stop, "s")
        slack = 1e-9 * self.step
        mask = (self.time >= begin - slack) & (self.time < end - slack)
        if np.count_nonzero(mask) < FEWEST_SAMPLES:
            raise InputError(
                f"{self.name}: only {np.count_nonzero(mask)} samples between {begin:g} s and "
                f"{end:g} s, the record runs from {self.time[0]:g} s to {self.time[-1]:g} s: "
                f"choose a stretch with at least {FEWEST_SAMPLES}"
            )
        time = self.time[mask]
        covered = float(time[-1] - time[0]) + self.step
        whole = self.period is not None and covered >= self.period * (1.0 - 1e-6)
        return replace(
            self,
            time=time,
            drive=self.drive[mask],
            position=self.position[mask],
            channels={name: values[mask] for name, values in self.channels.items()},
            startup=max(0.0, float(self.time[0]) + self.startup - float(time[0])),
            period=self.period if whole else None,
            # A part of an accepted record is not judged again: its end may look stuck.
            allow_saturated=True,
        )

    def split(self, at: float | str) -> tuple[Measurement, Measurement]:
        """Training and test record, cut at an instant of the record's clock ([s] or "40 s").

        The training record has the samples before the cut. The test record is the *whole*
        record with everything before the cut as start-up: an actuator remembers, so the
        held-out stretch is simulated through, not restarted in the middle.
        """
        instant = quantity(at, "s")
        train = self.slice(None, instant)
        startup = instant - float(self.time[0])
        if not startup <= self.duration:
            raise InputError(
                f"{self.name}: nothing is left to test after {instant:g} s, the record ends at "
                f"{self.time[-1]:g} s: split earlier"
            )
        if startup < self.startup:
            raise InputError(
                f"{self.name}: {instant:g} s lies inside the start-up of "
                f"{show(self.startup, 's')}: split later"
            )
        return train, replace(self, startup=startup)

    def resample(
        self, *, rate: float | str | None = None, step: float | str | None = None
    ) -> Measurement:
        """The record on an even grid of ``rate`` [Hz] or ``step`` [s], from the same start.

        Lowering the rate of a uniform record removes what the new rate cannot carry first
        (a zero-phase low-pass on drive and reading alike, so that their relation stays); a held
        drive is a smooth one afterwards. A record with whole periods of a band-limited drive
        is resampled exactly, by its Fourier series. Everything else is interpolated: a held
        drive holds, all other signals move on straight lines.
        """
        if (rate is None) == (step is None):
            raise InputError("give either rate or step, for example resample(rate='1 kHz')")
        if rate is not None:
            hertz = quantity(rate, "Hz")
            new = 1.0 / hertz if hertz > 0 else 0.0
        else:
            assert step is not None
            new = quantity(step, "s")
        if not 0.0 < new <= self.duration / (FEWEST_SAMPLES - 1) * (1 + 1e-9):
            raise InputError(
                f"{self.name}: a step of {new:g} s does not leave {FEWEST_SAMPLES} samples of "
                f"{show(self.duration, 's')}: choose a shorter step"
            )
        return _resampled(self, new)

    def repeated_periods(self) -> FloatArray:
        """(periods, samples a period) readings after the start-up [position_unit].

        Raises `InputError` for a record without a period or without even sampling.
        """
        return self._by_period(self.position)

    def noise_from_periods(self) -> float:
        """Noise of the reading, rms [position_unit], from what differs between the periods.

        sqrt(sum_pk (y_pk - mean_p y_pk)^2 / ((P - 1) K)) over P periods of K samples; needs two.
        """
        repeated = self.repeated_periods()
        if repeated.shape[0] < 2:
            raise InputError(
                f"{self.name}: one period says nothing about noise: record at least two"
            )
        return float(np.sqrt(np.mean(np.var(repeated, axis=0, ddof=1))))

    def detrended(self, order: int = 0) -> Measurement:
        """Drive and position less their means (order 0) or straight lines (order 1).

        For black-box linear models, which have no working point. Fitted on counted samples.
        """
        if order not in (0, 1):
            raise InputError(f"order is 0 (means) or 1 (straight lines), not {order!r}")
        # Centred and scaled time keeps the fit well conditioned on any clock.
        clock = (self.time - self.time[0]) / self.duration
        powers = np.vander(clock, order + 1)

        def without_trend(values: FloatArray) -> FloatArray:
            line, *_ = np.linalg.lstsq(powers[self.counted], values[self.counted], rcond=None)
            return np.asarray(values - powers @ line, dtype=np.float64)

        return replace(self, drive=without_trend(self.drive), position=without_trend(self.position))

    def _by_period(self, values: FloatArray) -> FloatArray:
        if self.period is None:
            raise InputError(f"{self.name}: has no period: give one with with_(period=...)")
        if not self.uniform:
            raise InputError(f"{self.name}: periods need even sampling: resample it first")
        samples = round(self.period / self.step)
        first = int(np.argmax(self.counted))
        whole = (len(self) - first) // samples
        if whole == 0:
            raise InputError(
                f"{self.name}: no whole period of {show(self.period, 's')} is left after the "
                f"start-up of {show(self.startup, 's')}: shorten the start-up"
            )
        return values[first : first + whole * samples].reshape(whole, samples)


@final
@dataclass(frozen=True, eq=False)
class Campaign:
    """Several records of one actuator, with names of their own and the same units.

    Raises `InputError` when there is no record, a name occurs twice, or units differ.
    """

    records: tuple[Measurement, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "records", tuple(self.records))
        if not self.records:
            raise InputError("a campaign needs at least one record")
        seen: set[str] = set()
        for record in self.records:
            if record.name in seen:
                raise InputError(
                    f"two records are called {record.name!r}: give one another name, rename('...')"
                )
            seen.add(record.name)
        first = self.records[0]
        for record in self.records[1:]:
            for what in ("drive_unit", "position_unit"):
                mine, other = getattr(record, what), getattr(first, what)
                if mine != other:
                    raise InputError(
                        f"{record.name} has {what} {mine} but {first.name} has {other}: "
                        "records of one campaign share their units"
                    )

    @staticmethod
    def of(records: Measurement | Iterable[Measurement] | Campaign) -> Campaign:
        """A campaign from one record, several, or one already made."""
        if isinstance(records, Campaign):
            return records
        if isinstance(records, Measurement):
            return Campaign((records,))
        return Campaign(tuple(records))

    def __iter__(self) -> Iterator[Measurement]:
        return iter(self.records)

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, name: str) -> Measurement:
        for record in self.records:
            if record.name == name:
                return record
        raise InputError(f"no record {name!r}: there are {', '.join(self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """The records' names, in order."""
        return tuple(record.name for record in self.records)


def _rebuild(state: dict[str, Any]) -> Measurement:
    return Measurement(**state)


def _frozen(values: object, channel: str, record: str) -> FloatArray:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{record}: {channel} is not an array of numbers") from error
    if array.ndim != 1:
        raise InputError(
            f"{record}: {channel} has shape {array.shape}, expected (N,): give one signal"
        )
    array.flags.writeable = False
    return array


def _check_signals(record: str, signals: Mapping[str, FloatArray]) -> None:
    time, drive = signals["time"], signals["drive"]
    if time.size == 0:
        raise InputError(f"{record}: is empty: a record needs {FEWEST_SAMPLES} samples or more")
    for name, values in signals.items():
        if values.size != time.size:
            raise InputError(
                f"{record}: {name} has {values.size} samples but time has {time.size}: "
                "cut both to the same length"
            )
    if time.size < FEWEST_SAMPLES:
        raise InputError(
            f"{record}: has {time.size} samples, too few: a record needs {FEWEST_SAMPLES} or more"
        )
    for name, values in signals.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            where = f"index {bad[0]}" + ("" if name == "time" else f" (t = {time[bad[0]]:g} s)")
            raise InputError(
                f"{record}: {name} is {values[bad[0]]} at {where}: remove the sample, "
                "gaps in time are allowed"
            )
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        row = int(late[0]) + 1
        kind = "repeats" if time[row] == time[row - 1] else "goes back"
        raise InputError(
            f"{record}: time {kind} at index {row} ({time[row - 1]:g} s, then {time[row]:g} s): "
            "sort the samples and keep one for each instant"
        )
    # Beyond these magnitudes sums of squares overflow or a step vanishes in rounding.
    for name, values in signals.items():
        largest = float(np.max(np.abs(values)))
        if largest > 1e100:
            raise InputError(f"{record}: {name} reaches {largest:g}: check its unit")
    if float(np.min(np.diff(time))) < 1e-12 * float(np.max(np.abs(time))):
        raise InputError(
            f"{record}: the steps of time drown in its offset of {time[0]:g} s: "
            "let the clock start near zero"
        )
    if np.ptp(drive) <= 1e-12 * float(np.max(np.abs(drive))):
        raise InputError(
            f"{record}: the drive is constant at {drive[0]:g}, which identifies nothing: "
            "record a drive that moves"
        )


def _check_unit(record: str, unit: str) -> None:
    # The common units are known to be SI; asking takes the units library a while to load.
    if unit in _COMMON_UNITS:
        return
    if float(to_si(1.0, unit)[0]) != 1.0:
        raise InputError(
            f"{record}: its signals are in SI units, and {unit!r} is none: convert it, "
            f"for example with to_si(values, {unit!r})"
        )


def _check_startup(record: Measurement) -> None:
    if not 0.0 <= record.startup < np.inf:
        raise InputError(f"{record.name}: startup is {record.startup:g} s: give 0 s or more")
    if not record.counted.any():
        raise InputError(
            f"{record.name}: the start-up of {show(record.startup, 's')} covers the whole record "
            f"of {show(record.duration, 's')}: shorten it"
        )


def _check_period(record: Measurement, period: float) -> None:
    name, step = record.name, record.step
    if not 0.0 < period < np.inf:
        raise InputError(f"{name}: period is {period:g} s: give a positive one or none")
    if period > (record.duration + step) * (1 + 1e-6):
        raise InputError(
            f"{name}: a period of {show(period, 's')} does not fit the record of "
            f"{show(record.duration + step, 's')}: record a whole period or give none"
        )
    if not record.uniform:
        return
    samples = period / step
    # The last period must still fall on the grid, not just the first.
    drift = abs(samples - round(samples)) * len(record) / max(samples, 1.0)
    if round(samples) < 2 or drift > 0.05:
        raise InputError(
            f"{name}: a period of {show(period, 's')} is {samples:.6g} samples, not a whole "
            "number: give a multiple of it that is, or resample the record"
        )
    whole = len(record) // round(samples)
    if whole < 2:
        return
    repeated = record.drive[: whole * round(samples)].reshape(whole, -1)
    varies = np.sqrt(np.mean((repeated - repeated.mean(axis=0)) ** 2))
    if varies > 0.2 * np.std(record.drive):
        raise InputError(
            f"{name}: the drive does not repeat every {show(period, 's')}: correct the period "
            "or give none"
        )


def _check_saturation(record: Measurement) -> None:
    """Refuse a reading stuck at its end while the drive moves on.

    A coarse reading is stuck everywhere a little, so a run at the end only counts when the drive
    moves much further in it than in the usual run in the interior.
    """
    reading, drive = record.position, record.drive
    spread = float(np.ptp(reading))
    if spread == 0.0:
        raise InputError(
            f"{record.name}: the reading is constant at {reading[0]:g} {record.position_unit}: "
            "check the sensor"
        )
    edges = np.flatnonzero(np.diff(reading) != 0) + 1
    starts = np.concatenate([[0], edges])
    stops = np.concatenate([edges, [reading.size]])
    at_end = (reading[starts] == reading.max()) | (reading[starts] == reading.min())
    long = at_end & (stops - starts >= max(5, int(np.ceil(0.05 * reading.size))))
    if not long.any():
        return
    drive_range = float(np.ptp(drive))
    inside = [
        _monotone_travel(drive[a:b])
        for a, b in zip(starts[~at_end], stops[~at_end], strict=True)
        if b - a > 1
    ]
    usual = float(np.median(inside)) if inside else 0.0
    for a, b in zip(starts[long], stops[long], strict=True):
        travel = _monotone_travel(drive[a:b])
        if travel > 0.05 * drive_range and travel > 3.0 * usual:
            raise InputError(
                f"{record.name}: the reading is stuck at {reading[a]:g} {record.position_unit} "
                f"from t = {record.time[a]:g} s to {record.time[b - 1]:g} s while the drive moves "
                f"by {100 * travel / drive_range:.0f} % of its range: it is saturated; remove "
                "those samples or pass allow_saturated=True"
            )


def _monotone_travel(drive: FloatArray) -> float:
    """The longest way the drive goes in one direction [drive unit]."""
    if drive.size < 2:
        return 0.0
    moves = np.diff(drive)
    turns = np.flatnonzero(moves[1:] * moves[:-1] < 0) + 1
    corners = drive[np.concatenate([[0], turns, [drive.size - 1]])]
    return float(np.max(np.abs(np.diff(corners))))


def _grid_step(values: FloatArray) -> float | None:
    """The widest step q so that values = offset + integer q for at least 70 % of the samples."""
    spread = float(np.ptp(values))
    if spread == 0.0:
        return None
    ordered, weights = np.unique(values, return_counts=True)
    # Printing and unit conversion leave specks far below any real step.
    starts = np.flatnonzero(np.concatenate([[True], np.diff(ordered) > 1e-6 * spread]))
    levels: FloatArray = ordered[starts] - ordered[0]
    counts: FloatArray = np.add.reduceat(weights, starts).astype(np.float64)
    # A smooth reading has a level of its own for nearly every sample.
    smooth = values.size >= 200 and levels.size > 0.5 * values.size
    if levels.size < 5 or smooth:
        return None
    for candidate in _candidate_steps(levels):
        if spread / candidate > _FINEST_GRID:
            break
        step, offset = _tuned_grid(levels, counts, candidate)
        index = np.round((levels - offset) / step)
        on_grid = np.abs(levels - offset - index * step) <= 0.06 * step
        occupied = np.unique(index[on_grid]).size
        # Two levels in one cell are no grid: the step is too wide.
        crowded = np.count_nonzero(on_grid) > 1.2 * occupied
        if occupied >= 5 and not crowded and counts[on_grid].sum() >= 0.7 * values.size:
            return step
    return None


def _candidate_steps(levels: FloatArray) -> FloatArray:
    """The differences of neighbouring levels that occur most, to about 2 %, widest first."""
    differences = np.diff(levels)
    bins = np.round(np.log(differences) / 0.02)
    _, inverse, counts = np.unique(bins, return_inverse=True, return_counts=True)
    centres = np.bincount(inverse, weights=differences) / counts
    frequent = np.argsort(counts, kind="stable")[::-1][:16]
    return np.asarray(np.sort(centres[frequent])[::-1], dtype=np.float64)


def _tuned_grid(levels: FloatArray, counts: FloatArray, near: float) -> tuple[float, float]:
    """Step and offset of the grid within 3 % of ``near`` that most samples lie on.

    Each trial grid goes through one of the most frequent levels. A sample counts by how close to
    the grid it lies and not at all beyond 6 % of a cell, so that the samples that lie on no grid
    have no say. From one trial to the next the last level moves by a twentieth of a cell; least
    squares removes what is left.
    """
    some = np.unique(np.linspace(0, levels.size - 1, 400).astype(np.int64))
    trials = near * np.linspace(0.97, 1.03, 3 + int(1.2 * levels[-1] / near))
    best, step, offset = -1.0, near, 0.0
    for anchor in levels[np.argsort(-counts, kind="stable")[:5]]:
        cells = (levels[some] - anchor) / trials[:, np.newaxis]
        closeness = np.maximum(0.0, 1.0 - ((cells - np.round(cells)) / 0.06) ** 2)
        agreement = closeness @ counts[some]
        winner = int(np.argmax(agreement))
        if agreement[winner] > best:
            best, step, offset = float(agreement[winner]), float(trials[winner]), float(anchor)
    index = np.round((levels - offset) / step)
    used = np.abs(levels - offset - index * step) <= 0.06 * step
    if np.unique(index[used]).size >= 2:
        slope, intercept = np.polyfit(index[used], levels[used], 1, w=np.sqrt(counts[used]))
        return float(slope), float(intercept)
    return step, offset


def _gap_remarks(record: Measurement) -> Iterator[str]:
    if record.gaps:
        before, after = max(record.gaps, key=lambda gap: gap[1] - gap[0])
        yield (
            f"{len(record.gaps)} gap{'s' if len(record.gaps) > 1 else ''} in time, the widest "
            f"from {before:g} s to {after:g} s: the drive inside is not known."
        )
    elif not record.uniform:
        steps = np.diff(record.time)
        yield (
            f"Sampled unevenly, {show(float(steps.min()), 's')} to "
            f"{show(float(steps.max()), 's')} apart."
        )


def _resolution_remarks(record: Measurement) -> Iterator[str]:
    step = record.resolution
    spread = float(np.ptp(record.position))
    if step is not None and step > 2e-3 * spread:
        yield (
            f"The reading comes in steps of {show(step, record.position_unit)}, "
            f"{100 * step / spread:.1f} % of its range: rounding alone leaves about "
            f"{show(step / np.sqrt(12.0), record.position_unit)} rms."
        )


def _aliasing_remarks(record: Measurement) -> Iterator[str]:
    if record.between is Between.BANDLIMITED:
        return
    drive = record.drive
    spread = float(np.ptp(drive))
    jumps = np.flatnonzero(np.abs(np.diff(drive)) > 0.3 * spread) + 1
    if jumps.size >= 3:
        dwell = float(np.median(np.diff(jumps)))
        # Dwelling between the jumps is what makes it a step drive and not a fast sine.
        flat = np.count_nonzero(np.abs(np.diff(drive)) <= 0.02 * spread)
        if dwell <= 8 and flat >= 0.25 * drive.size:
            yield (
                f"The drive steps every {dwell:g} samples, so the answer to a step is not "
                f"sampled: nothing above {show(record.rate / 2, 'Hz')} can be identified, and a "
                "resonance fitted to this record is an artefact of its sampling."
            )
            return
    fraction = _fast_fraction(record)
    if fraction > 0.2:
        yield (
            f"{100 * fraction:.0f} % of the drive's power lies above a quarter of the sampling "
            f"rate ({show(record.rate / 4, 'Hz')}): aliasing is likely and what happens between "
            "samples is not known; sample faster."
        )


def _fast_fraction(record: Measurement) -> float:
    """Share of the drive's power above half the Nyquist frequency, on its longest even stretch."""
    steps = np.diff(record.time)
    breaks = np.flatnonzero(np.abs(steps - record.step) > 0.05 * record.step)
    bounds = np.concatenate([[-1], breaks, [steps.size]])
    longest = int(np.argmax(np.diff(bounds)))
    drive = record.drive[bounds[longest] + 1 : bounds[longest + 1] + 1]
    if drive.size < 16:
        return 0.0
    power = np.abs(np.fft.rfft(signal.detrend(drive) * np.hanning(drive.size))) ** 2
    total = float(power.sum())
    return float(power[power.size // 2 + 1 :].sum()) / total if total > 0 else 0.0


def _resampled(record: Measurement, step: float) -> Measurement:
    period = record.period
    if record.uniform and record.between is Between.BANDLIMITED and period is not None:
        samples, new = round(period / record.step), period / step
        whole = len(record) == samples * (len(record) // samples)
        if whole and abs(new - round(new)) < 1e-6 * new:
            return _by_fourier(record, step, round(new) * (len(record) // samples))
    lowered = record.uniform and step > record.step * (1 + 1e-9)
    count = int(np.floor(record.duration / step + 1e-6)) + 1
    time = record.time[0] + step * np.arange(count)

    def moved(values: FloatArray) -> FloatArray:
        return np.asarray(np.interp(time, record.time, values), dtype=np.float64)

    def held(values: FloatArray) -> FloatArray:
        at = np.searchsorted(record.time, time + 1e-9 * record.step, side="right") - 1
        return np.asarray(values[at], dtype=np.float64)

    def filtered(values: FloatArray) -> FloatArray:
        smooth = _low_passed(values, record.step / step)
        even = record.time[0] + record.step * np.arange(len(record))
        return _cubic(even, smooth, time)

    other = filtered if lowered else moved
    hold = record.between is Between.HELD and not lowered
    return replace(
        record,
        time=time,
        drive=held(record.drive) if hold else other(record.drive),
        position=other(record.position),
        channels={name: other(values) for name, values in record.channels.items()},
        between=Between.LINEAR if lowered and record.between is Between.HELD else record.between,
        allow_saturated=True,
    )


def _by_fourier(record: Measurement, step: float, count: int) -> Measurement:
    def series(values: FloatArray) -> FloatArray:
        return np.asarray(signal.resample(values, count), dtype=np.float64)

    return replace(
        record,
        time=record.time[0] + step * np.arange(count),
        drive=series(record.drive),
        position=series(record.position),
        channels={name: series(values) for name, values in record.channels.items()},
        allow_saturated=True,
    )


def _low_passed(values: FloatArray, ratio: float) -> FloatArray:
    """Zero-phase low-pass at 0.8 of the new Nyquist frequency, ``ratio`` = old step / new step.

    A Kaiser-windowed sinc (60 dB); the ends are continued by odd reflection so that a trend
    stays a trend.
    """
    half = min(int(np.ceil(20.0 / ratio)), values.size - 1)
    kernel = signal.firwin(2 * half + 1, 0.8 * ratio, window=("kaiser", 5.65))
    head = 2.0 * values[0] - values[half:0:-1]
    tail = 2.0 * values[-1] - values[-2 : -half - 2 : -1]
    extended = np.concatenate([head, values, tail])
    return np.asarray(signal.oaconvolve(extended, kernel, mode="valid"), dtype=np.float64)


def _cubic(time: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    return np.asarray(CubicSpline(time, values)(np.clip(at, time[0], time[-1])), dtype=np.float64)
