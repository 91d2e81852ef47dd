"""Numbers of a model: an immutable map from full parameter names to SI values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeVar, final, overload

import numpy as np
from numpy.typing import NDArray

from piezo_opt.effects.model import Model
from piezo_opt.errors import ModelError

T = TypeVar("T")


@final
@dataclass(frozen=True)
class Values(Mapping[str, float]):
    """Immutable map ``"bouc_wen.alpha" -> number`` in SI units.

    Besides parameters it may hold per-record values, ``"offset.y0[1]"``, and initial deviations
    of states from rest, ``"initial.bouc_wen.h"`` or ``"initial.bouc_wen.h[1]"`` for record 1.

    >>> values = Values({"piezo_gain.d": 1e-7})
    >>> values.with_({"piezo_gain.d": 2e-7})["piezo_gain.d"]
    2e-07
    """

    numbers: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.numbers, Mapping):
            raise ModelError(f"Values are {self.numbers!r}; give numbers by name, {{...}}.")
        for name, number in self.numbers.items():
            if isinstance(number, str) or not hasattr(number, "__float__"):
                raise ModelError(f"Value of '{name}' is {number!r}; give a number in SI units.")
        clean = {name: float(number) for name, number in self.numbers.items()}
        for name, number in clean.items():
            if not math.isfinite(number):
                raise ModelError(f"Value of '{name}' is {number}; give a finite number.")
        object.__setattr__(self, "numbers", clean)

    @staticmethod
    def nominal(model: Model) -> Values:
        """The declared nominal value of every parameter of the model."""
        return Values({name: p.nominal for name, p in model.parameters.items()})

    def __getitem__(self, name: str) -> float:
        return self.numbers[name]

    @overload
    def get(self, name: str, default: None = None, /) -> float | None: ...

    @overload
    def get(self, name: str, default: float | T, /) -> float | T: ...

    def get(self, name: str, default: float | T | None = None, /) -> float | T | None:
        """The number of that name, or the default; without the detour over an exception."""
        return self.numbers.get(name, default)

    def __iter__(self) -> Iterator[str]:
        return iter(self.numbers)

    def __len__(self) -> int:
        return len(self.numbers)

    def __hash__(self) -> int:
        return hash(tuple(sorted(self.numbers.items())))

    def with_(self, changes: Mapping[str, float]) -> Values:
        """The same with some numbers replaced or added."""
        return Values({**self.numbers, **changes})

    def vector(self, names: tuple[str, ...]) -> NDArray[np.float64]:
        """The named numbers as an array, in the order asked for."""
        return np.array([self.numbers[name] for name in names], dtype=float)

    def of_record(self, index: int) -> Values:
        """What holds for one record: its own ``name[index]`` entries take the plain names.

        The bracketed names stay beside them: in ``"initial.creep.z[0]"`` of a lone record the
        bracket counts elements of a state, not records.
        """
        tail = f"[{index}]"
        own = {k.removesuffix(tail): v for k, v in self.numbers.items() if k.endswith(tail)}
        return Values({**self.numbers, **own})
