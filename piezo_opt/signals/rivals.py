"""Models that may be true, and how far each stays from what another one reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from typing import Final, TypeAlias, final

import numpy as np

from piezo_opt.errors import PiezoOptError
from piezo_opt.identification import Fit, Start, solve
from piezo_opt.identification.problem import plain
from piezo_opt.identification.tall import triangle
from piezo_opt.signals.answer import Answer, draws
from piezo_opt.signals.drive import FloatArray
from piezo_opt.simulation.accuracy import DIVERGED

_STEPS: Final = 2
"""Gauss-Newton steps of a rival in the search: the first may lead far, the second sees how far."""
_RANK: Final = 1e-9
"""Share of the largest singular value below which a direction is left alone."""


@final
class Rival:
    """One of the models: what it reads where it is true, and how far it may follow where not.

    Args:
        fit: of the model.
        rate: samples a second of the drives to come [Hz].
        possible: values that are considered where it is true, the fit's own first.
        seed: of the others.
    """

    def __init__(self, fit: Fit, rate: float, possible: int = 1, seed: int = 0) -> None:
        self.answer = Answer(fit, rate)
        self.cases = draws(self.answer, possible, seed)
        self._tied = _tied(self.answer)

    def truths(self, values: FloatArray) -> list[FloatArray]:
        """Readings (N,) [m] of the cases that can be simulated."""
        told = []
        for numbers in self.cases:
            try:
                reading = self.answer.reading(values, numbers)
            except (PiezoOptError, ArithmeticError):
                continue
            if np.abs(reading).max() < DIVERGED:
                told.append(reading)
        return told

    def distances(
        self, values: FloatArray, wanted: Sequence[FloatArray], noise: float
    ) -> list[float] | None:
        """How far this model stays from readings (N,) after Gauss-Newton steps, in sigmas.

        The first step is made for all of them; further ones for the nearest, until the nearest has
        made all its steps. None where the model cannot be simulated.
        """
        found = self._step(values, np.zeros(len(self.answer.names)), wanted, noise)
        if found is None:
            return None
        far, moved = [left for left, _ in found], [at for _, at in found]
        made = [1] * len(far)
        while far and made[nearest := int(np.argmin(far))] < _STEPS:
            again = self._step(values, moved[nearest], [wanted[nearest]], noise)
            made[nearest] += 1
            if again is None:
                made[nearest] = _STEPS  # the step led too far: what is known from before it stands
            else:
                ((far[nearest], moved[nearest]),) = again
        return far

    def _step(
        self, values: FloatArray, moved: FloatArray, wanted: Sequence[FloatArray], noise: float
    ) -> list[tuple[float, FloatArray]] | None:
        """For each reading what a step leaves [sigmas], and where it leads (scaled, from the fit).

        All readings share one factor of the derivatives.
        """
        answer = self.answer
        start = np.array([answer.numbers.get(n, 0.0) for n in answer.names])
        at = np.clip(start + answer.scale * moved, answer.low, answer.high)
        moved = (at - start) / answer.scale
        told = answer.derivatives(values, dict(zip(answer.names, at.tolist(), strict=True)))
        if told is None:
            return None
        gaps = np.column_stack([(reading - told[0]) / noise for reading in wanted])
        ties = np.repeat((-self._tied @ moved)[:, None], len(wanted), axis=1)
        k = len(answer.names)
        root = triangle(np.block([[told[1] / noise, gaps], [self._tied, ties]]))
        inner, right = root[:k, :k], root[:k, k:]
        steps, *_ = np.linalg.lstsq(inner, right, rcond=_RANK)
        beyond = np.linalg.norm(root[k:, k:], axis=0)
        left = np.hypot(np.linalg.norm(right - inner @ steps, axis=0), beyond)
        return [(float(far), moved + step) for far, step in zip(left, steps.T, strict=True)]

    def refitted(self, values: FloatArray, wanted: FloatArray, noise: float) -> float:
        """The same by a whole fit to the old records and this reading together."""
        fit = self.answer.fit
        record = self.answer.record(values, wanted).rename("to come")
        question = fit.question
        weights = (*question.weights, 1.0) if question.weights else ()
        start = None if question.start is Start.PERIODIC else question.start
        both = replace(question, records=(*fit.records, record), weights=weights, start=start)
        again = solve(both, start=fit)
        before = float(np.sum(np.square(fit.residuals)))
        more = float(np.sum(np.square(again.residuals))) - before
        return float(np.sqrt(max(0.0, more))) / noise


Pair: TypeAlias = tuple[str, str]
"""The model that is true, and the one that is refitted."""


def apart(
    rivals: Mapping[str, Rival],
    values: FloatArray,
    noise: float,
    truths: Mapping[str, Sequence[FloatArray]],
) -> dict[Pair, float] | None:
    """Distance of each pair on a drive (N,) in sigmas by Gauss-Newton steps, over all truths.

    None where one of the models cannot be simulated.
    """
    found: dict[Pair, float] = {}
    for other, rival in rivals.items():
        named = [(true, wanted) for true in rivals if true != other for wanted in truths[true]]
        far = rival.distances(values, [wanted for _, wanted in named], noise)
        if far is None:
            return None
        for (true, _), distance in zip(named, far, strict=True):
            found[true, other] = min(distance, found.get((true, other), np.inf))
    return found


def confirmed(rivals: Mapping[str, Rival], values: FloatArray, noise: float) -> tuple[float, Pair]:
    """The least distance by whole fits, the true model at its own fit, and between which two.

    Pairs are refitted in the order of their distance by steps, as long as that is below what was
    found.
    """
    readings = {name: rival.answer.sharp(values) for name, rival in rivals.items()}
    steps = apart(rivals, values, noise, {n: [r] for n, r in readings.items()})
    likely = steps or dict.fromkeys(permutations(rivals, 2), 0.0)
    least: tuple[float, Pair] | None = None
    for pair in sorted(likely, key=lambda pair: likely[pair]):
        if least is not None and likely[pair] > least[0]:
            break
        far = rivals[pair[1]].refitted(values, readings[pair[0]], noise)
        least = min(least or (np.inf, pair), (far, pair))
    assert least is not None
    return least


def _tied(answer: Answer) -> FloatArray:
    """(m, k) root of the inverse covariance of the parameters that the fit knows, scaled.

    Unknowns at a bound are tied to it; the start of the new record is free.
    """
    fit, k = answer.fit, len(answer.names)
    local = [plain(n) for n in fit.names]
    seen = [
        i for i, n in enumerate(local)
        if n in answer.parameters and fit.names[i] in (n, f"{n}[0]")
        and np.isfinite(fit.covariance[i, i])
    ]  # fmt: skip
    rows = np.zeros((0, k))
    if seen:
        places = [answer.names.index(local[i]) for i in seen]
        scale = answer.scale[places]
        block = fit.covariance[np.ix_(seen, seen)] / np.outer(scale, scale)
        variance, vectors = np.linalg.eigh(block)
        usable = variance > 1e-14 * variance.max()
        rows = np.zeros((int(usable.sum()), k))
        rows[:, places] = vectors[:, usable].T / np.sqrt(variance[usable])[:, None]
    loose = {local[i] for i in seen}
    stuck = [p for p in answer.parameters if p not in loose and p in local]
    for name in stuck:
        row = np.zeros((1, k))
        row[0, answer.names.index(name)] = 1e6
        rows = np.vstack([rows, row])
    return rows
