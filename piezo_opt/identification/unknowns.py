"""The unknowns of a question: names, start, scale, bounds, and the way into each record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.effects.base import Parameter, Place
from piezo_opt.identification.problem import Identification, Prior, Start, plain
from piezo_opt.lazy import lazy
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import INITIAL
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class Unknown:
    """One number to be estimated.

    Attributes:
        name: full name, with ``[record]`` where each record has its own.
        local: its name within a record, as the simulator knows it.
        record: index of the one record it belongs to, None when shared.
        scale: positive size by which solvers divide it.
        low, high: bounds.
        prior: None or what is known beforehand.
        relative: whether it is a natural frequency or a force per mass, which change in proportion:
            a stiffer actuator needs its forces as many times larger.
    """

    name: str
    local: str
    record: int | None
    scale: float
    low: float
    high: float
    prior: Prior | None
    relative: bool = False


@final
@dataclass(frozen=True, eq=False)
class Unknowns:
    """All unknowns of a question, in a fixed order, and the values that are kept."""

    members: tuple[Unknown, ...]
    kept: Values
    records: int

    @lazy
    def names(self) -> tuple[str, ...]:
        """Full names in order."""
        return tuple(u.name for u in self.members)

    @lazy
    def scale(self) -> FloatArray:
        """Sizes in order."""
        return _kept([u.scale for u in self.members])

    @lazy
    def low(self) -> FloatArray:
        """Lower bounds in order."""
        return _kept([u.low for u in self.members])

    @lazy
    def high(self) -> FloatArray:
        """Upper bounds in order."""
        return _kept([u.high for u in self.members])

    @lazy
    def relative(self) -> NDArray[np.bool_]:
        """Which change in proportion."""
        relative = np.array([u.relative for u in self.members], dtype=bool)
        relative.flags.writeable = False
        return relative

    def values(self, theta: FloatArray) -> Values:
        """All values with these estimates."""
        return self.kept.with_(dict(zip(self.names, theta.tolist(), strict=True)))

    def of_record(self, index: int, theta: FloatArray) -> dict[str, float]:
        """What the simulator of one record needs."""
        numbers = dict(self._kept_of_records[index])
        for unknown, number in zip(self.members, theta.tolist(), strict=True):
            if unknown.record is None or unknown.record == index:
                numbers[unknown.local] = number
        return numbers

    @lazy
    def _kept_of_records(self) -> tuple[dict[str, float], ...]:
        """What is kept, as each record's simulator needs it: asked for at every simulation."""
        return tuple(dict(self.kept.of_record(index)) for index in range(self.records))

    def columns(self, index: int) -> list[int]:
        """Positions of the unknowns that one record depends on."""
        return [k for k, u in enumerate(self.members) if u.record in (None, index)]

    def clip(self, theta: FloatArray) -> FloatArray:
        """The nearest point within the bounds."""
        return np.minimum(np.maximum(theta, self.low), self.high)


def _kept(numbers: list[float]) -> FloatArray:
    """A vector that is told many times, and by nobody changed."""
    vector = np.array(numbers, dtype=float)
    vector.flags.writeable = False
    return vector


_IN_PROPORTION = ("rad/s", "1/s^2", "m/s^2")
"""Units of natural frequencies, and of stiffnesses and forces per mass."""
_FINEST = 2e-3
"""Share of the stroke below which a distance is as good as none, and costly to follow."""
_NARROWEST = 3e-4
"""Share of the drive's range within which a loop that saturates is but the sign of the rate, and
costly to follow."""


def limits(parameter: Parameter, records: tuple[Measurement, ...]) -> tuple[float, float]:
    """Declared bounds narrowed to what the records' sampling and length can tell apart.

    Time constants between a tenth of the sampling step and three times the duration (a longer
    one is an offset in disguise), natural frequencies between one cycle in four durations and
    nine tenths of the highest frequency that the sampling can hold, distances in which a contact
    gives way not below a five-hundredth of the stroke, loops that do not saturate within a
    three-thousandth of the drive's range. One-sided strokes per volt, and volts per stroke, are
    mirrored where the position falls as the drive rises.
    """
    low, high = parameter.bounds
    step = min(r.step for r in records)
    duration = max(r.duration for r in records)
    if parameter.unit == "s":
        if low > 0:
            low = max(low, 0.1 * step)
        high = min(high, 3.0 * duration if low > 0 else 0.25 * duration)
    elif parameter.unit == "rad/s":
        low = max(low, 2.0 * np.pi / (4.0 * duration))
        high = min(high, 0.9 * np.pi / step)
    elif parameter.unit == "m" and low > 0 and not parameter.fixed:
        low = max(low, _FINEST * _stroke(records))
    elif parameter.unit == "1/V" and not parameter.fixed:
        sharpest = 1.0 / (_NARROWEST * max(float(np.ptp(r.drive)) for r in records))
        low, high = max(low, -sharpest), min(high, sharpest)
    elif parameter.unit in ("m/V", "V/m") and low == 0.0 and records[0].falls:
        low, high = -high, -low
    if not low < high:
        return parameter.bounds
    return low, high


