"""The drive that tells given models apart."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np

from piezo_opt.choosing import whole
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.signals.drive import Drive, FloatArray
from piezo_opt.signals.families import FAMILIES, Family
from piezo_opt.signals.planning import (
    excess,
    noise_of,
    resonance_of,
    room_of,
    slow_triangle,
    stroke_of,
)
from piezo_opt.signals.rivals import Rival, apart, confirmed
from piezo_opt.signals.search import EARLY, FORBIDDEN, search
from piezo_opt.signals.usual import usual

SURE: Final = 5.0
"""Sigmas from which two models are told apart: the wrong one then fits better once in 160 cases,
as the difference of their sums of squares is normal with mean d^2 and deviation 2 d."""

_CONFIRMED: Final = 3
"""Best drives by steps that are judged by whole fits, as far as they promise more."""


@final
@dataclass(frozen=True, eq=False)
class DriveBetween:
    """A drive, and how far apart models are on it.

    Attributes:
        drive: what to play.
        models: a name for each.
        sigmas: distance of the two most alike, by whole fits.
        closest: those two, the one that is true first.
        of_triangle: that of a triangle with the same range, duration and rate, by Gauss-Newton
            steps.
        noise: of the reading that was assumed [m].
        evaluations: drives that were judged.
        interrupted: whether Ctrl-C or a limit of time ended the search.
    """

    drive: Drive
    models: tuple[str, ...]
    sigmas: float
    closest: tuple[str, str]
    of_triangle: float
    noise: float
    evaluations: int
    interrupted: bool = False

    @property
    def sentence(self) -> str:
        """The same in words."""
        doubt = "" if self.sigmas >= SURE else " Play it longer, or with less noise, to be sure."
        return (
            f"Play {self.drive.description}: it separates {self.closest[0]} and {self.closest[1]}, "
            f"the two most alike, by {self.sigmas:.1f} sigmas; a triangle of the same range and "
            f"length by {self.of_triangle:.1f}.{doubt}{EARLY if self.interrupted else ''}"
        )

    def __str__(self) -> str:
        return self.sentence

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
            "interrupted": self.interrupted,
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
    progress: Callable[[str], None] | None = None,
) -> DriveBetween:
    """The drive on which models that fit the same records are farthest apart.

    Maximises the smallest distance over ordered pairs of models (one true, the other refitted) and
    over values that the true one's fit thinks possible:

        d^2 = min over theta_2 of |y_1 - y_2(theta_2)|^2 / sigma^2 + |W (theta_2 - fitted)|^2

    The rival's parameters may follow as far as its own fit lets them (W' W is the inverse of its
    covariance), its unknown start and per-record parameters as far as they like. During the search
    the minimum is that of Gauss-Newton steps with exact derivatives. The best three drives are then
    judged by whole fits of the nearest rivals to the old records and the true model's new reading:

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
        evaluations: drives judged in each family; only the usual ones where that is zero.
        seed: of the search.
        progress: told how many drives were judged.

    Ctrl-C gives the best so far.

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
    whole(evaluations, "evaluations", 0)
    whole(possible, "possible", 1)
    whole(seed, "seed", 0)
    room = room_of(
        first, duration=duration, slew=slew, highest=highest, low=low, high=high, rate=rate
    )
    rivals = {name: Rival(fit, room.rate, max(1, possible), seed) for name, fit in named.items()}
    plain_drive, offered = slow_triangle(room).values, usual(room, resonance_of(first))
    for rival in rivals.values():
        rival.answer.settle(plain_drive, faster=[one.values for one in offered])

    allowed = {n: stroke_of(rival.answer, plain_drive, stroke) for n, rival in rivals.items()}

    def merit(values: FloatArray) -> float | None:
        truths = {name: rival.truths(values) for name, rival in rivals.items()}
        if not all(truths.values()):
            return None
        beyond = max(excess(told[0], allowed[name]) for name, told in truths.items())
        if beyond > 0.0:
            return FORBIDDEN * (1.0 + beyond)
        distances = apart(rivals, values, sigma, truths)
        return None if distances is None else min(distances.values())

    found = search(
        families, room, merit, offered=offered, evaluations=evaluations,
        seed=seed, progress=progress,
    )  # fmt: skip
    if not found.best:
        raise InputError("the fitted models cannot be simulated on any drive of this range")
    best = found.best[0].drive
    told = confirmed(rivals, best.values, sigma)
    for one in found.best[1:_CONFIRMED]:
        if one.merit > told[0] and not found.interrupted:
            again = confirmed(rivals, one.drive.values, sigma)
            best, told = max((best, told), (one.drive, again), key=lambda pair: pair[1][0])
    plain = apart(rivals, plain_drive, sigma, {n: r.truths(plain_drive) for n, r in rivals.items()})
    return DriveBetween(
        drive=best,
        models=tuple(named),
        sigmas=told[0],
        closest=told[1],
        of_triangle=min(plain.values()) if plain else 0.0,
        noise=sigma,
        evaluations=found.evaluations,
        interrupted=found.interrupted,
    )  # fmt: skip


def _named(fits: Sequence[Fit]) -> dict[str, Fit]:
    """What each model has and not all others have, as a name."""
    everywhere = set.intersection(*(set(f.model.names) for f in fits)) if fits else set()
    found: dict[str, Fit] = {}
    for number, fit in enumerate(fits, start=1):
        own = [n for n in fit.model.names if n not in everywhere]
        name = " + ".join(own) or "nothing more"
        found[name if name not in found else f"{name} ({number})"] = fit
    return found
