"""How much better than a triangle any drive could be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.measurement.arrays import IndexArray
from piezo_opt.signals.answer import Answer
from piezo_opt.signals.drive import FloatArray
from piezo_opt.signals.families import Corners, Tones
from piezo_opt.signals.information import Criterion
from piezo_opt.signals.planning import room_of, slow_triangle
from piezo_opt.signals.search import search
from piezo_opt.signals.timing import wandering

_SURE: Final = 1.02
"""Excess of the bound, squared, over what a mixture reaches at which nothing more is looked for."""
_ROUNDS: Final = 20
_STEPS: Final = 1500
"""Steps of the weights in a round."""
_HISTORIES: Final = 10
"""Sets of random drives that the first mixture is made of."""
_MANY: Final = 40
"""Corners of the histories with many."""
_WEIGHED: Final = 2e-3
"""Excess of the largest phi of the mixture's own readings at which its weights are good."""
_KEPT: Final = 1e-7
"""Weight of a reading below which it leaves the mixture."""


@final
@dataclass(frozen=True)
class Ceiling:
    """How much better than a triangle any drive could be.

    Attributes:
        at_most: no drive of the range and length has a larger `BestDrive.gain`, or `joint_gain`.
        mixture: what the best mixture of readings found would reach, if it cost no time to go from
            one to the next.
        histories: drives that were looked at.
    """

    at_most: float
    mixture: float
    histories: int

    def __str__(self) -> str:
        return (
            f"At most {self.at_most:.2f} times better than from a triangle of the same range and "
            f"length, whatever is played ({self.histories} histories looked at)."
        )


def ceiling(
    fit: Fit,
    parameters: Sequence[str] | None = None,
    *,
    low: float | None = None,
    high: float | None = None,
    duration: float | None = None,
    rate: float | None = None,
    criterion: Criterion = Criterion.DEVIATIONS,
    evaluations: int = 400,
    seed: int = 0,
) -> Ceiling:
    """An upper bound of how much better than a triangle a drive of a range and length can be.

    A reading has a row f of derivatives, which depends on the drive so far. A drive of N samples
    has the information M = sum f f'; a mixture, M = N sum_j w_j f_j f_j' with weights of sum one,
    may take its rows from any histories, so that the best mixture is at least as good as any drive.
    With C the p parameters' block of M^-1, both det(C)^(-1/p) and prod_i C_ii^(-1/p) are concave in
    M and of first degree, so that no mixture of rows F has more than this one's times

        max over F of phi(f),    phi(f) = `worth` of a row, one on average over the mixture

    Where the reading depends on the drive of that instant alone, F is a curve, and the bound is
    proven. Otherwise F is what histories reach that a search finds for the largest phi, from random
    ones on, until that exceeds one by no more than 2 %.

    Args:
        fit: the model and its values.
        parameters: full names; all that records share unless given.
        low, high, duration, rate: as of :func:`best_for`.
        criterion: DETERMINANT bounds `BestDrive.joint_gain`, DEVIATIONS bounds `BestDrive.gain`.
        evaluations: histories judged in each round.
        seed: of the histories.

    Raises:
        InputError: as of :func:`best_for`; or the triangle does not show all parameters.

    Source: Kiefer (1974), Ann. Stat. 2(5), 849-879 (equivalence); Silvey, Titterington & Torsney
    (1978), Commun. Stat. A 7(14), 1379-1389 (the weights' steps); Pukelsheim (2006), Optimal Design
    of Experiments, ch. 5-7.
    """
    room = room_of(fit, duration=duration, slew=np.inf, highest=0.0, low=low, high=high, rate=rate)
    answer = Answer(fit, room.rate)
    asked = answer.asked(parameters)
    wanted = np.array([answer.names.index(name) for name in asked])
    triangle = slow_triangle(room).values
    answer.settle(triangle)
    rows = _rows(answer, triangle)
    if rows is None or np.linalg.matrix_rank(rows) < rows.shape[1]:
        raise InputError("a triangle does not show all of these parameters: there is no ratio")
    reference = _Mixture(rows, np.full(len(rows), 1.0 / len(rows)), wanted, criterion)
    histories = [d.values for k in range(_HISTORIES) for d in wandering(room, seed + k)]
    seen = [one for one in (rows, *(_rows(answer, v) for v in histories)) if one is not None]
    pool = np.concatenate([one[_some(one)] for one in seen])
    weights = np.full(len(pool), 1.0 / len(pool))
    count, best, reached = len(seen), np.inf, 1.0
    for number in range(_ROUNDS):
        weights, mixture = _weighed(pool, weights, wanted, criterion)
        reached = float(np.exp(0.5 * (mixture.value - reference.value)))
        worst = _Worst(answer, mixture)
        search(
            (Corners(), Corners(_MANY), Tones()), room, worst.of, evaluations=evaluations,
            offered=wandering(room, seed + _HISTORIES + number), seed=seed + number,
        )  # fmt: skip
        count += worst.count
        largest = max(worst.value, float(mixture.phi(pool).max()))
        best = min(best, reached * float(np.sqrt(max(1.0, largest))))
        if largest < _SURE or not len(worst.rows):
            break
        kept = weights > _KEPT
        pool = np.concatenate([pool[kept], worst.rows])
        new = np.full(len(worst.rows), 0.1 / len(worst.rows))
        weights = np.concatenate([0.9 * weights[kept] / weights[kept].sum(), new])
    return Ceiling(best, reached, count)


