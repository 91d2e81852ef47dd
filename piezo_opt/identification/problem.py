"""The question: which model, which records, what is known beforehand."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import final

import numpy as np

from piezo_opt.choosing import chosen, expected, is_number, words
from piezo_opt.effects.model import Model
from piezo_opt.errors import InputError, ModelError
from piezo_opt.measurement import Campaign, Measurement
from piezo_opt.units import quantity
from piezo_opt.values import Values


class Start(Enum):
    """What is known of the states where a record begins."""

    FREE = "free"
    """Not known: the states that keep a memory are estimated."""
    REST = "rest"
    """A virgin actuator at rest under the first drive."""
    PERIODIC = "periodic"
    """The periodic steady state of a record with a period."""


@final
@dataclass(frozen=True)
class Prior:
    """What is known of a parameter beforehand: a normal distribution, in SI units."""

    mean: float
    std: float

    def __post_init__(self) -> None:
        if not (is_number(self.mean) and is_number(self.std) and self.std > 0):
            raise InputError(
                f"Prior({self.mean}, {self.std}): the mean must be finite and the standard "
                "deviation a positive number in the parameter's SI unit."
            )


class Shape(Enum):
    """How the cost of one residual grows, beyond a residual of one scale."""

    SQUARE = "square"
    SOFT_L1 = "soft_l1"
    HUBER = "huber"
    CAUCHY = "cauchy"


@final
@dataclass(frozen=True)
class Loss:
    """Robust loss rho of the residual r: cost = scale^2 / 2 sum rho((r / scale)^2).

    Args:
        shape: ``SQUARE`` is least squares; the others grow more slowly, so outliers weigh less.
        scale: residual [m] at which an outlier begins, about three times the noise. ``SQUARE`` does
            not use it, the others need it.

    Raises:
        InputError: there is no such shape, or a robust one has no scale.

    Source: Triggs et al. (2000), Bundle Adjustment - A Modern Synthesis, sec. 3.3.
    """

    shape: Shape = Shape.SQUARE
    scale: float = math.nan

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", chosen(Shape, self.shape, "loss"))
        if isinstance(self.scale, float) and math.isnan(self.scale):
            if self.shape is not Shape.SQUARE:
                raise InputError(
                    f"The loss {self.shape.value} has no scale, which is the residual in metres at "
                    "which an outlier begins: give about three times the noise, "
                    f"Loss(Shape.{self.shape.name}, scale=3e-8)."
                )
            object.__setattr__(self, "scale", 1.0)
        elif isinstance(self.scale, bool) or not is_number(self.scale) or not self.scale > 0:
            raise InputError(f"Loss scale is {self.scale!r}; give a positive length in metres.")


@final
@dataclass(frozen=True, eq=False)
class Identification:
    """Which values make the model read what the records read?

    Args:
        model: a sum of effects.
        records: one measurement, several, or a campaign; they share every parameter except
            those of ``per_record``, those declared per record (offset), and initial states.
        values: start values by name, in SI units or as text ("0.1 um/V"); a start given here is
            respected, the others are found from the records.
        fixed: parameters kept at a value.
        free: parameters declared fixed (exponents) that shall be estimated.
        bounds: tighter or wider bounds than declared, by name.
        priors: normal priors by name; they weigh against ``noise``.
        per_record: shared parameters that shall take one value for each record.
        start: what is known of the states where a record begins; periodic for records with a
            period unless told otherwise, free else.
        loss: least squares or a robust loss.
        noise: standard deviation of the reading's noise [m]; needed for priors only.
        weights: one positive weight a record (default 1 each).

    Raises:
        ModelError: a name is not a parameter of the model; the remedy lists those there are.
        InputError: a number makes no sense.
    """

    model: Model
    records: Campaign | Measurement | Iterable[Measurement]
    values: Mapping[str, float | str] = field(default_factory=dict)
    fixed: Mapping[str, float | str] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    priors: Mapping[str, Prior] = field(default_factory=dict)
    per_record: tuple[str, ...] = ()
    start: Start | None = None
    loss: Loss = field(default_factory=Loss)
    noise: float | None = None
    weights: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.model, Model):
            raise ModelError(
                f"{self.model!r} is no model: give a sum of effects, PiezoGain() + BoucWen()."
            )
        campaign = Campaign.of(self.records)
        if self.start is not None:
            object.__setattr__(self, "start", chosen(Start, self.start, "start"))
        if not isinstance(self.loss, Loss):
            raise InputError(f"loss is {self.loss!r}: give Loss(Shape.HUBER, scale=3e-8), say.")
        for what in ("free", "per_record", "weights"):
            words(getattr(self, what), what)
        for what in ("values", "fixed", "bounds", "priors"):
            expected(Mapping, getattr(self, what), what, f"numbers by name, {what}={{...}}")
        for name, prior in self.priors.items():
            expected(Prior, prior, f"The prior of '{name}'", "Prior(mean, std)")
        object.__setattr__(self, "records", campaign)
        for what, names in (
            ("values", self.values), ("fixed", self.fixed), ("free", self.free),
            ("bounds", self.bounds), ("priors", self.priors), ("per_record", self.per_record),
        ):  # fmt: skip
            self.check_names(what, names)
        for mapping in ("values", "fixed"):
            given = {k: self._number(k, v) for k, v in getattr(self, mapping).items()}
            object.__setattr__(self, mapping, given)
        for name, pair in self.bounds.items():
            try:
                low, high = pair
                ordered = bool(low < high)
            except (TypeError, ValueError):
                raise InputError(f"bounds of '{name}': {pair!r}: give (low, high).") from None
            if not ordered:
                raise InputError(
                    f"bounds of '{name}': {low} is not below {high}; give (low, high)."
                )
        for mapping in ("values", "fixed"):
            for name, number in getattr(self, mapping).items():
                self.check_bounds(mapping, name, number)
        if self.priors and self.noise is None:
            raise InputError(
                "Priors weigh against the noise of the reading: give noise=... in metres "
                "(record.noise_from_periods() where there are periods)."
            )
        if isinstance(self.noise, str):
            object.__setattr__(self, "noise", quantity(self.noise, "m"))
        if self.noise is not None and not (is_number(self.noise) and self.noise > 0):
            raise InputError(f"noise is {self.noise}; give a positive length in metres.")
        positive = all(0.0 < w < np.inf for w in self.weights)
        if self.weights and (len(self.weights) != len(campaign.records) or not positive):
            raise InputError(
                f"weights {self.weights}: give one positive number for each of the "
                f"{len(campaign.records)} records."
            )
        if self.start is Start.PERIODIC:
            for record in campaign.records:
                if record.period is None:
                    raise InputError(
                        f"{record.name}: start=periodic needs a period; read the record with "
                        "period=... or leave start to be found."
                    )

    def _number(self, name: str, value: float | str) -> float:
        unit = _unit(self.model, name)
        number = quantity(value, unit) if isinstance(value, str) and unit else value
        if not is_number(number):
            raise InputError(f"The value of '{name}' is {number}; give a finite number.")
        return float(number)

    def _moved(self, name: str, number: float) -> float:
        """The number within the bounds that hold for its parameter; a start there would be moved.

        A stroke that falls as the drive rises has its bounds mirrored when it is fitted.
        """
        declared = self.model.parameters.get(plain(name))
        if declared is None:
            return number
        low, high = self.bounds.get(name, self.bounds.get(plain(name), declared.bounds))
        mirrored = number < 0.0 == low and declared.unit in ("m/V", "V/m")
        moved = min(max(abs(number) if mirrored else number, low), high)
        return -moved if mirrored else moved

    def check_names(self, what: str, names: Iterable[str]) -> None:
        """Refuse names that no parameter and no start of a state has.

        Raises:
            ModelError: there is one.
        """
        for name in names:
            if not isinstance(name, str) or _unit(self.model, name) is None:
                raise ModelError(
                    f"{what}: the model has no parameter '{name}'; it has "
                    f"{', '.join((*self.model.parameters, *_starts(self.model)))}."
                )

    def check_bounds(self, what: str, name: str, number: float) -> None:
        """Refuse a number beyond the bounds of its parameter; a fit would begin elsewhere.

        Raises:
            InputError: it is.
        """
        moved = self._moved(name, number)
        if abs(number - moved) > 1e-9 * max(abs(number), abs(moved)):
            unit = _unit(self.model, name)
            raise InputError(
                f"{what}: '{name}' is {number:g} {unit}, beyond its bound {moved:g} {unit}: "
                f"correct it, or widen the bounds with bounds={{'{name}': (low, high)}}."
            )

    def check_numbers(self) -> None:
        """Refuse names of records and elements that do not exist; a fit would pass them over.

        Raises:
            InputError: names one of them, and the numbers there are.
        """
        count = len(self.campaign)
        for what in ("values", "fixed", "free", "bounds", "priors", "per_record"):
            for name in getattr(self, what):
                if not _numbered(self.model, name, count):
                    raise InputError(
                        f"{what}: '{name}' has a number that does not exist; "
                        f"{_counted(self.model, name, count)}."
                    )

    def given(self) -> dict[str, float]:
        """Start values that the user gave, in SI units."""
        return {k: float(v) for k, v in self.values.items()}

    @property
    def campaign(self) -> Campaign:
        """The records."""
        assert isinstance(self.records, Campaign)
        return self.records

    def start_of(self, record: Measurement) -> Start:
        """What is taken as known of the states where this record begins."""
        if self.start is not None:
            return self.start
        return Start.FREE if record.period is None else Start.PERIODIC

    def with_model(self, model: Model) -> Identification:
        """The same question to another model; what it does not have is dropped."""

        def kept(name: str) -> bool:
            return _unit(model, name) is not None

        return replace(
            self,
            model=model,
            values={k: v for k, v in self.values.items() if kept(k)},
            fixed={k: v for k, v in self.fixed.items() if kept(k)},
            free=tuple(k for k in self.free if kept(k)),
            bounds={k: v for k, v in self.bounds.items() if kept(k)},
            priors={k: v for k, v in self.priors.items() if kept(k)},
            per_record=tuple(k for k in self.per_record if kept(k)),
        )

    def with_records(
        self, records: Campaign | Measurement | Iterable[Measurement]
    ) -> Identification:
        """The same question to other records; values of records that are no more are dropped."""
        campaign = Campaign.of(records)

        def kept(name: str) -> bool:
            return _numbered(self.model, name, len(campaign))

        return replace(
            self,
            records=campaign,
            weights=(),
            values={k: v for k, v in self.values.items() if kept(k)},
            fixed={k: v for k, v in self.fixed.items() if kept(k)},
            free=tuple(k for k in self.free if kept(k)),
            bounds={k: v for k, v in self.bounds.items() if kept(k)},
            priors={k: v for k, v in self.priors.items() if kept(k)},
        )

    def starting_at(self, values: Values | Mapping[str, float]) -> Identification:
        """The same question with these start values, moved into its bounds.

        Names that it lacks are left out.
        """
        count = len(self.campaign)
        usable = {
            k: self._moved(k, v)
            for k, v in values.items()
            if _unit(self.model, k) is not None and _numbered(self.model, k, count)
        }
        return replace(self, values={**self.values, **usable})


def plain(name: str) -> str:
    """Name of a parameter without its record's number: ``"offset.y0[1]" -> "offset.y0"``."""
    head, bracket, _ = name.partition("[")
    return head if bracket and not name.startswith("initial.") else name


