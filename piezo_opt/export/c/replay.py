"""The written code is compiled and run on a record, and must read what the library reads."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.effects.model import Model
from piezo_opt.errors import ModelError
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Simulator, Substeps
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

ADMITTED: Final = {"double": 1e-9, "float": 1e-5}
"""Largest difference as a share of the stroke: rounding of millions of steps, and no more."""
_SLOPES: Final = {"double": 1e-8, "float": 1e-3}
"""The same for derivatives, each column in its own size: a derivative is made of differences, and
the tangents' sums do not remember their rounding."""
_REMEDY: Final = {
    "double": "please send the model; nothing was written.",
    "float": "four bytes are too few for it: export it in double; nothing was written.",
}


@final
@dataclass(frozen=True, eq=False)
class Replay:
    """What the compiled code read on a record, beside the library.

    Attributes:
        record: its name.
        samples: their number.
        largest: largest difference from the library [m].
        stroke: range of the reading [m].
        reading: (N,) of the compiled code [m].
        slopes: largest difference of a derivative from the library's, over the largest derivative
            by the same parameter, or the stroke over the parameter where that is more; None where
            none are carried along.
    """

    record: str
    samples: int
    largest: float
    stroke: float
    reading: FloatArray
    slopes: float | None = None

    @property
    def share(self) -> float:
        """The largest difference as a share of the stroke."""
        return self.largest / self.stroke if self.stroke > 0.0 else self.largest

    def __str__(self) -> str:
        return (
            f"replayed {self.record} ({self.samples} samples): at most {show(self.largest, 'm')} "
            f"from the library, {self.share:.1e} of the stroke"
            + ("" if self.slopes is None else f"; derivatives agree to {self.slopes:.1e}")
        )


def replay(
    folder: Path,
    name: str,
    precision: str,
    compiler: str,
    model: Model,
    values: Mapping[str, float],
    record: Measurement,
    substeps: Substeps,
    channels: Sequence[str],
    directions: Sequence[str] = (),
) -> Replay:
    """Compile the folder's program, run it on a record, and compare.

    Args:
        folder: holds main.c and the code.
        record: every sample a straight line.
        substeps: as the code has them.
        channels: what it follows beside the drive.
        directions: parameters by which the program tells derivatives.

    Raises:
        ModelError: it does not compile, or reads something else than the library.
    """
    simulator = Simulator(model, record, values, substeps=substeps, directions=directions)
    wanted, slopes_wanted = (
        simulator.with_sensitivities(values) if directions else (simulator.reading(values), None)
    )
    with tempfile.TemporaryDirectory(prefix="piezo_opt_replay_") as scratch:
        binary = Path(scratch) / "replay"
        built = subprocess.run(
            [compiler, "-std=c99", "-O2", *(str(folder / f) for f in (f"{name}.c", "main.c")),
             "-lm", "-o", str(binary)],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if built.returncode:
            first = (built.stderr.strip() or "no message").splitlines()[0]
            raise ModelError(f"The exported code does not compile with {compiler}: {first}")
        done = subprocess.run(
            [str(binary)], input=rows(record, channels), capture_output=True, text=True, check=False
        )
    if done.returncode:
        raise ModelError(f"The exported code stopped on {record.name}: {done.stderr.strip()}")
    table = np.array([line.split(",")[1:] for line in done.stdout.splitlines()[1:]], dtype=float)
    got, slopes = table[:, 0], table[:, 1:]
    apart = np.abs(got - wanted)
    off = None
    if slopes_wanted is not None:
        numbers = np.array([values[name] for name in directions])
        off = _off(slopes, slopes_wanted, numbers, float(np.ptp(wanted)))
    found = Replay(record.name, got.size, float(apart.max()), float(np.ptp(wanted)), got, off)
    if not found.share <= ADMITTED[precision]:
        at = int(np.argmax(np.where(np.isnan(apart), np.inf, apart)))
        raise ModelError(
            f"The exported code ({precision}) does not read what the library reads: on "
            f"{record.name} they differ by {found.share:.1e} of the stroke at {record.time[at]:g} "
            f"s and {ADMITTED[precision]:g} is admitted; "
            f"{_REMEDY[precision]}"
        )
    if off is not None and not off <= _SLOPES[precision]:
        raise ModelError(
            f"The exported code ({precision}) has other derivatives than the library: on "
            f"{record.name} they differ by {off:.1e} of their size and {_SLOPES[precision]:g} "
            f"is admitted; {_REMEDY[precision]}"
        )
    return found


def _off(found: FloatArray, wanted: FloatArray, values: FloatArray, stroke: float) -> float:
    """Largest difference of derivatives, each column in the size of what it is about.

    That is its largest number; or the stroke over the parameter, where the parameter as a whole
    decides less than the stroke: what next to nothing follows from is known by rounding only.
    """
    with np.errstate(divide="ignore"):
        size = np.maximum(np.abs(wanted).max(axis=0), stroke / np.abs(values))
    size = np.where((size > 0.0) & np.isfinite(size), size, np.abs(wanted).max(axis=0))
    return float((np.abs(found - wanted).max(axis=0) / np.where(size > 0.0, size, 1.0)).max())


def rows(record: Measurement, channels: Sequence[str]) -> str:
    """Time from the start, drive and these channels of a record, a line a sample."""
    columns = [record.time - record.time[0], record.drive]
    columns += [record.channels[name] for name in channels]
    table = zip(*(column.tolist() for column in columns), strict=True)
    return "".join(f"{','.join(map(repr, row))}\n" for row in table)
