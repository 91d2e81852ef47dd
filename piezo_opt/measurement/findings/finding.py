"""What a record shows about itself: one finding, in a sentence with samples and remedy."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, TypeAlias, final

import numpy as np

from piezo_opt.measurement.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from piezo_opt.measurement.record import Measurement

Mend: TypeAlias = "Callable[[Measurement], tuple[Measurement, ...]]"


class Weight(Enum):
    """What follows from a finding."""

    REFUSED = "refused"
    """A fit would be wrong: nothing is fitted until the finding is mended or accepted."""
    MENDED = "mended"
    """There is one remedy and it does no harm: it is applied, unless the finding is accepted."""
    REMARK = "remark"
    """Said, and nothing else."""


@final
@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that a record shows about itself.

    Attributes:
        name: one word, by which it is accepted or mended.
        weight: what follows.
        sentence: what was seen, and where.
        remedy: what to do, one sentence; empty where there is nothing to do.
        stretches: samples it is about, as (first, last + 1); empty for the whole record.
        mend: the record (or the several records) with the remedy applied, where there is one.
    """

    name: str
    weight: Weight
    sentence: str
    remedy: str = ""
    stretches: tuple[tuple[int, int], ...] = ()
    mend: Mend | None = None

    def __str__(self) -> str:
        return " ".join(part for part in (self.sentence, self.remedy) if part)

    def to_dict(self) -> dict[str, Any]:
        """The finding as plain data; samples count from 0."""
        return {
            "name": self.name,
            "weight": self.weight.value,
            "sentence": self.sentence,
            "remedy": self.remedy,
            "stretches": [list(one) for one in self.stretches],
            "mendable": self.mend is not None,
        }


def stretches_of(mask: BoolArray) -> tuple[tuple[int, int], ...]:
    """Runs of a mask (N,), as (first, last + 1)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return tuple((int(a), int(b)) for a, b in edges.reshape(-1, 2))


def mask_of(stretches: Iterable[tuple[int, int]], size: int) -> BoolArray:
    """The mask (N,) of these runs."""
    mask: BoolArray = np.zeros(size, dtype=np.bool_)
    for first, last in stretches:
        mask[first:last] = True
    return mask


def where(time: FloatArray, stretches: tuple[tuple[int, int], ...], most: int = 4) -> str:
    """Samples, counted from 1, and instants: ``samples 701 to 703 (0.7 s) and 1501 (1.5 s)``."""
    told = [
        (f"{a + 1}" if b == a + 1 else f"{a + 1} to {b}") + f" ({time[a]:.6g} s)"
        for a, b in stretches[:most]
    ]
    if len(stretches) > most:
        told.append(f"{len(stretches) - most} more places")
    single = len(stretches) == 1 and stretches[0][1] == stretches[0][0] + 1
    head = "sample" if single else "samples"
    listed = ", ".join(told[:-1]) + (" and " if len(told) > 1 else "") + told[-1]
    return f"{head} {listed}"


def answers(name: str, mend: str, accept: str = "takes it as it is") -> str:
    """The two answers to a refused finding, as a command and a call take them."""
    return f"--mend {name} {mend}; --accept {name} {accept}."
