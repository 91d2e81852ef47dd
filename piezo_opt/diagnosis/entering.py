"""How the readings answer to a correction that enters one place of the chain.

A correction w(t) is handed to its place by a small effect that reads it as a channel of the
record. Linearised along the fit (``simulation.transitions``), the answer to any w, and the
transpose of that, is one sparse triangular solve: linear in the number of samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import assemble
from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.trajectory import Trajectory, initial_of, numbers_of, trajectory
from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.effects.model import Model
from piezo_opt.errors import ModelError
from piezo_opt.identification import Fit
from piezo_opt.lazy import lazy
from piezo_opt.simulation import Initial, Simulator
from piezo_opt.simulation.transitions import Transitions

FloatArray = NDArray[np.float64]

_TOGETHER = 8


@final
class Entering:
    """The linear answer of a fitted chain to corrections, place by place.

    Args:
        fit: the chain.

    Attributes:
        places: places that this model has.
        trajectory: signals along the fit.
    """

    def __init__(self, fit: Fit) -> None:
        self.fit = fit
        self.point = BasePoint(fit)
        self.trajectory: Trajectory = trajectory(fit)
        self.places = tuple(place for place in Place if _has(fit.model, place))
        model = fit.model
        for place in self.places:
            model = model + _probe(place)
        names = model.names[len(fit.model) :]
        amplitudes = [(f"{n}.at_start", f"{n}.at_end") for n in names]
        self._linear: list[Transitions] = []
        for index, (record, numbers) in enumerate(zip(fit.records, numbers_of(fit), strict=True)):
            empty = np.zeros(len(record))
            channels = {name: empty for place in self.places for name in _channels(place)}
            values = {**numbers, **{name: 0.0 for pair in amplitudes for name in pair}}
            simulator = Simulator(
                model,
                record.with_(channels={**record.channels, **channels}),
                values,
                initial=initial_of(fit, record),
                runtime=fit.question.free,
                substeps=fit.accuracy[index].substeps,
            )
            self._linear.append(
                Transitions(simulator, values, amplitudes, [_channels(p) for p in self.places])
            )
        self._counted = [record.counted for record in fit.records]
        self._extra = self._periodic_starts()

    def _periodic_starts(self) -> FloatArray:
        """Directions (M, .) by which the start of a periodic record may follow a correction.

        The start of a periodic steady state moves with the correction; it is left free instead,
        which is a little more generous.
        """
        rows = int(sum(counted.sum() for counted in self._counted))
        columns, at = [np.zeros((rows, 0))], 0
        for record, counted, linear in zip(
            self.fit.records, self._counted, self._linear, strict=True
        ):
            own = int(counted.sum())
            if initial_of(self.fit, record) is Initial.PERIODIC:
                block = np.zeros((rows, linear.states))
                block[at : at + own] = linear.starts()[counted]
                columns.append(self.point.project(block))
            at += own
        moved = np.hstack(columns)
        if not moved.shape[1]:
            return moved
        u, s, _ = np.linalg.svd(moved, full_matrices=False)
        return np.asarray(u[:, s > 1e-9 * s.max(initial=0.0)])

    @lazy
    def residual(self) -> FloatArray:
        """Measured minus modelled (M,) [m], less what :meth:`project` removes."""
        return self.project(self.point.residual)

    def project(self, column: FloatArray) -> FloatArray:
        """What neither the fitted parameters nor a periodic start explain of columns (M, ...)."""
        left = self.point.project(column)
        if not self._extra.shape[1]:
            return left
        return np.asarray(left - self._extra @ (self._extra.T @ left))

    def answers(self, place: Place, corrections: FloatArray) -> FloatArray:
        """Changes of the counted readings (M, q) by corrections (N, q) in the place's unit."""
        index = self.places.index(place)
        answers = np.empty((self.point.samples, corrections.shape[1]))
        # A few columns at a time stay in the processor's cache.
        for first in range(0, corrections.shape[1], _TOGETHER):
            few = slice(first, first + _TOGETHER)
            parts = self.trajectory.split(corrections[:, few])
            answers[:, few] = np.concatenate(
                [
                    linear.forward(index, own)[counted]
                    for linear, own, counted in zip(self._linear, parts, self._counted, strict=True)
                ]
            )
        return answers

    def back(self, place: Place, rows: FloatArray) -> FloatArray:
        """The transpose of :meth:`answers` on one column (M,): (N,)."""
        index = self.places.index(place)
        parts, at = [], 0
        for linear, counted in zip(self._linear, self._counted, strict=True):
            spread = np.zeros(counted.size)
            spread[counted] = rows[at : at + int(counted.sum())]
            at += int(counted.sum())
            parts.append(linear.adjoint(index, spread))
        return np.concatenate(parts)


def _has(model: Model, place: Place) -> bool:
    if place is Place.MOTION:
        return not model.quasi_static
    if place is not Place.LOOP:
        return True
    if model.loop is None:
        return False
    try:
        assemble(model + _probe(place))
    except ModelError:
        return False  # a law that jumps along the drive has no rate to be corrected
    return True


def _channels(place: Place) -> tuple[str, str]:
    return f"falling into the {place.value}", f"rising into the {place.value}"


@cache
def _probe(place: Place) -> Effect:
    """The effect that hands two channels, the two halves of a hat, to one place."""

    def equations(_: Effect, chain: Chain, __: Any, p: Any) -> Equations:
        falling, rising = (chain.channels[name].value for name in _channels(place))
        before = chain.incoming.value if place.is_line else 0.0
        return Equations(gives=before + p.at_start * falling + p.at_end * rising)

    body: dict[str, Any] = {
        "__doc__": "A correction given as channels of the record.",
        "__module__": "made_at_run_time",  # it stands in no file and in no catalogue
        "place": place,
        "requires": tuple(f"channel:{name}" for name in _channels(place)),
        "equations": equations,
        "at_start": Parameter("1", "size of the falling half", nominal=0.0, null=0.0),
        "at_end": Parameter("1", "size of the rising half", nominal=0.0),
    }
    kind: Any = dataclass(frozen=True)(type("Correction", (Effect,), body))
    made: Effect = kind()
    return made
