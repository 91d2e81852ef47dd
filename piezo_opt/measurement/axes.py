"""Records of stages with several drives and several positions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from piezo_opt.choosing import expected
from piezo_opt.errors import InputError
from piezo_opt.measurement.arrays import FloatArray
from piezo_opt.units import show

_FEWEST: Final = 16
"""Samples of a period: eight lines, fewer than any response is read from."""
SAME_LEVEL: Final = 0.05
"""Two draws of one random-phase drive have the same rms to rounding; steps between levels that tell
anything about amplitude are larger than this share."""


@final
@dataclass(frozen=True, eq=False)
class AxesRecord:
    """Several drives and positions over time, evenly sampled.

    Args:
        drives: (N, D) [drive_unit].
        positions: (N, A) [position_unit], A axes.
        rate: of sampling [Hz].
        period: samples after which drive and steady answer repeat; None for a record from rest.
        name: what messages call it.
        drive_unit, position_unit: SI.

    Raises:
        InputError: shapes that do not fit, numbers that are not finite, no whole period.
    """

    drives: FloatArray
    positions: FloatArray
    rate: float
    period: int | None = None
    name: str = "record"
    drive_unit: str = "V"
    position_unit: str = "m"

    def __post_init__(self) -> None:
        for what in ("drives", "positions"):
            object.__setattr__(self, what, _signals(getattr(self, what), what, self.name))
        if len(self.drives) != len(self.positions):
            raise InputError(
                f"{self.name}: {len(self.drives)} samples of the drives and {len(self.positions)} "
                "of the positions: give the same number"
            )
        if not (np.isfinite(self.rate) and self.rate > 0.0):
            raise InputError(f"{self.name}: a sampling rate of {self.rate:g} Hz is none")
        if self.period is not None and not _FEWEST <= self.period <= len(self):
            raise InputError(
                f"{self.name}: a period of {self.period} samples in a record of {len(self)}: give "
                f"{_FEWEST} to {len(self)}"
            )

    def __len__(self) -> int:
        return len(self.drives)

    @property
    def periods(self) -> int:
        """Whole periods; 1 for a record without one."""
        return 1 if self.period is None else len(self) // self.period

    @property
    def amplitude(self) -> FloatArray:
        """(D,) rms of each drive about its mean [drive_unit]."""
        return np.asarray(self.drives.std(axis=0))

    def folded(self) -> tuple[FloatArray, FloatArray]:
        """(P, samples, D) drives and (P, samples, A) positions, period by period.

        Raises:
            InputError: the record has no period.
        """
        if self.period is None:
            raise InputError(f"{self.name}: has no period: give it, period='1.28 s'")
        whole = self.periods * self.period
        shape = (self.periods, self.period, -1)
        return self.drives[:whole].reshape(shape), self.positions[:whole].reshape(shape)


@final
@dataclass(frozen=True, eq=False)
class AxesCampaign:
    """Realisations of one stage: the same drives, axes, rate and period.

    Raises:
        InputError: no record, or records that differ in these.
    """

    records: tuple[AxesRecord, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "records", tuple(self.records))
        if not self.records:
            raise InputError("a campaign needs at least one record")
        first = self.records[0]
        for one in self.records[1:]:
            for what, mine, other in (
                ("drives", one.drives.shape[1], first.drives.shape[1]),
                ("positions", one.positions.shape[1], first.positions.shape[1]),
                ("Hz", one.rate, first.rate),
                ("samples a period", one.period, first.period),
                ("as unit of the drive", one.drive_unit, first.drive_unit),
                ("as unit of the positions", one.position_unit, first.position_unit),
            ):
                if mine != other:
                    raise InputError(
                        f"{one.name} has {mine} {what} and {first.name} {other}: records of one "
                        "stage share them"
                    )

    @staticmethod
    def of(records: AxesRecord | Iterable[AxesRecord] | AxesCampaign) -> AxesCampaign:
        """A campaign from one record, several, or one already made."""
        if isinstance(records, AxesCampaign):
            return records
        if isinstance(records, AxesRecord):
            return AxesCampaign((records,))
        several = tuple(records) if isinstance(records, Iterable) else (records,)
        for one in several:
            expected(AxesRecord, one, "A record", "what read_axes returns")
        return AxesCampaign(several)

    def __len__(self) -> int:
        return len(self.records)

    def __iter__(self) -> Iterator[AxesRecord]:
        return iter(self.records)

    @property
    def levels(self) -> tuple[AxesCampaign, ...]:
        """Realisations of one amplitude together, from the weakest drive to the strongest."""
        size = [float(np.sqrt(np.mean(one.amplitude**2))) for one in self.records]
        found: list[list[int]] = []
        for k in sorted(range(len(self)), key=lambda k: (size[k], k)):
            if found and size[k] <= (1.0 + SAME_LEVEL) * size[found[-1][0]]:
                found[-1].append(k)
            else:
                found.append([k])
        return tuple(AxesCampaign(tuple(self.records[k] for k in sorted(one))) for one in found)

    @property
    def amplitude(self) -> FloatArray:
        """(D,) rms of each drive over all records [drive_unit]."""
        return np.asarray(np.sqrt(np.mean([one.amplitude**2 for one in self.records], axis=0)))

    def parted(self, held_out: int) -> tuple[AxesCampaign, AxesCampaign]:
        """All but the last ``held_out`` realisations of every level, and those.

        Raises:
            InputError: a level has too few.
        """
        train: list[AxesRecord] = []
        test: list[AxesRecord] = []
        for level in self.levels:
            if not 0 < held_out < len(level):
                raise InputError(
                    f"{held_out} of {len(level)} realisations at "
                    f"{show(float(level.amplitude.mean()), level.records[0].drive_unit)} rms "
                    "cannot be held out: hold out fewer; none, 0, gives no error on unseen records"
                )
            train += level.records[:-held_out]
            test += level.records[-held_out:]
        return AxesCampaign(tuple(train)), AxesCampaign(tuple(test))


def _signals(values: object, what: str, name: str) -> FloatArray:
    """(N, channels), read-only and finite."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: {what} are not an array of numbers") from error
    if array.ndim == 1:
        array = array[:, np.newaxis]
    if array.ndim != 2 or array.size == 0:
        raise InputError(f"{name}: {what} have shape {array.shape}, expected (samples, channels)")
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        raise InputError(
            f"{name}: {what}, channel {bad[0][1] + 1}, sample {bad[0][0] + 1} is "
            f"{array[tuple(bad[0])]}: remove that realisation"
        )
    array.flags.writeable = False
    return array
