"""A drive that can be played: samples at an even rate, and what they are."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.choosing import expected, real
from piezo_opt.errors import InputError
from piezo_opt.files import MOST_ROWS, replacing
from piezo_opt.measurement import FEWEST_SAMPLES, Between, Measurement
from piezo_opt.readers.memory import hdf5_in_memory
from piezo_opt.units import show

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Drive:
    """Samples that a converter plays one after another.

    Args:
        name: short, also that of its files.
        description: in words.
        values: (N,) [unit].
        rate: samples a second [Hz].
        unit: SI unit of the drive.
        period: [s], of a signal that repeats.
        excited: frequencies of its lines [Hz], empty where it is no sum of lines.
        silent: frequencies left out on purpose, on which only distortion answers [Hz].
        steps: whether it jumps by its nature, and a slew limit makes ramps of its edges.

    Raises:
        InputError: too few or too many samples, one that is no number, or a rate that is none.
    """

    name: str
    description: str
    values: FloatArray
    rate: float
    unit: str = "V"
    period: float | None = None
    excited: tuple[float, ...] = ()
    silent: tuple[float, ...] = ()
    steps: bool = False

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=np.float64)
        if not 0.0 < self.rate < np.inf:
            raise InputError(f"{self.name}: rate is {self.rate:g} Hz; give a positive one")
        if values.ndim != 1 or not FEWEST_SAMPLES <= values.size <= MOST_ROWS:
            raise InputError(
                f"{self.name}: {values.size} samples; choose duration and rate so that there are "
                f"{FEWEST_SAMPLES} to {MOST_ROWS}"
            )
        if not np.isfinite(values).all():
            raise InputError(f"{self.name}: holds values that are not numbers")
        values.setflags(write=False)
        object.__setattr__(self, "values", values)

    @property
    def time(self) -> FloatArray:
        """(N,) from 0 [s]."""
        return np.asarray(np.arange(self.values.size) / self.rate)

    @property
    def duration(self) -> float:
        """N / rate [s]."""
        return self.values.size / self.rate

    @property
    def low(self) -> float:
        """Smallest value [unit]."""
        return float(self.values.min())

    @property
    def high(self) -> float:
        """Largest value [unit]."""
        return float(self.values.max())

    @property
    def slew(self) -> float:
        """Largest change from sample to sample, over the time between them [unit/s]."""
        return float(np.abs(np.diff(self.values)).max()) * self.rate

    @property
    def crest(self) -> float:
        """Largest deviation from the mean over the rms one; the smaller, the more power fits in."""
        swing = self.values - self.values.mean()
        rms = float(np.sqrt(np.mean(swing**2)))
        return float(np.abs(swing).max()) / rms if rms > 0.0 else np.inf

    def repeated(self, times: int) -> Drive:
        """The same, played so many times in a row.

        Raises:
            InputError: fewer than once, or more samples than a file may hold.
        """
        if times < 1:
            raise InputError(f"{self.name}: played {times} times; give at least 1")
        said = self.description if times == 1 else f"{self.description}, {times} times"
        return replace(self, values=np.tile(self.values, times), description=said)

    def then(self, other: Drive) -> Drive:
        """This drive and then another one.

        Raises:
            InputError: rate or unit differ.
        """
        if other.rate != self.rate or other.unit != self.unit:
            raise InputError(
                f"{self.name} at {self.rate:g} Hz in {self.unit} and {other.name} at "
                f"{other.rate:g} Hz in {other.unit}: make both at one rate, in one unit"
            )
        return Drive(
            name=f"{self.name}_then_{other.name}"[:80],
            description=f"{self.description}; then {other.description}",
            values=np.concatenate([self.values, other.values]),
            rate=self.rate,
            unit=self.unit,
            steps=self.steps or other.steps,
        )

    def played(
        self, position: FloatArray | None = None, *, between: Between = Between.HELD
    ) -> Measurement:
        """A record of this drive: with what was read, or to simulate a model on.

        Args:
            position: (N,) reading [m]; the drive itself takes its place where there is none.
            between: how the converter moves between samples.
        """
        return Measurement(
            time=self.time,
            drive=self.values,
            position=self.values if position is None else position,
            name=self.name,
            drive_unit=self.unit,
            between=between,
            allow_saturated=True,
        )

    def write(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write time and drive as .csv, or as .h5: the whole file or none of it.

        Raises:
            InputError: another suffix, or the file exists or cannot be written.
        """
        expected((str, os.PathLike), path, "The file", "its path")
        suffix = Path(path).suffix.lower()
        if suffix not in (".csv", ".h5", ".hdf5"):
            raise InputError(f"{path}: a drive is written as .csv, .h5 or .hdf5: choose one")
        with replacing(path, overwrite=overwrite) as temporary:
            if suffix == ".csv":
                self._write_csv(temporary)
            else:
                self._write_hdf5(temporary)

    def _write_csv(self, path: Path) -> None:
        signal = "voltage" if self.unit == "V" else "drive"
        with path.open("x", encoding="utf-8", newline="\n") as lines:
            lines.write(f"# {self.description}\ntime [s],{signal} [{self.unit}]\n")
            for row in zip(self.time.tolist(), self.values.tolist(), strict=True):
                lines.write(",".join(map(repr, row)) + "\n")

    def _write_hdf5(self, path: Path) -> None:
        with hdf5_in_memory(path) as file:
            for name, values, unit in (
                ("time", self.time, "s"),
                ("drive", self.values, self.unit),
            ):
                file.create_dataset(name, data=values).attrs["units"] = unit
            file.attrs["description"] = self.description
            file.attrs["rate"] = self.rate

    def __str__(self) -> str:
        return (
            f"{self.description}: {self.values.size} samples at {show(self.rate, 'Hz')}, "
            f"{show(self.low, self.unit)} to {show(self.high, self.unit)}, at most "
            f"{show(self.slew, f'{self.unit}/s')}"
        )


def sampled(duration: float, rate: float, name: str) -> FloatArray:
    """(N,) instants of a signal [s].

    Raises:
        InputError: a duration or a rate that is not positive, or too many samples.
    """
    real(duration, f"{name}: the time")
    real(rate, f"{name}: rate")
    if not (0.0 < duration < np.inf and 0.0 < rate < np.inf):
        raise InputError(
            f"{name}: lasts {duration:g} s at {rate:g} Hz; give a positive time and rate"
        )
    count = round(duration * rate)
    if count > MOST_ROWS:
        raise InputError(f"{name}: {count} samples; a file holds {MOST_ROWS} at most")
    return np.asarray(np.arange(count) / rate)


def check_range(low: float, high: float, name: str) -> None:
    """Refuse a range that is none.

    Raises:
        InputError: low is not below high.
    """
    real(low, f"{name}: low")
    real(high, f"{name}: high")
    if not (np.isfinite([low, high]).all() and low < high):
        raise InputError(f"{name}: from {low:g} to {high:g} does not move; give low below high")
