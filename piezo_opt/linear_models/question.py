"""What is asked of a black-box linear model: its order, and what is free beside it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import final

import numpy as np

from piezo_opt.choosing import whole
from piezo_opt.errors import InputError
from piezo_opt.identification import Start
from piezo_opt.measurement import Campaign, Measurement


class Detrend(Enum):
    """What of the reading is not the linear system's."""

    NOTHING = "nothing"
    """Reading and drive are counted from a common zero."""
    OFFSET = "offset"
    """A constant of each record, estimated with the rest: working points do not matter."""
    LINE = "line"
    """A constant and a drift of each record."""

    @property
    def columns(self) -> int:
        """Numbers estimated for each record."""
        return {Detrend.NOTHING: 0, Detrend.OFFSET: 1, Detrend.LINE: 2}[self]


@final
@dataclass(frozen=True, eq=False)
class LinearQuestion:
    """Transfer function with ``poles`` poles and ``zeros`` zeros, by output error.

        y(t) = G(s) u + response to the initial state + offset + e,
        G(s) = (b_m s^m + ... + b_0) / (s^n + a_(n-1) s^(n-1) + ... + a_0),
        minimise the sum of e^2 over the counted samples

    Args:
        records: a record or several of one actuator; each has a start and an offset of its own.
        poles: n, at least 1.
        zeros: m, 0 to n.
        stable: whether every pole stays in the left half plane.
        start: FREE estimates the initial state, REST begins in equilibrium with the first drive.
        detrend: what of the reading is not the system's.

    Raises:
        InputError: numbers that make no transfer function, more unknowns than samples, or a start
            that a black box does not have.
    """

    records: Campaign
    poles: int
    zeros: int
    stable: bool = True
    start: Start = Start.FREE
    detrend: Detrend = Detrend.OFFSET

    def __init__(
        self,
        records: Measurement | Iterable[Measurement] | Campaign,
        poles: int,
        zeros: int | None = None,
        *,
        stable: bool = True,
        start: Start = Start.FREE,
        detrend: Detrend = Detrend.OFFSET,
    ) -> None:
        several = Campaign.of(records)
        whole(poles, "poles", 0)
        if zeros is not None:
            whole(zeros, "zeros", 0)
        m = max(poles - 1, 0) if zeros is None else zeros
        if poles < 1:
            raise InputError(f"a transfer function needs at least one pole, not {poles}")
        if not 0 <= m <= poles:
            raise InputError(
                f"{m} zeros with {poles} poles: give 0 to {poles}; with more zeros than poles the "
                "reading would follow the rate of the drive"
            )
        if start is Start.PERIODIC:
            raise InputError(
                "a black-box model begins FREE or at REST: FREE finds a periodic state by itself"
            )
        for name, value in (
            ("records", several), ("poles", poles), ("zeros", m), ("stable", stable),
            ("start", start), ("detrend", detrend),
        ):  # fmt: skip
            object.__setattr__(self, name, value)
        samples = sum(int(np.count_nonzero(one.counted)) for one in several.records)
        if self.unknowns >= samples:
            raise InputError(
                f"{poles} poles and {m} zeros are {self.unknowns} unknowns with starts and "
                f"offsets, and there are {samples} samples: ask for fewer"
            )

    @property
    def of_each_record(self) -> int:
        """Unknowns of each record: initial state and offset."""
        return (self.poles if self.start is Start.FREE else 0) + self.detrend.columns

    @property
    def unknowns(self) -> int:
        """Number d of all unknowns."""
        own = self.of_each_record * len(self.records.records)
        return self.poles + self.zeros + 1 + own

    def with_order(self, poles: int, zeros: int) -> LinearQuestion:
        """The same question of another order."""
        return LinearQuestion(
            self.records, poles, zeros, stable=self.stable, start=self.start, detrend=self.detrend
        )

    def on(self, records: Measurement | Iterable[Measurement] | Campaign) -> LinearQuestion:
        """The same question of other records."""
        return LinearQuestion(
            records, self.poles, self.zeros,
            stable=self.stable, start=self.start, detrend=self.detrend,
        )  # fmt: skip
