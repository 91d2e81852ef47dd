"""Drives that may be played next: what each one is, its samples, and its file."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.measurement import FEWEST_SAMPLES, Measurement
from piezo_opt.readers.files import MOST_ROWS, replacing
from piezo_opt.units import show

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Excitation(ABC):
    """A drive between ``low`` and ``high`` [``unit``] that lasts ``duration`` [s].

    Raises:
        InputError: the range is empty, or the duration is not a positive time.
    """

    kind: ClassVar[str]

    low: float
    high: float
    duration: float
    unit: str = field(default="V", kw_only=True)

    def __post_init__(self) -> None:
        if not (np.isfinite([self.low, self.high]).all() and self.low < self.high):
            raise InputError(
                f"{self.kind}: a drive from {self.low:g} to {self.high:g} {self.unit} does not "
                "move; give low below high."
            )
        if not 0.0 < self.duration < np.inf:
            raise InputError(f"{self.kind}: lasts {self.duration:g} s; give a positive time.")

    @property
    @abstractmethod
    def name(self) -> str:
        """Short name, also that of its file."""

    @property
    @abstractmethod
    def description(self) -> str:
        """The drive in words."""

    @abstractmethod
    def voltage(self, time: FloatArray) -> FloatArray:
        """The drive [V] at instants (N,) from its start [s]."""

    def samples(self, rate: float) -> tuple[FloatArray, FloatArray]:
        """Time (N,) [s] and drive (N,) [V] at ``rate`` [Hz].

        Raises:
            InputError: the rate leaves too few samples, or more than a file may hold.
        """
        count = round(self.duration * rate) if 0.0 < rate < np.inf else 0
        if not FEWEST_SAMPLES <= count <= MOST_ROWS:
            raise InputError(
                f"{self.name}: {rate:g} Hz over {self.duration:g} s gives {count} samples; choose "
                f"a rate that gives {FEWEST_SAMPLES} to {MOST_ROWS}."
            )
        time = np.arange(count) / rate
        return time, np.clip(self.voltage(time), self.low, self.high)

    def write(
        self,
        path: str | os.PathLike[str],
        rate: float,
        *,
        overwrite: bool = False,
    ) -> None:
        """Write ``time [s],voltage [V]`` as CSV: the whole file or none of it.

        Args:
            path: the file.
            rate: samples a second [Hz].
            overwrite: replace an existing file.

        Raises:
            InputError: the file exists and may not be overwritten, or cannot be written.
        """
        time, voltage = self.samples(rate)
        signal = "voltage" if self.unit == "V" else "drive"
        with (
            replacing(path, overwrite=overwrite) as temporary,
            temporary.open("x", encoding="utf-8", newline="\n") as lines,
        ):
            lines.write(f"# {self.description}\ntime [s],{signal} [{self.unit}]\n")
            for row in zip(time.tolist(), voltage.tolist(), strict=True):
                lines.write(",".join(map(repr, row)) + "\n")

    @property
    def _range(self) -> str:
        return f"{_short(self.low)}..{_short(self.high)} {self.unit}"

    @property
    def _swing(self) -> float:
        return self.high - self.low


@final
@dataclass(frozen=True)
class Sine(Excitation):
    """Sine of one frequency [Hz], from its lowest point."""

    kind = "sine"

    frequency: float

    @property
    def name(self) -> str:
        """``sine_5_Hz_0_60_V``"""
        return _file(f"sine {_short(self.frequency)} Hz {self.low:.3g} {self.high:.3g} {self.unit}")

    @property
    def description(self) -> str:
        """The drive in words."""
        return f"sine {self._range}, {_short(self.frequency)} Hz, {show(self.duration, 's')}"

    def voltage(self, time: FloatArray) -> FloatArray:
        """The drive [V] at instants (N,) from its start [s]."""
        wave = 0.5 - 0.5 * np.cos(2.0 * np.pi * self.frequency * time)
        return np.asarray(self.low + self._swing * wave)


@final
@dataclass(frozen=True)
class Multisine(Excitation):
    """Sum of equal sines on a logarithmic grid of harmonics, with Schroeder's phases.

        u = sum_k cos(2 pi f_k t + phi_k),   phi_k = -pi k (k - 1) / K,   scaled to the range

    Source: Schroeder (1970), IEEE Trans. Information Theory 16(1), 85-89.
    """

    kind = "multisine"

    lowest: float
    highest: float
    lines: int = 40

    @property
    def name(self) -> str:
        """``multisine_0.5_125_Hz``"""
        return _file(f"multisine {_short(self.lowest)} {_short(self.highest)} Hz")

    @property
    def description(self) -> str:
        """The drive in words."""
        return (
            f"multisine {self._range}, {self._harmonics().size} lines from "
            f"{_short(self.lowest)} to {_short(self.highest)} Hz, {show(self.duration, 's')}"
        )

    def voltage(self, time: FloatArray) -> FloatArray:
        """The drive [V] at instants (N,) from its start [s]."""
        harmonics = self._harmonics()
        wave = np.zeros_like(time)
        for k, harmonic in enumerate(harmonics, start=1):
            phase = -np.pi * k * (k - 1) / harmonics.size
            wave += np.cos(2.0 * np.pi * harmonic / self.duration * time + phase)
        span = float(np.ptp(wave)) or 1.0
        return np.asarray(self.low + self._swing * (wave - wave.min()) / span)

    def _harmonics(self) -> FloatArray:
        grid = np.geomspace(self.lowest, self.highest, self.lines) * self.duration
        return np.unique(np.maximum(1.0, np.round(grid)))


@final
@dataclass(frozen=True)
class Triangle(Excitation):
    """Triangle with a hold [s] at each end and a minor loop on the way down.

    Every second triangle goes only half as high, so that a branch is passed from two turns.
    """

    kind = "triangle"

    frequency: float
    hold: float
    minor: bool = True

    @property
    def name(self) -> str:
        """``triangle_2_Hz_1_s_holds``"""
        return _file(f"triangle {_short(self.frequency)} Hz {_short(self.hold)} s holds")

    @property
    def description(self) -> str:
        """The drive in words."""
        loops = " with minor loops" if self.minor else ""
        return (
            f"triangle {self._range}{loops}, {_short(self.frequency)} Hz, "
            f"{show(self.hold, 's')} holds, {show(self.duration, 's')}"
        )

    def voltage(self, time: FloatArray) -> FloatArray:
        """The drive [V] at instants (N,) from its start [s]."""
        way = 0.5 / self.frequency
        corners, levels, top = [0.0], [0.0], 1.0

        def go(level: float) -> None:
            corners.append(corners[-1] + way * abs(level - levels[-1]))
            levels.append(level)

        def stay() -> None:
            corners.append(corners[-1] + self.hold)
            levels.append(levels[-1])

        while corners[-1] <= self.duration:
            go(top)
            stay()
            if self.minor:
                go(0.5 * top)
                go(0.75 * top)
            go(0.0)
            stay()
            top = 1.5 - top
        return np.asarray(self.low + self._swing * np.interp(time, corners, levels))


@final
@dataclass(frozen=True)
class StepAndHold(Excitation):
    """One step over the whole range after a rest [s], held to the end."""

    kind = "step and hold"

    rest: float

    @property
    def name(self) -> str:
        """``step_and_hold_60_V``"""
        return _file(f"step and hold {self._swing:.3g} {self.unit}")

    @property
    def description(self) -> str:
        """The drive in words."""
        return (
            f"step and hold of {_short(self._swing)} {self.unit} ({self._range}) after "
            f"{show(self.rest, 's')}, held {show(self.duration - self.rest, 's')}"
        )

    def voltage(self, time: FloatArray) -> FloatArray:
        """The drive [V] at instants (N,) from its start [s]."""
        return np.where(time < self.rest, self.low, self.high)


@final
@dataclass(frozen=True)
class Staircase(Excitation):
    """Steps up and down to levels given as shares of the range, each held equally long."""

    kind = "staircase"

    levels: tuple[float, ...]

    @property
    def name(self) -> str:
        """``staircase_8_steps``"""
        return _file(f"staircase {len(self.levels)} steps")

    @property
    def description(self) -> str:
        """The drive in words."""
        volts = ", ".join(_short(self.low + self._swing * level) for level in self.levels)
        return f"staircase {volts} {self.unit}, {show(self.duration / len(self.levels), 's')} each"

    def voltage(self, time: FloatArray) -> FloatArray:
        """The drive [V] at instants (N,) from its start [s]."""
        index = np.floor(time / self.duration * len(self.levels) + 1e-9).astype(np.int64)
        levels = np.array(self.levels)[np.clip(index, 0, len(self.levels) - 1)]
        return np.asarray(self.low + self._swing * levels)


@final
@dataclass(frozen=True)
class Chirp(Excitation):
    """Sine whose frequency grows from ``lowest`` to ``highest`` [Hz] by equal factors."""

    kind = "chirp"

    lowest: float
    highest: float

    @property
    def name(self) -> str:
        """``chirp_0.5_100_Hz``"""
        return _file(f"chirp {_short(self.lowest)} {_short(self.highest)} Hz")

    @property
    def description(self) -> str:
        """The drive in words."""
        return (
            f"chirp {self._range}, {_short(self.lowest)} to {_short(self.highest)} Hz, "
            f"{show(self.duration, 's')}"
        )

    def voltage(self, time: FloatArray) -> FloatArray:
        """The drive [V] at instants (N,) from its start [s]."""
        growth = np.log(self.highest / self.lowest) / self.duration
        phase = 2.0 * np.pi * self.lowest * np.expm1(growth * time) / growth
        return np.asarray(self.low + self._swing * (0.5 - 0.5 * np.cos(phase)))


def candidate_drives(
    record: Measurement, duration: float | None = None, resonance: float | None = None
) -> tuple[Excitation, ...]:
    """Drives worth considering next, within the record's own range of drive.

    Slow and fast, large and small, smooth, with corners, with jumps, with rests: each kind shows
    another family of effects. Fast ones take half of the range, in its middle.

    Args:
        record: gives range and sampling rate.
        duration: of each drive [s]; the record's own unless told otherwise.
        resonance: [Hz], where one is known: fast sines stay below it, chirps pass it.
    """
    low, high = float(record.drive.min()), float(record.drive.max())
    lasting = record.duration + record.step if duration is None else duration
    rate = record.rate
    middle, quarter = 0.5 * (low + high), 0.25 * (high - low)
    slow = 4.0 / lasting
    top = rate / 6.0
    fast = rate / 25.0
    if resonance is not None and resonance < 0.5 * rate:
        top = min(top, max(3.0 * resonance, 10.0 * slow))
        fast = min(fast, resonance / 3.0)
    unit = record.drive_unit
    found: list[Excitation] = [
        Sine(low, high, lasting, slow, unit=unit),
        Sine(middle - quarter, middle + quarter, lasting, slow, unit=unit),
    ]
    if fast > 4.0 * slow:
        found.append(Sine(middle - quarter, middle + quarter, lasting, fast, unit=unit))
    if top > 4.0 * slow:
        half = middle - quarter, middle + quarter
        found.append(Multisine(low, high, lasting, 1.0 / lasting, top, unit=unit))
        found.append(Chirp(*half, lasting, 0.5 * slow, top, unit=unit))
    found += [
        Triangle(low, high, lasting, 8.0 / lasting, lasting / 8.0, unit=unit),
        StepAndHold(low, high, lasting, 0.1 * lasting, unit=unit),
        Staircase(low, high, lasting, (0.0, 0.5, 1.0, 0.25, 0.75, 0.0, 1.0, 0.0), unit=unit),
    ]
    return tuple(found)


def _short(number: float) -> str:
    return f"{number:.3g}"


def _file(text: str) -> str:
    return text.replace(" ", "_").replace("/", "_per_")