@final
class _Mixture:
    """Information of weighed rows, and what a row adds to it."""

    def __init__(
        self, rows: FloatArray, weights: FloatArray, wanted: IndexArray, criterion: Criterion
    ) -> None:
        weighed = rows * np.sqrt(weights)[:, None]
        inverse = np.linalg.inv(np.linalg.qr(weighed, mode="r"))
        covariance = inverse @ inverse.T
        if criterion is Criterion.DEVIATIONS:
            deviation = np.sqrt(np.diag(covariance)[wanted])
            self.value = -2.0 * float(np.log(deviation).mean())
            self._through = covariance[:, wanted] / deviation
            self._share = np.zeros((rows.shape[1], 0))
        else:
            block = covariance[np.ix_(wanted, wanted)]
            self.value = -float(np.linalg.slogdet(block)[1]) / len(wanted)
            self._through = inverse
            others = np.setdiff1d(np.arange(rows.shape[1]), wanted)
            self._share = np.zeros((rows.shape[1], len(others)))
            if len(others):
                alone = np.linalg.qr(weighed[:, others], mode="r")
                self._share[others] = np.linalg.inv(alone)
        self._count = len(wanted)

    def phi(self, rows: FloatArray) -> FloatArray:
        """(n,) of each row."""
        own = ((rows @ self._through) ** 2).sum(axis=1)
        return np.asarray((own - ((rows @ self._share) ** 2).sum(axis=1)) / self._count)


@final
class _Worst:
    """The history with the largest phi of those that a search asks for."""

    def __init__(self, answer: Answer, mixture: _Mixture) -> None:
        self._answer, self._mixture = answer, mixture
        self.value, self.count, self.rows = 0.0, 0, np.zeros((0, len(answer.names)))

    def of(self, values: FloatArray) -> float | None:
        """The largest phi on a drive (N,); None where it cannot be simulated."""
        self.count += 1
        rows = _rows(self._answer, values)
        if rows is None:
            return None
        phi = self._mixture.phi(rows)
        if float(phi.max()) > self.value:
            self.value, self.rows = float(phi.max()), rows[[*_some(rows), int(phi.argmax())]]
        return float(phi.max())


def _rows(answer: Answer, values: FloatArray) -> FloatArray | None:
    """(N, k) scaled derivatives of the readings on a drive; None where it cannot be simulated."""
    told = answer.derivatives(values)
    return None if told is None else told[1]


def _some(rows: FloatArray) -> range:
    """A hundred places of a history, the last among them."""
    return range(len(rows) - 1, -1, -max(1, len(rows) // 100))


def _weighed(
    rows: FloatArray, weights: FloatArray, wanted: IndexArray, criterion: Criterion
) -> tuple[FloatArray, _Mixture]:
    """Better weights: each times the root of its phi, which never makes the mixture worse."""
    mixture = _Mixture(rows, weights, wanted, criterion)
    for _ in range(_STEPS):
        phi = np.maximum(mixture.phi(rows), 0.0)
        if float(phi.max()) < 1.0 + _WEIGHED:
            break
        weights = weights * np.sqrt(phi)
        weights = weights / weights.sum()
        mixture = _Mixture(rows, weights, wanted, criterion)
    return weights, mixture
