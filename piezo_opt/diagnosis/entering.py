"""A fitted chain opened: its signals, and how the readings answer to a correction in any place.

A correction w(t) is handed to its place by a small effect that reads it as a channel of the
record. Linearised along the fit (``simulation.transitions``), the answer to any w, and the
transpose of that, is one sparse triangular solve: linear in the number of samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Any, Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.assembly import assemble
from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.effects.model import Model
from piezo_opt.errors import ModelError
from piezo_opt.identification import Fit, Start
from piezo_opt.identification.unknowns import theta_of, unknowns
from piezo_opt.lazy import lazy
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Initial, Simulator
from piezo_opt.simulation.transitions import Transitions

FloatArray = NDArray[np.float64]

PIECES: Final = 16
"""Knots of a function of one signal: it follows up to eight waves over the signal's span."""


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
class Entering:
    """The linear answer of a fitted chain to corrections, place by place.

    Args:
        fit: the chain.

    Attributes:
        places: places that this model has.
        signals: along the fit by quantity (N,), SI units, one record after the other; one that
            does not move is left out.
        lengths: samples of each record.
    """

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        self.point = BasePoint(fit)
        self.places = tuple(p for p in Place if assembles(fit.model + _probe(p)))
        model = fit.model
        for place in self.places:
            model = model + _probe(place)
        amplitudes = [(f"{n}.at_start", f"{n}.at_end") for n in model.names[len(fit.model) :]]
        channels = [_channels(place) for place in self.places]
        unknown = unknowns(fit.question, fit.values)
        theta = theta_of(unknown, fit.values)
        self._linear: list[Transitions] = []
        signals: list[dict[Quantity, FloatArray]] = []
        for index, record in enumerate(fit.records):
            values = unknown.of_record(index, theta)
            values |= {name: 0.0 for pair in amplitudes for name in pair}
            empty = {name: np.zeros(len(record)) for pair in channels for name in pair}
            probed = record.with_(channels={**record.channels, **empty})
            simulator = Simulator(
                model, probed, values,
                initial=self._initial(record),
                runtime=fit.question.free,
                substeps=fit.accuracy[index].substeps,
            )  # fmt: skip
            self._linear.append(Transitions(simulator, values, amplitudes, channels))
            signals.append(_signals(simulator, probed, values))
        stacked = {q: np.concatenate([own[q] for own in signals]) for q in Quantity}
        self.signals: Mapping[Quantity, FloatArray] = {
            q: s for q, s in stacked.items() if np.isfinite(s).all() and np.ptp(s) > 0
        }
        self.lengths = tuple(len(record) for record in fit.records)
        self._counted = np.concatenate([record.counted for record in fit.records])
        self._starts = self._periodic_starts()

    def _initial(self, record: Measurement) -> Initial:
        periodic = self.fit.question.start_of(record) is Start.PERIODIC
        return Initial.PERIODIC if periodic else Initial.REST

    def _periodic_starts(self) -> FloatArray:
        """Orthonormal directions (M, .) by which periodic starts may follow a correction.

        The start of a periodic steady state moves with the correction; it is left free instead,
        which is a little more generous.
        """
        parts = [
            linear.starts()[:, : linear.states * (self._initial(record) is Initial.PERIODIC)]
            for record, linear in zip(self.fit.records, self._linear, strict=True)
        ]
        moved = scipy.linalg.block_diag(*parts)[self._counted]
        u, s, _ = np.linalg.svd(self.point.project(moved), full_matrices=False)
        return np.asarray(u[:, s > 1e-9 * s.max(initial=0.0)])

    def split(self, stacked: FloatArray) -> list[FloatArray]:
        """One array a record of an array (N, ...) over all samples."""
        return np.split(stacked, np.cumsum(self.lengths)[:-1])

    @lazy
    def residual(self) -> FloatArray:
        """Measured minus modelled (M,) [m], less what :meth:`project` removes."""
        return self.project(self.point.residual)

    @lazy
    def hats(self) -> Mapping[Quantity, FloatArray]:
        """Pieces (N, q) that a function of each signal is made of."""
        return {quantity: pieces(along) for quantity, along in self.signals.items()}

    def project(self, column: FloatArray) -> FloatArray:
        """What neither the fitted parameters nor a periodic start explain of columns (M, ...)."""
        left = self.point.project(column)
        return np.asarray(left - self._starts @ (self._starts.T @ left))

    def answers(self, place: Place, corrections: FloatArray) -> FloatArray:
        """Changes of the counted readings (M, q) by corrections (N, q) in the place's unit."""
        index = self.places.index(place)
        parts = zip(self._linear, self.split(corrections), strict=True)
        whole = np.concatenate([one.forward(index, own) for one, own in parts])
        return np.asarray(whole[self._counted])

    def back(self, place: Place, rows: FloatArray) -> FloatArray:
        """The transpose of :meth:`answers` on one column (M,): (N,)."""
        index = self.places.index(place)
        spread = np.zeros(self._counted.size)
        spread[self._counted] = rows
        parts = zip(self._linear, self.split(spread), strict=True)
        return np.concatenate([one.adjoint(index, own) for one, own in parts])


