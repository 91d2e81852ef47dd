"""Spike-ins: a known effect added to a measured record, and whether a diagnosis names it.

A measured record has noise, drive and faults that no generator thought of; what is missing from its
model is not known, but what was added to it is. The record is diagnosed as it was measured and
again with the effect; asked is whether the effect is in a group that is named, and which other
names the addition brought along.

The effects are written here, on the reading alone and in other forms than the catalogue's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from scipy.optimize import brentq
from scipy.signal import lfilter

from piezo_opt.benchmark.table import table
from piezo_opt.diagnosis import Diagnosis, Stopped, diagnose
from piezo_opt.errors import InputError
from piezo_opt.measurement import FloatArray, Measurement
from piezo_opt.units import show

SCHEMA: Final = "piezo_opt/spiked/1"
_WAVELENGTH: Final = 632.8e-9
"""Of a helium-neon laser [m]."""
_MAINS: Final = 50.0
"""[Hz]"""

Spike = Callable[[Measurement, float], FloatArray]
"""The reading of a record with an effect of some intensity; 0 leaves it as it is."""


def _hum(record: Measurement, intensity: float) -> FloatArray:
    """Mains with a third harmonic where the sampling holds it; intensity: over the stroke."""
    wave = np.sin(2.0 * np.pi * _MAINS * record.time + 0.7)
    if 0.5 * record.rate > 3.0 * _MAINS:
        wave = wave + 0.2 * np.sin(6.0 * np.pi * _MAINS * record.time)
    return record.position + intensity * np.ptp(record.position) * wave


def _warming(record: Measurement, intensity: float) -> FloatArray:
    """Warm-up with a third of the record as its time constant; intensity: over the stroke."""
    share = (record.time - record.time[0]) / (record.time[-1] - record.time[0])
    warming = np.asarray(-np.expm1(-3.0 * share))
    return record.position + intensity * np.ptp(record.position) * warming


def _play(record: Measurement, intensity: float) -> FloatArray:
    """A pin in a slot; intensity: half of the lost motion over the stroke."""
    half = intensity * float(np.ptp(record.position))
    follower, told = float(record.position[0]), []
    for pin in record.position.tolist():
        follower = min(max(follower, pin - half), pin + half)
        told.append(follower)
    return np.array(told)


def _quadrature(record: Measurement, intensity: float) -> FloatArray:
    """An interferometer's signals with an offset (Heydemann 1981); intensity: over the signal."""
    phase = 4.0 * np.pi * record.position / _WAVELENGTH
    signal = np.exp(1j * phase) + intensity * np.exp(0.4j)
    error = np.angle(signal * np.exp(-1j * phase)) * _WAVELENGTH / (4.0 * np.pi)
    return np.asarray(record.position + error)


def _slow_electronics(record: Measurement, intensity: float) -> FloatArray:
    """Two equal poles behind the sensor; intensity: their time constant in samples."""
    kept = np.exp(-1.0 / max(intensity, 1e-3))
    reading = np.asarray(record.position)
    for _ in range(2):
        reading, _ = lfilter([1.0 - kept], [1.0, -kept], reading, zi=[kept * reading[0]])
    return np.asarray(reading)


SPIKES: Final[Mapping[str, tuple[str, Spike]]] = {
    "mains_pickup": ("mains_pickup", _hum),
    "drift": ("drift", _warming),
    "backlash": ("dead_zone", _play),
    "sensor_nonlinearity": ("sensor_nonlinearity", _quadrature),
    "sensor_lag": ("sensor_lag", _slow_electronics),
}
"""By name: the row of the catalogue, and how it is added."""


@final
@dataclass(frozen=True)
class Spiked:
    """One effect added to one record.

    Attributes:
        record: its name.
        effect: what was added.
        added: rms of what no gain, offset and shift in time imitates of it [m].
        over: the same over what the diagnosis of the measured record leaves.
        before, after: names without and with it.
        groups: of each name with it, what the record cannot tell it from.
        verdict: with it.
        left: rms that is left with it [m].
    """

    record: str
    effect: str
    added: float
    over: float
    before: tuple[str, ...]
    after: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    verdict: str
    left: float

    @property
    def found(self) -> bool:
        """Whether what was added is in a group that is named."""
        return any(SPIKES[self.effect][0] in group for group in self.groups)

    @property
    def surplus(self) -> tuple[str, ...]:
        """Names that the addition brought beside the one of its group."""
        row = SPIKES[self.effect][0]
        own = {n for group in self.groups if row in group for n in group}
        return tuple(name for name in self.after if name not in own and name not in self.before)


