"""Families of plants with hidden effects, and what the bench needs to know of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal, Protocol, TypeAlias, final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark import foreign, plants
from piezo_opt.benchmark.plants import Level
from piezo_opt.benchmark.plants.classes import INSIDE

FamilyName: TypeAlias = Literal["own", "foreign"]


class RecordFacts(Protocol):
    """What is true about a record; see ``plants.Facts`` and ``foreign.Facts``."""

    @property
    def kind(self) -> str: ...
    @property
    def static(self) -> bool: ...
    @property
    def ratio(self) -> float: ...
    @property
    def colour(self) -> float: ...
    @property
    def resolution(self) -> float: ...
    @property
    def distinct(self) -> tuple[float, ...]: ...


class PlantRecord(Protocol):
    """A record of a plant, and its truth; see ``plants.HiddenRecord``."""

    @property
    def time(self) -> NDArray[np.float64]: ...
    @property
    def drive(self) -> NDArray[np.float64]: ...
    @property
    def position(self) -> NDArray[np.float64]: ...
    @property
    def noise_rms(self) -> float: ...
    @property
    def temperature(self) -> NDArray[np.float64] | None: ...
    @property
    def held(self) -> bool: ...
    @property
    def meta(self) -> RecordFacts: ...


Pair: TypeAlias = tuple[PlantRecord, PlantRecord]


@final
@dataclass(frozen=True)
class Family:
    """Plants by one hand.

    Attributes:
        classes: what can be hidden.
        outside: those of them that no catalogue has.
        make: (classes, seed, samples, level) to a record to fit and another to judge on.
        pairs: of classes, for a seed, without end.
        halved: whether every other record is diagnosed alone, without the other to judge on.
    """

    classes: tuple[str, ...]
    outside: tuple[str, ...]
    make: Callable[[tuple[str, ...], int, int, Level], Pair]
    pairs: Callable[[int], Iterator[tuple[str, str]]]
    halved: bool


def _own(names: tuple[str, ...], seed: int, samples: int, level: Level) -> Pair:
    train, test = plants.make(names, seed, samples=samples, level=level)
    return train, test


def _foreign(names: tuple[str, ...], seed: int, samples: int, level: Level) -> Pair:
    return foreign.make(names, seed, samples=samples, level=level)


def _own_pairs(seed: int) -> Iterator[tuple[str, str]]:
    """Pairs of effects that one drive can show."""
    random = np.random.default_rng([seed, crc32(b"pairs")])
    names = tuple(INSIDE)
    while True:
        first, second = (names[int(k)] for k in random.choice(len(names), 2, replace=False))
        if set(INSIDE[first].kinds) & set(INSIDE[second].kinds):
            yield first, second


FAMILIES: Final[Mapping[FamilyName, Family]] = MappingProxyType(
    {
        "own": Family(plants.CLASSES, plants.OUTSIDE, _own, _own_pairs, halved=False),
        "foreign": Family(
            foreign.CLASSES, foreign.OUTSIDE, _foreign, foreign.draw_pairs, halved=True
        ),
    }
)
"""By name."""
