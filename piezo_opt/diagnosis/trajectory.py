"""The signals of the chain along a fitted record: what a correction may depend on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.identification import Fit, Start
from piezo_opt.identification.unknowns import theta_of, unknowns
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Initial, Simulator

FloatArray = NDArray[np.float64]


class Quantity(Enum):
    """A signal that a correction is drawn against, by its sign in formulas."""

    DRIVE = "v"
    DRIVE_RATE = "v'"
    HYSTERESIS = "h"
    POSITION = "x"
    VELOCITY = "x'"
    SINCE_REVERSAL = "log time since reversal"
    TIME = "t"

    @property
    def unit(self) -> str:
        """SI unit; V stands for the drive's unit."""
        return {"v": "V", "v'": "V/s", "h": "m", "x": "m", "x'": "m/s", "t": "s"}.get(
            self.value, "1"
        )


@final
@dataclass(frozen=True, eq=False)
class Trajectory:
    """Signals (N,) in SI units over all samples, the records one after another.

    Attributes:
        signals: by quantity; one that does not move is left out.
        lengths: samples of each record.
    """

    signals: Mapping[Quantity, FloatArray]
    lengths: tuple[int, ...]

    def split(self, stacked: FloatArray) -> list[FloatArray]:
        """One array a record of an array over all samples."""
        return np.split(stacked, np.cumsum(self.lengths)[:-1])


def numbers_of(fit: Fit) -> list[dict[str, float]]:
    """What the simulator of each record needs at a fit."""
    unknown = unknowns(fit.question, fit.values)
    theta = theta_of(unknown, fit.values)
    return [unknown.of_record(i, theta) for i in range(len(fit.records))]


def initial_of(fit: Fit, record: Measurement) -> Initial:
    """How a record of a fit begins."""
    periodic = fit.question.start_of(record) is Start.PERIODIC
    return Initial.PERIODIC if periodic else Initial.REST


def trajectory(fit: Fit) -> Trajectory:
    """Simulate a fit once and read the chain's signals at the samples."""
    parts: list[dict[Quantity, FloatArray]] = []
    for index, (record, numbers) in enumerate(zip(fit.records, numbers_of(fit), strict=True)):
        simulator = Simulator(
            fit.model,
            record,
            numbers,
            initial=initial_of(fit, record),
            runtime=fit.question.free,
            substeps=fit.accuracy[index].substeps,
        )
        parts.append(_signals(simulator, record, numbers))
    stacked = {q: np.concatenate([part[q] for part in parts]) for q in Quantity}
    moving = {q: s for q, s in stacked.items() if np.isfinite(s).all() and np.ptp(s) > 0}
    lengths = tuple(len(record) for record in fit.records)
    return Trajectory(moving, lengths)


def _signals(
    simulator: Simulator, record: Measurement, numbers: Mapping[str, float]
) -> dict[Quantity, FloatArray]:
    states = simulator.response(numbers).states
    system, t = simulator.system, record.time
    n = t.size
    shift = 0.0
    p = np.array([numbers[name] for name in system.parameter_names], dtype=float)
    if system.delay is not None:
        shift = float(system.delay(p))
    u = np.interp(t - shift, t, record.drive)
    beside = np.array([record.channels[c] for c in system.channel_names]).reshape(-1, n)
    slopes = np.array([np.gradient(c, t) for c in beside]).reshape(-1, n)
    given = (t[None], states.T, u[None], np.gradient(u, t)[None], beside, slopes)
    found = np.array(system.signals.map(n)(*given, np.tile(p[:, None], (1, n))))
    v, dv, h, _, _, x, dx = found
    return {
        Quantity.DRIVE: v,
        Quantity.DRIVE_RATE: dv,
        Quantity.HYSTERESIS: h,
        Quantity.POSITION: x,
        Quantity.VELOCITY: dx,
        Quantity.SINCE_REVERSAL: np.log1p(_since_reversal(t, u) / record.step),
        Quantity.TIME: t - t[0],
    }


def _since_reversal(t: FloatArray, drive: FloatArray) -> FloatArray:
    """Seconds since the drive last turned; a drive that holds has not turned."""
    way = np.sign(np.diff(drive, prepend=drive[0]))
    moving = np.flatnonzero(way)
    turned = moving[1:][way[moving][1:] != way[moving][:-1]]
    # The turn lies at the sample before the first one that moves the other way.
    last = np.zeros(t.size, dtype=int)
    last[np.maximum(turned - 1, 0)] = np.maximum(turned - 1, 0)
    return np.asarray(t - t[np.maximum.accumulate(last)])