def _stroke(records: tuple[Measurement, ...]) -> float:
    return max(float(np.ptp(r.position[r.counted])) for r in records)


def unknowns(question: Identification, start: Values) -> Unknowns:
    """List the unknowns of a question.

    Args:
        question: the identification.
        start: a value for every parameter (per-record ones with or without their number).
    """
    model, records = question.model, question.campaign.records
    several = len(records) > 1
    members: list[Unknown] = []
    kept: dict[str, float] = {}
    for name, parameter in model.parameters.items():
        if name in question.fixed:
            kept[name] = float(question.fixed[name])
            continue
        if parameter.fixed and name not in question.free:
            kept[name] = float(question.values.get(name, parameter.nominal))
            continue
        own = several and (parameter.per_record or name in question.per_record)
        for index in range(len(records)) if own else (None,):
            full = name if index is None else f"{name}[{index}]"
            if full in question.fixed:
                kept[full] = float(question.fixed[full])
                continue
            low, high = question.bounds.get(
                full, question.bounds.get(name, limits(parameter, records))
            )
            given = abs(start.get(full, start.get(name, parameter.nominal)))
            size = max(given, 0.1 * parameter.scale) if given > 0 else parameter.scale
            prior = question.priors.get(full, question.priors.get(name))
            relative = parameter.unit in _IN_PROPORTION and low >= 0.0
            members.append(Unknown(full, name, index, size, low, high, prior, relative))
    for index, record in enumerate(records):
        if question.start_of(record) is not Start.FREE:
            continue
        for state, size, reach in _memories(question, record):
            local = f"{INITIAL}{state}"
            full = f"{local}[{index}]" if several else local
            if full in question.fixed:
                kept[full] = float(question.fixed[full])
                continue
            low, high = question.bounds.get(full, (-reach, reach))
            prior = question.priors.get(full)
            members.append(Unknown(full, local, index if several else None, size, low, high, prior))
    return Unknowns(tuple(members), Values(kept), len(records))


def _memories(question: Identification, record: Measurement) -> list[tuple[str, float, float]]:
    """States that may start away from rest, with a size and the farthest start."""
    stroke = float(np.ptp(record.position)) or 1.0
    swing = float(np.ptp(record.drive)) or 1.0
    found: list[tuple[str, float, float]] = []
    for name, effect in question.model:
        for state, count in effect.states.items():
            declared = effect.declared_states[state]
            # Mechanics that begin anywhere take up where a lag before them began; beside them one
            # that may begin anywhere, too, would always beat a delay, which begins at rest.
            alone = question.model.quasi_static or effect.place is Place.OUTPUT
            if not (declared.remanent or (declared.trailing and alone)):
                continue
            # Half a stroke (or swing) of remanence is more than any actuator keeps; without a bound
            # two slow states can cancel each other at any size. A state without unit is a share of
            # its largest (a contact about to slide).
            if declared.unit in ("m", "V"):
                whole = stroke if declared.unit == "m" else swing
                size, reach = 0.05 * whole, 0.5 * whole
                if declared.relaxing:
                    # From no drive at all: a bias is many strokes away.
                    reach += stroke * float(np.abs(record.drive).max()) / swing
            elif declared.unit == "1":
                size, reach = 0.3, 1.5
            else:
                size = stroke / max(record.step, 1e-12) * 1e-2
                reach = 100.0 * size
            found.extend(
                (f"{name}.{state}" if count == 1 else f"{name}.{state}[{i}]", size, reach)
                for i in range(count)
            )
    return found


def theta_of(unknown: Unknowns, start: Mapping[str, float]) -> FloatArray:
    """The unknowns' vector at given values (0 for initial deviations not named)."""
    numbers = []
    for member in unknown.members:
        if member.name in start:
            numbers.append(float(start[member.name]))
        else:
            numbers.append(float(start.get(plain(member.local), 0.0)))
    return unknown.clip(np.array(numbers, dtype=float))
