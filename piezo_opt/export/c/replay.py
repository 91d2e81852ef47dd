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
    """

    record: str
    samples: int
    largest: float
    stroke: float
    reading: FloatArray

    @property
    def share(self) -> float:
        """The largest difference as a share of the stroke."""
        return self.largest / self.stroke if self.stroke > 0.0 else self.largest

    def __str__(self) -> str:
        return (
            f"replayed {self.record} ({self.samples} samples): at most {show(self.largest, 'm')} "
            f"from the library, {self.share:.1e} of the stroke"
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
) -> Replay:
    """Compile the folder's program, run it on a record, and compare.

    Args:
        folder: holds main.c and the code.
        record: every sample a straight line.
        substeps: as the code has them.
        channels: what it follows beside the drive.

    Raises:
        ModelError: it does not compile, or reads something else than the library.
    """
    wanted = Simulator(model, record, values, substeps=substeps).reading(values)
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
    got = np.array([line.split(",")[1] for line in done.stdout.splitlines()[1:]], dtype=float)
    apart = np.abs(got - wanted)
    found = Replay(record.name, got.size, float(apart.max()), float(np.ptp(wanted)), got)
    if not found.share <= ADMITTED[precision]:
        at = int(np.argmax(np.where(np.isnan(apart), np.inf, apart)))
        raise ModelError(
            f"The exported code ({precision}) does not read what the library reads: on "
            f"{record.name} they differ by {found.share:.1e} of the stroke at {record.time[at]:g} "
            f"s and {ADMITTED[precision]:g} is admitted; "
            f"{_REMEDY[precision]}"
        )
    return found


def rows(record: Measurement, channels: Sequence[str]) -> str:
    """Time from the start, drive and these channels of a record, a line a sample."""
    columns = [record.time - record.time[0], record.drive]
    columns += [record.channels[name] for name in channels]
    table = zip(*(column.tolist() for column in columns), strict=True)
    return "".join(f"{','.join(map(repr, row))}\n" for row in table)
