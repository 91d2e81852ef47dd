"""What an effect declares: its place in the chain, its parameters and its states."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import final

from piezo_opt.errors import ModelError


class Place(Enum):
    """Where in the chain an effect acts, in the order of the chain."""

    INPUT = "input line"
    LOOP = "loop balance"
    STRAIN = "strain balance"
    MOTION = "motion balance"
    OUTPUT = "output line"

    @property
    def is_line(self) -> bool:
        """Whether effects act one after another here (else their contributions add)."""
        return self in (Place.INPUT, Place.OUTPUT)

    @property
    def unit(self) -> str:
        """Unit of what an effect gives its place; V stands for the drive's unit."""
        return {"input line": "V", "loop balance": "m/s", "strain balance": "m",
                "motion balance": "m/s^2", "output line": "m"}[self.value]  # fmt: skip


@final
@dataclass(frozen=True)
class Parameter:
    """Declaration of one number of an effect, in SI units.

    Attributes:
        unit: SI unit in terms of m, s, V, K, rad; ``"1"`` for none, e.g. ``"m/V"``.
        meaning: what it is, in a few words.
        nominal: value used where the user gives none.
        bounds: physically possible range, (-inf, inf) where there is none.
        typical: range seen in practice: start values and search grids are drawn from it.
        null: on the gate of an optional effect: the value at which the effect vanishes.
        fixed: kept at its value unless the user frees it; folded into the compiled code unless an
            option gives it.
        detail: a fixed shape that one record in many can see (the roundness of a knee): a search
            for missing effects frees it where that pays, before it asks for another effect.
        per_record: a campaign estimates one value for every record.
        repeats: a length along the reading, after half of which what the effect does repeats: a
            search looks for it in the spectrum of what is left along the reading.
        when, unless: name of an option of the effect (or several: any of them) with which, or
            without which, there is this parameter: effects of several forms declare those of all.
        freed: name of an option of the effect with which it is not fixed, but a shape as any other.
        given: name of an option of the effect that holds the nominal value in this one's place
            (the mains of a country): forms that differ in nothing else share their compiled code.
    """

    unit: str
    meaning: str
    nominal: float
    bounds: tuple[float, float] = (-float("inf"), float("inf"))
    typical: tuple[float, float] | None = None
    null: float | None = None
    fixed: bool = False
    detail: bool = False
    per_record: bool = False
    repeats: bool = False
    when: str | tuple[str, ...] = ()
    unless: str | tuple[str, ...] = ()
    freed: str = ""
    given: str = ""

    def __post_init__(self) -> None:
        low, high = self.bounds
        if self.detail and not self.fixed:
            raise ModelError(
                f"Parameter '{self.meaning}' is a detail and not fixed: declare fixed=True, "
                "a detail is freed only where that pays."
            )
        if not low < high or not low <= self.nominal <= high:
            raise ModelError(
                f"Parameter '{self.meaning}': nominal {self.nominal} is outside its bounds "
                f"{self.bounds}; declare bounds as (low, high) around the nominal value."
            )
        if self.null is not None and not low <= self.null <= high:
            raise ModelError(
                f"Parameter '{self.meaning}': null {self.null} is outside its bounds {self.bounds}."
            )

    @property
    def scale(self) -> float:
        """A positive size of the parameter, by which solvers scale it."""
        if self.typical is not None:
            size = max(abs(self.typical[0]), abs(self.typical[1]))
        else:
            size = abs(self.nominal)
        return size if size > 0 else 1.0


@final
@dataclass(frozen=True)
class State:
    """Declaration of one state (or a column of ``size`` equal ones) of an effect.

    Attributes:
        unit: SI unit.
        meaning: what it is, in a few words.
        size: number of elements, or the name of the effect's option that holds it.
        loop: the hysteretic displacement itself, whose rate the LOOP balance adds to.
        position: the position of the mechanics; a chain without one is quasi-static.
        velocity: the velocity of the mechanics.
        remanent: a record may begin with this state away from rest (memory of what was before).
        relaxing: its rest is the whole displacement, and it may begin anywhere in that.
        trailing: it follows a signal at a short distance, at which a record that is cut out of a
            motion begins, unless mechanics behind it take that up; soon forgotten, and not counted
            where models are compared.
        when, unless: name of an option of the effect (or several) with which, or without which,
            there is this state.
    """

    unit: str
    meaning: str
    size: int | str = 1
    loop: bool = False
    position: bool = False
    velocity: bool = False
    remanent: bool = False
    relaxing: bool = False
    trailing: bool = False
    when: str | tuple[str, ...] = ()
    unless: str | tuple[str, ...] = ()