def _numbers_of(name: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\[(\d+)\]", name))


def _elements(model: Model, name: str) -> int:
    """How many elements the state of an initial deviation has; 1 for a parameter."""
    if not name.startswith("initial."):
        return 1
    effect, _, state = name.removeprefix("initial.").partition("[")[0].rpartition(".")
    return model[effect].states[state]


def _numbered(model: Model, name: str, records: int) -> bool:
    """Whether the elements and records that a name's brackets number exist."""
    numbers = _numbers_of(name)
    elements = _elements(model, name)
    if elements > 1 and numbers:
        if numbers[0] >= elements:
            return False
        numbers = numbers[1:]
    return len(numbers) <= 1 and all(number < records for number in numbers)


def _counted(model: Model, name: str, records: int) -> str:
    """The numbers that there are, in words."""
    there = f"records are numbered from 0 to {records - 1}"
    if records == 1:
        there = "there is one record, number 0"
    elements = _elements(model, name)
    return there if elements == 1 else f"elements from 0 to {elements - 1}, and {there}"


def _starts(model: Model) -> list[str]:
    """Names of the states' initial deviations; elements not numbered."""
    return [f"initial.{effect}.{state}" for effect, declared in model for state in declared.states]


def _unit(model: Model, name: str) -> str | None:
    """SI unit of a parameter or an initial deviation; None where the model has no such name."""
    if name.startswith("initial."):
        effect, _, state = name.removeprefix("initial.").partition("[")[0].rpartition(".")
        if effect not in model or state not in model[effect].states:
            return None
        return model[effect].declared_states[state].unit
    declared = model.parameters.get(plain(name))
    return None if declared is None else declared.unit
