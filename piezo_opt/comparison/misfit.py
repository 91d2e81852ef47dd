"""What a model leaves over on one record."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from piezo_opt.comparison.turns import IntArray, directions, turning_points
from piezo_opt.errors import InputError
from piezo_opt.measurement import FloatArray, Measurement


@final
@dataclass(frozen=True, eq=False)
class Misfit:
    """A record and a model's reading of it; errors are measured minus modelled.

    Args:
        record: what was measured.
        modelled: (N,) what the model reads [position_unit], on every sample.

    Raises:
        InputError: the lengths differ, or the model's reading is not finite.
    """

    record: Measurement
    modelled: FloatArray

    def __post_init__(self) -> None:
        if self.modelled.shape != self.record.position.shape:
            raise InputError(
                f"{self.record.name}: the model reads {self.modelled.shape} samples and the "
                f"record has {self.record.position.shape}: simulate on this very record"
            )
        if not np.isfinite(self.modelled).all():
            raise InputError(
                f"{self.record.name}: the model's reading is not finite: check its values"
            )

    @cached_property
    def time(self) -> FloatArray:
        """(M,) instants of the counted samples [s]."""
        return np.asarray(self.record.time[self.record.counted])

    @cached_property
    def drive(self) -> FloatArray:
        """(M,) drive at the counted samples [drive_unit]."""
        return np.asarray(self.record.drive[self.record.counted])

    @cached_property
    def measured(self) -> FloatArray:
        """(M,) reading at the counted samples [position_unit]."""
        return np.asarray(self.record.position[self.record.counted])

    @cached_property
    def error(self) -> FloatArray:
        """(M,) measured minus modelled at the counted samples [position_unit]."""
        return np.asarray((self.record.position - self.modelled)[self.record.counted])

    @cached_property
    def turns(self) -> IntArray:
        """Indices of the record where its drive turns, the first and the last sample included."""
        return turning_points(self.record.drive)

    @cached_property
    def branch(self) -> FloatArray:
        """(M,) +1 where the drive rises at a counted sample, -1 where it falls."""
        return directions(self.record.drive, self.turns)[self.record.counted]

    @cached_property
    def rms(self) -> float:
        """Root mean square of the error [position_unit]."""
        return float(np.sqrt(np.mean(self.error**2)))