@final
@dataclass(frozen=True)
class SpikedTable:
    """All effects on all records."""

    rows: tuple[Spiked, ...]

    @property
    def found(self) -> tuple[int, int]:
        """Times that it was named, of how many."""
        return sum(row.found for row in self.rows), len(self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain data with a ``schema`` key, SI units."""
        held, of = self.found
        rows = [
            {
                "record": r.record, "effect": r.effect, "added": r.added, "over": r.over,
                "before": list(r.before), "after": list(r.after),
                "groups": [list(g) for g in r.groups], "verdict": r.verdict, "left": r.left,
                "found": r.found, "surplus": list(r.surplus),
            }
            for r in self.rows
        ]  # fmt: skip
        return {"schema": SCHEMA, "found": {"held": held, "of": of}, "rows": rows}

    def __str__(self) -> str:
        held, of = self.found
        cells = [
            (
                r.record, r.effect, show(r.added, "m"), f"{r.over:.1f}",
                "yes" if r.found else "no", ", ".join(r.surplus), r.verdict, show(r.left, "m"),
            )
            for r in self.rows
        ]  # fmt: skip
        head = ("record", "added", "rms", "x noise", "named", "also named", "verdict", "left")
        return f"{table(head, cells)}\n\nnamed {held} of {of}"


def spiked(
    records: Sequence[Measurement],
    effects: Sequence[str] | None = None,
    *,
    size: float = 5.0,
    threads: int = 2,
    max_time: float | None = None,
    progress: Callable[[str], None] | None = None,
) -> SpikedTable:
    """Add known effects to measured records, one at a time, and diagnose.

    Args:
        records: as they were measured.
        effects: of ``SPIKES``; all unless given.
        size: rms of what is added, beyond what gain, offset and a shift in time imitate, over what
            the diagnosis of the measured record leaves.
        threads: refits that run at a time.
        max_time: seconds for each diagnosis; its own default unless given.
        progress: told where it is.

    Returns:
        the table, or the table of what was done when interrupted (Ctrl-C).

    Raises:
        InputError: an effect that cannot be added, a size that is not positive, or a record on
            which an effect cannot become so large.
    """
    names = tuple(SPIKES) if effects is None else tuple(dict.fromkeys(effects))
    for name in names:
        if name not in SPIKES:
            raise InputError(f"'{name}' cannot be added: there are {', '.join(SPIKES)}.")
    if not size > 0.0:
        raise InputError(f"size={size}: give a positive number, such as 5")
    tell = progress or (lambda _: None)
    rows: list[Spiked] = []

    def asked(record: Measurement) -> Diagnosis:
        found = diagnose(record, threads=threads, advise=False, max_time=max_time)
        if found.stopped is Stopped.USER:
            raise KeyboardInterrupt
        return found

    try:
        for record in records:
            tell(f"{record.name}, as it was measured")
            plain = asked(record)
            wanted = size * plain.final.rms
            for name in names:
                reading = _sized(record, name, wanted)
                tell(f"{record.name} with {name}")
                found = asked(record.with_(position=reading))
                rows.append(
                    Spiked(
                        record.name, name, added=_beyond(record, reading),
                        over=_beyond(record, reading) / plain.final.rms,
                        before=tuple(step.name for step in plain.steps),
                        after=tuple(step.name for step in found.steps),
                        groups=tuple(step.group for step in found.steps),
                        verdict=found.verdict, left=found.final.rms,
                    )
                )  # fmt: skip
    except KeyboardInterrupt:
        if not rows:
            raise
    return SpikedTable(tuple(rows))


def _beyond(record: Measurement, reading: FloatArray) -> float:
    """Rms of what a reading has more, beyond gain, offset and a shift in time [m]."""
    y = np.asarray(record.position)
    like = np.column_stack([np.ones_like(y), y - y.mean(), np.gradient(y, record.time)])
    more = reading - y
    kept = np.isfinite(more)
    slopes, *_ = np.linalg.lstsq(like[kept], more[kept], rcond=None)
    return float(np.sqrt(np.mean((more[kept] - like[kept] @ slopes) ** 2)))


def _sized(record: Measurement, name: str, wanted: float) -> FloatArray:
    """The reading with so much of an effect.

    Raises:
        InputError: it cannot become so large.
    """
    _, add = SPIKES[name]

    def short(log_intensity: float) -> float:
        return _beyond(record, add(record, float(np.exp(log_intensity)))) / wanted - 1.0

    grid = np.log(np.geomspace(1e-5, 1e2, 29))
    misses = [short(one) for one in grid]
    ahead = next((k for k in range(1, grid.size) if misses[k - 1] < 0.0 <= misses[k]), None)
    if ahead is None:
        raise InputError(
            f"{record.name}: {name} cannot be made {show(wanted, 'm')} large on this record: give "
            "a smaller size, or leave it out"
        )
    return add(record, float(np.exp(brentq(short, grid[ahead - 1], grid[ahead], xtol=1e-6))))
