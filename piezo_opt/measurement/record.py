"""One record: N samples of time, drive and position, and how they were taken."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, final

import numpy as np

from piezo_opt.choosing import chosen, expected
from piezo_opt.errors import InputError
from piezo_opt.measurement.arrays import BoolArray, FloatArray, frozen, kept_mask
from piezo_opt.measurement.between import Between
from piezo_opt.measurement.checks import (
    FEWEST_SAMPLES,
    check_period,
    check_saturation,
    check_signals,
    check_startup,
    check_unit,
)
from piezo_opt.measurement.clock import Clock
from piezo_opt.measurement.findings import Finding, found
from piezo_opt.measurement.outliers import outlier_remarks
from piezo_opt.measurement.periods import by_period, noise_between, repetition, whole_periods
from piezo_opt.measurement.resampling import resampling
from piezo_opt.measurement.resolution import resolution
from piezo_opt.measurement.spectra import densities, frequencies, without_line
from piezo_opt.units import quantity, show

_MOST_SAMPLES = 50_000_000
"""As many as a file may hold."""
_SPECTRAL = 64
"""Samples from which a spectrum says something."""


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
        left_out: (N,) mask of readings that are none; they are not counted in errors.
        notes: sentences about what was concluded while reading; the remarks begin with them.

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
    between: Between = Between.UNKNOWN
    period: float | None = None
    startup: float = 0.0
    source: str = ""
    allow_saturated: bool = False
    channel_units: Mapping[str, str] = field(default_factory=dict)
    left_out: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._check_words()
        signals = {
            "time": frozen(self.time, "time", self.name),
            "drive": frozen(self.drive, "drive", self.name),
            "position": frozen(self.position, "position", self.name),
        }
        if not isinstance(self.channels, Mapping) or not isinstance(self.channel_units, Mapping):
            raise InputError(
                f"{self.name}: channels and their units go by name: channels={{'temperature': ...}}"
            )
        channels = {
            str(name): frozen(values, str(name), self.name)
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
        object.__setattr__(self, "between", chosen(Between, self.between, f"{self.name}: between"))
        if self.period is not None:
            object.__setattr__(self, "period", self._seconds("period"))
        object.__setattr__(self, "startup", self._seconds("startup"))
        check_signals(self.name, {**signals, **channels})
        left_out = kept_mask(self.left_out, signals["time"].size, self.name)
        object.__setattr__(self, "left_out", left_out)
        for unit in (self.drive_unit, self.position_unit, *units.values()):
            check_unit(self.name, unit)
        check_startup(self.name, self.clock, self.startup)
        if not self.counted.any():
            raise InputError(f"{self.name}: every reading is left out: keep some")
        if self.period is not None:
            check_period(self.name, self.clock, self.drive, self.period)
        if not self.allow_saturated:
            check_saturation(self.name, self.time, self.drive, self.position, self.position_unit)

    def _check_words(self) -> None:
        """Refuse names, sources and notes that are no text, and an answer that is not yes or no."""
        for what in ("name", "source"):
            expected(str, getattr(self, what), what, "a text")
        expected((bool, np.bool_), self.allow_saturated, "allow_saturated", "True or False")
        given: object = (self.notes,) if isinstance(self.notes, str) else self.notes
        expected(Iterable, given, "notes", "a tuple of sentences")
        notes = tuple(self.notes) if given is self.notes else (str(self.notes),)
        for note in notes:
            expected(str, note, "A note", "a sentence")
        object.__setattr__(self, "notes", notes)

    def _seconds(self, what: str) -> float:
        """A time [s] that is given as a number or as a quantity; the record checks what it says."""
        value = getattr(self, what)
        if isinstance(value, float) or (isinstance(value, int) and not isinstance(value, bool)):
            return float(value)
        try:
            return quantity(value, "s")
        except InputError as error:
            raise InputError(f"{self.name}: {what}: {error}") from error

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

    @cached_property
    def clock(self) -> Clock:
        """The instants, and how even they are."""
        return Clock(self.time)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return self.clock.duration

    @property
    def uniform(self) -> bool:
        """Whether every sample lies within 1 % of a step of an even grid."""
        return self.clock.uniform

    @property
    def step(self) -> float:
        """Sampling interval [s]: the median one, or the exact one of a uniform record."""
        return self.clock.step

    @property
    def rate(self) -> float:
        """Samples a second [Hz]."""
        return self.clock.rate

    @cached_property
    def counted(self) -> BoolArray:
        """(N,) mask of the samples that errors are counted on: after the start-up, not left out."""
        after = self.clock.after(self.startup)
        if not self.left_out.any():
            return after
        mask: BoolArray = after & ~self.left_out
        mask.flags.writeable = False
        return mask

    @cached_property
    def line(self) -> tuple[float, float]:
        """Slope [m/V] and intercept [m] of position over drive on the counted samples."""
        drive, position = self.drive[self.counted], self.position[self.counted]
        middle, height = float(drive.mean()), float(position.mean())
        away = drive - middle
        slope = float(away @ position) / (float(away @ away) or 1.0)
        return slope, height - slope * middle

    @cached_property
    def response(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies [Hz], and size of the answer to the drive where it follows from it.

        ``|S_uy| / S_uu`` over four stretches that overlap by half; 0 where the coherence is below
        a half or the drive has next to no power. On an even grid, of 64 samples or more; shorter
        records have none.
        """
        if len(self) < _SPECTRAL:
            return np.zeros(0), np.zeros(0)
        rate, length = (len(self) - 1) / self.duration, max(_SPECTRAL, len(self) // 4)
        u, y = (without_line(self.evenly(one)) for one in (self.drive, self.position))
        power, cross, spectrum = densities(u, y, rate=rate, length=length)
        with np.errstate(divide="ignore", invalid="ignore"):
            coherence = np.abs(cross) ** 2 / (power * spectrum)
            follows = (coherence > 0.5) & (power > 1e-8 * power.max())
            size = np.where(follows, np.abs(cross) / power, 0.0)
        return frequencies(length, rate), np.nan_to_num(size)

    def driven(self, between: Between | None) -> Measurement:
        """The record with that way of its drive between samples, where nobody has said one."""
        if between is None or self.between is not Between.UNKNOWN:
            return self
        return self.with_(between=between, allow_saturated=True)

    def evenly(self, values: FloatArray) -> FloatArray:
        """A signal (N,) on as many even instants, by straight lines where they are not even."""
        if self.uniform:
            return values
        return np.interp(np.linspace(self.time[0], self.time[-1], len(self)), self.time, values)

    @cached_property
    def falls(self) -> bool:
        """Whether the position falls as the drive rises (a mirrored sensor or amplifier).

        Judged on running sums, in which the slow part outweighs a resonance: beyond that the
        position falls as the drive rises, and nothing is mirrored. Without their lines: what
        settles at the beginning shifts the mean, and a running sum is a ramp from there.
        """
        drive, position = (
            without_line(np.cumsum(one[self.counted] - one[self.counted].mean()))
            for one in (self.drive, self.position)
        )
        return float(drive @ position) < 0.0

    @property
    def gaps(self) -> tuple[tuple[float, float], ...]:
        """(last instant before, first instant after) [s] of every interval over 1.5 steps."""
        return self.clock.gaps

    @cached_property
    def resolution(self) -> float | None:
        """Step of the reading's quantisation [position_unit]; None when none is found.

        The widest grid that holds at least 70 % of the samples, on five levels or more. Steps
        below 1/2000 of the range are not looked for: noise hides them.
        """
        return resolution(self.drive, self.position)

    @cached_property
    def periods(self) -> int:
        """Number of whole periods after the start-up; 0 for a record without a period."""
        if self.period is None:
            return 0
        return whole_periods(self.clock, self.startup, self.period)

    @cached_property
    def repetition(self) -> int | None:
        """After how many samples the drive plays the same again; None where it does not.

        Looked for on even sampling. Unlike ``period`` it says nothing about the state: the reading
        may still settle from one repetition to the next.
        """
        return repetition(self.drive) if self.uniform else None

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What the record shows about itself: wrong readings, a wrong unit, a wrong clock ..."""
        return found(self)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """What was concluded of the record and what it shows, in sentences; empty without flaws."""
        return (*self.notes, *(str(one) for one in self.findings))

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Of ``remarks`` those on readings that look wrong."""
        return tuple(outlier_remarks(self.time, self.drive, self.position, self.position_unit))

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
            left_out=self.left_out[mask],
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
        if self.duration / new > _MOST_SAMPLES:
            raise InputError(
                f"{self.name}: a step of {new:g} s makes {self.duration / new:.3g} samples of "
                f"{show(self.duration, 's')}: choose a longer step"
            )
        way = resampling(self.clock, new, between=self.between, period=self.period)
        return replace(
            self,
            time=way.time,
            drive=way.drive(self.drive),
            position=way.other(self.position),
            channels={name: way.other(values) for name, values in self.channels.items()},
            left_out=np.interp(way.time, self.time, self.left_out.astype(np.float64)) > 0.0,
            between=way.between,
            allow_saturated=True,
        )

    def repeated_periods(self) -> FloatArray:
        """(periods, samples a period) readings after the start-up [position_unit].

        Raises `InputError` for a record without a period or without even sampling.
        """
        return by_period(
            self.name, self.clock, self.position, startup=self.startup, period=self.period
        )

    def noise_from_periods(self) -> float:
        """Noise of the reading, rms [position_unit], from what differs between the periods.

        sqrt(sum_pk (y_pk - mean_p y_pk)^2 / ((P - 1) K)) over P periods of K samples; needs two.
        """
        return noise_between(self.name, self.repeated_periods())

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


def _rebuild(state: dict[str, Any]) -> Measurement:
    return Measurement(**state)
