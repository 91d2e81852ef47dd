"""The drive that tells given models apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any, Final, TypeAlias, final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.identification import Fit, Start, solve
from piezo_opt.identification.problem import plain
from piezo_opt.identification.tall import triangle
from piezo_opt.signals.answer import Answer, draws
from piezo_opt.signals.drive import Drive, FloatArray
from piezo_opt.signals.families import FAMILIES, Family
from piezo_opt.signals.planning import excess, noise_of, room_of, slow_triangle, stroke_of
from piezo_opt.signals.search import FORBIDDEN, search

SURE: Final = 5.0
"""Sigmas from which two models are told apart: the wrong one then fits better once in 160 cases,
as the difference of their sums of squares is normal with mean d^2 and deviation 2 d."""

_STEPS: Final = 2
"""Gauss-Newton steps of a rival in the search: the first may lead far, the second sees how far."""
_RANK: Final = 1e-9
"""Share of the largest singular value below which a direction is left alone."""


@final
@dataclass(frozen=True, eq=False)
class DriveBetween:
    """A drive, and how far apart models are on it.

    Attributes:
        drive: what to play.
        models: a name for each.
        sigmas: distance of the two most alike, by whole fits.
        closest: those two, the one that is true first.
        of_triangle: the same of a triangle with the same range, duration and rate.
        noise: of the reading that was assumed [m].
        evaluations: drives that were judged.
    """

    drive: Drive
    models: tuple[str, ...]
    sigmas: float
    closest: tuple[str, str]
    of_triangle: float
    noise: float
    evaluations: int

    @property
    def sentence(self) -> str:
        """The same in words."""
        doubt = "" if self.sigmas >= SURE else " Play it longer, or with less noise, to be sure."
        return (
            f"Play {self.drive.description}: it separates {self.closest[0]} and {self.closest[1]}, "
            f"the two most alike, by {self.sigmas:.1f} sigmas; a triangle of the same range and "
            f"length by {self.of_triangle:.1f}.{doubt}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {
            "schema": "piezo_opt/drive-between/1",
            "drive": self.drive.description,
            "rate": self.drive.rate,
            "duration": self.drive.duration,
            "models": list(self.models),
            "sigmas": self.sigmas,
            "closest": list(self.closest),
            "of_triangle": self.of_triangle,
            "noise": self.noise,
            "evaluations": self.evaluations,
        }


def best_between(
    fits: Sequence[Fit] | Mapping[str, Fit],
    *,
    noise: float | None = None,
    low: float | None = None,
    high: float | None = None,
    duration: float | None = None,
    rate: float | None = None,
    slew: float = np.inf,
    highest: float = 0.0,
    stroke: tuple[float, float] | None = None,
    families: Sequence[Family] = FAMILIES,
    possible: int = 3,
    evaluations: int = 250,
    seed: int = 0,
) -> DriveBetween:
    """The drive on which models that fit the same records are farthest apart.

    Maximises the smallest distance over ordered pairs of models (one true, the other refitted) and
    over values that the true one's fit thinks possible:

        d^2 = min over theta_2 of |y_1 - y_2(theta_2)|^2 / sigma^2 + |W (theta_2 - fitted)|^2

    The rival's parameters may follow as far as its own fit lets them (W' W is the inverse of its
    covariance), its unknown start and per-record parameters as far as they like. During the search
    the minimum is that of Gauss-Newton steps with exact derivatives. The best of each family is
    then judged by a whole fit of each rival to the old records and the true model's new reading:

        d^2 = (misfit of that fit - misfit of its fit to the old records) / sigma^2

    Args:
        fits: two or more fits of different models to the same records; by name, or their own.
        noise: of the reading [m]; the smallest residual of the fits unless given.
        low, high: range of the drive [unit]; that of the first record unless given.
        duration, rate: [s], [Hz]; those of the first record unless given.
        slew: fastest change [unit/s].
        highest: fastest sine [Hz]; a fifth of the rate unless given.
        stroke: positions that the fits may predict [m]; as for :func:`best_for`.
        families: where to look.
        possible: values of each true model that are considered, the fit's own among them.
        evaluations: drives judged in each family.
        seed: of the search.

    Raises:
        InputError: fewer than two models, a number that makes no sense, or no drive on which they
            can be simulated.

    Sources: Atkinson & Fedorov (1975), Biometrika 62(1), 57-70 (T-optimality); Uciński & Bogacka
    (2005), J. R. Statist. Soc. B 67(1), 3-18 (dynamic models).
    """
    named = dict(fits) if isinstance(fits, Mapping) else _named(fits)
    if len(named) < 2:
        raise InputError("one model has nothing to be told apart from: give two fits")
    first = next(iter(named.values()))
    sigma = min(noise_of(f, noise) for f in named.values())
    room = room_of(
        first, duration=duration, slew=slew, highest=highest, low=low, high=high, rate=rate
    )
    rivals = {name: Rival(fit, room.rate, max(1, possible), seed) for name, fit in named.items()}
    plain_drive = slow_triangle(room).values
    for rival in rivals.values():
        rival.answer.settle(plain_drive)

    allowed = [stroke_of(rival.answer, plain_drive, stroke) for rival in rivals.values()]

    def merit(values: FloatArray) -> float | None:
        for rival, positions in zip(rivals.values(), allowed, strict=True):
            told = rival.answer.derivatives(values)
            if told is None:
                return None
            beyond = excess(told[0], positions)
            if beyond > 0.0:
                return FORBIDDEN * (1.0 + beyond)
        distance = apart(rivals, values, sigma)
        return None if distance is None else distance[0]

    found = search(families, room, merit, evaluations=evaluations, seed=seed)
    if not found:
        raise InputError("the fitted models cannot be simulated on any drive of this range")
    judged = [(one, confirmed(rivals, one.values, sigma)) for one in found]
    best, told = max(judged, key=lambda pair: pair[1][0])
    of_triangle = confirmed(rivals, plain_drive, sigma)
    return DriveBetween(
        drive=Drive(
            f"between_{best.family.name.replace(' ', '_')}",
            best.family.said(best.at, room), best.values, room.rate, room.unit,
        ),
        models=tuple(named),
        sigmas=told[0],
        closest=told[1],
        of_triangle=of_triangle[0],
        noise=sigma,
        evaluations=sum(f.evaluations for f in found),
    )  # fmt: skip


@final
class Rival:
    """One of the models: what it reads where it is true, and how far it may follow where not."""

    def __init__(self, fit: Fit, rate: float, possible: int, seed: int) -> None:
        self.answer = Answer(fit, rate)
        self.cases = draws(self.answer, possible, seed)
        self._tied = _tied(self.answer)

    def truths(self, values: FloatArray) -> list[FloatArray]:
        """Readings (N,) [m] of the cases that can be simulated."""
        told = (self.answer.derivatives(values, numbers) for numbers in self.cases)
        return [one[0] for one in told if one is not None]

    def distance(self, values: FloatArray, wanted: FloatArray, noise: float) -> float | None:
        """How far this model stays from a reading (N,) after Gauss-Newton steps, in sigmas.

        None where it cannot be simulated.
        """
        answer = self.answer
        moved = np.zeros(len(answer.names))
        start = np.array([answer.numbers.get(n, 0.0) for n in answer.names])
        rest = np.inf
        for _ in range(_STEPS):
            at = np.clip(start + answer.scale * moved, answer.low, answer.high)
            moved = (at - start) / answer.scale
            told = answer.derivatives(values, dict(zip(answer.names, at.tolist(), strict=True)))
            if told is None:
                # A step led too far: what is known from before it stands.
                return rest if np.isfinite(rest) else None
            gap = np.concatenate([(wanted - told[0]) / noise, -self._tied @ moved])
            root = triangle(np.column_stack([np.vstack([told[1] / noise, self._tied]), gap]))
            inner, right = root[:-1, :-1], root[:-1, -1]
            step, *_ = np.linalg.lstsq(inner, right, rcond=_RANK)
            left = float(np.hypot(np.linalg.norm(right - inner @ step), root[-1, -1]))
            rest, moved = left, moved + step
        return rest

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


Told: TypeAlias = tuple[float, tuple[str, str]]
"""The smallest distance, and between which two: the one that is true first."""


def apart(rivals: Mapping[str, Rival], values: FloatArray, noise: float) -> Told | None:
    """Smallest distance of a drive (N,) in sigmas by Gauss-Newton steps.

    None where one of the models cannot be simulated.
    """
    truths = {name: rival.truths(values) for name, rival in rivals.items()}
    if not all(truths.values()):
        return None
    least: Told | None = None
    for true, other in permutations(rivals, 2):
        for wanted in truths[true]:
            far = rivals[other].distance(values, wanted, noise)
            if far is None:
                return None
            if least is None or far < least[0]:
                least = far, (true, other)
    return least


def confirmed(rivals: Mapping[str, Rival], values: FloatArray, noise: float) -> Told:
    """The same by whole fits; the true model at its own fit."""
    told = []
    for true, other in permutations(rivals, 2):
        wanted = rivals[true].answer.sharp(values)
        told.append((rivals[other].refitted(values, wanted, noise), (true, other)))
    return min(told, key=lambda one: one[0])


def _tied(answer: Answer) -> FloatArray:
    """(m, k) root of the inverse covariance of the parameters that the fit knows, scaled.

    Unknowns at a bound are tied to it; the start of the new record is free.
    """
    fit, k = answer.fit, len(answer.names)
    local = [plain(n) for n in fit.names]
    known = [
        i for i, n in enumerate(local)
        if n in answer.parameters and fit.names[i] in (n, f"{n}[0]")
        and np.isfinite(fit.covariance[i, i])
    ]  # fmt: skip
    rows = np.zeros((0, k))
    if known:
        places = [answer.names.index(local[i]) for i in known]
        scale = answer.scale[places]
        block = fit.covariance[np.ix_(known, known)] / np.outer(scale, scale)
        variance, vectors = np.linalg.eigh(block)
        usable = variance > 1e-14 * variance.max()
        rows = np.zeros((int(usable.sum()), k))
        rows[:, places] = vectors[:, usable].T / np.sqrt(variance[usable])[:, None]
    loose = {local[i] for i in known}
    stuck = [p for p in answer.parameters if p not in loose and p in local]
    for name in stuck:
        row = np.zeros((1, k))
        row[0, answer.names.index(name)] = 1e6
        rows = np.vstack([rows, row])
    return rows


def _named(fits: Sequence[Fit]) -> dict[str, Fit]:
    """What each model has and not all others have, as a name."""
    everywhere = set.intersection(*(set(f.model.names) for f in fits)) if fits else set()
    found: dict[str, Fit] = {}
    for number, fit in enumerate(fits, start=1):
        own = [n for n in fit.model.names if n not in everywhere]
        name = " + ".join(own) or "nothing more"
        found[name if name not in found else f"{name} ({number})"] = fit
    return found