def assembles(model: Model) -> bool:
    """Whether a model has what its effects need, and no signal depends on itself.

    No law that jumps along the drive has a rate to be corrected, for one.
    """
    try:
        assemble(model)
    except ModelError:
        return False
    return True


def _signals(
    simulator: Simulator, record: Measurement, numbers: Mapping[str, float]
) -> dict[Quantity, FloatArray]:
    states = simulator.response(numbers).states
    system, t = simulator.system, record.time
    n = t.size
    p = np.array([numbers[name] for name in system.parameter_names], dtype=float)
    shift = 0.0 if system.delay is None else float(system.delay(p))
    u = np.interp(t - shift, t, record.drive)
    beside = np.array([record.channels[c] for c in system.channel_names]).reshape(-1, n)
    slopes = np.array([np.gradient(c, t) for c in beside]).reshape(-1, n)
    given = (t[None], states.T, u[None], np.gradient(u, t)[None], beside, slopes)
    v, dv, h, _, _, x, dx = np.array(system.signals.map(n)(*given, np.tile(p[:, None], (1, n))))
    since = np.log1p(_since_reversal(t, u) / record.step)
    return dict(zip(Quantity, (v, dv, h, x, dx, since, t - t[0]), strict=True))


def _since_reversal(t: FloatArray, drive: FloatArray) -> FloatArray:
    """Seconds since the drive last turned; a drive that holds has not turned."""
    way = np.sign(np.diff(drive, prepend=drive[0]))
    moving = np.flatnonzero(way)
    # The turn lies at the sample before the first one that moves the other way.
    turned = np.maximum(moving[1:][way[moving][1:] != way[moving][:-1]] - 1, 0)
    last = np.zeros(t.size, dtype=int)
    last[turned] = turned
    return np.asarray(t - t[np.maximum.accumulate(last)])


def pieces(along: FloatArray) -> FloatArray:
    """Hat functions (N, q) of a signal, their knots between evenly spaced and evenly filled."""
    even = np.linspace(along.min(), along.max(), PIECES)
    filled = np.quantile(along, np.linspace(0.0, 1.0, PIECES))
    knots = np.unique(0.5 * (even + filled))
    return np.column_stack([np.interp(along, knots, row) for row in np.eye(knots.size)])


def _channels(place: Place) -> tuple[str, str]:
    return f"falling into the {place.value}", f"rising into the {place.value}"


@cache
def _probe(place: Place) -> Effect:
    """The effect that hands two channels, the two halves of a hat, to one place."""

    def equations(_: Effect, chain: Chain, __: Any, p: Any) -> Equations:
        falling, rising = (chain.channels[name].value for name in _channels(place))
        before = chain.incoming.value if place.is_line else 0.0
        return Equations(gives=before + p.at_start * falling + p.at_end * rising)

    halves = {
        "at_start": Parameter("1", "size of the falling half", nominal=0.0, null=0.0),
        "at_end": Parameter("1", "size of the rising half", nominal=0.0),
    }
    return made_effect(
        "Correction", place, halves,
        __doc__="A correction given as channels of the record.",
        requires=tuple(f"channel:{name}" for name in _channels(place)), equations=equations,
    )  # fmt: skip


def made_effect(
    title: str, place: Place, parameters: Mapping[str, Parameter], **members: Any
) -> Effect:
    """An effect made at run time, with what its place requires; it stands in no catalogue."""
    own = {Place.LOOP: ("loop",), Place.MOTION: ("motion",)}.get(place, ())
    members["requires"] = (*own, *members.get("requires", ()))
    body = {"__module__": "made_at_run_time", "place": place, **parameters, **members}
    kind: Any = dataclass(frozen=True)(type(title, (Effect,), body))
    made: Effect = kind()
    return made
