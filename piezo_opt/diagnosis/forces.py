"""What no effect explains: the smallest correction that would, place by place, and of what.

For one place of the chain at a time, the correction w(t) that brings the residual r down to the
noise and is otherwise as small and as smooth as it can be:

    minimise  integral (w^2 + T^2 w'^2) dt    such that    |P (r - S w)|^2 = M sigma^2

S is the answer of the chain to a correction entering the place (``entering``), P removes what the
fitted parameters would explain as well (they are projected out, not held: a correction must not
be paid for what a refit does for nothing), and T is a few samples. Near the fit this is linear
least squares with as many unknowns as samples. LSQR, begun at w = 0 and stopped where the residual
has reached the noise, is then the whole method: its iterations grow the correction as little as
each gain asks for, and the discrepancy principle is the stopping rule, so that no penalty has to
be searched. Each iteration is two sparse solves, linear in N. The price is the first order: under
a correction so large that it bends the chain the picture is only rough.

Where. Any place can explain any residual at some price, and places near each other (strain and
motion, strain and output below the resonance) at nearly the same. Physics is a function of
signals: so a place is judged by how much a *function of one signal* entering there, or of one
signal times a rate, explains on stretches of the record that were left out. Choices that lie
within one standard error of the best are equal, and the simplest of them is taken: no function at
all before a function, one signal before two; among places that to which the signal belongs (a
function of position and velocity is a force, one of the drive a strain), then the one whose
correction is smallest beside what the drive does there.

Sources: Hooker (2009), Biometrics 65(3), 928-936 (forcing functions as diagnostics); Paige &
Saunders (1982), ACM Trans. Math. Software 8(1), 43-71 (LSQR); Hanke (1995), Conjugate Gradient
Type Methods for Ill-Posed Problems, ch. 3 (stopping by the discrepancy principle); Breiman,
Friedman, Olshen & Stone (1984), Classification and Regression Trees, sec. 3.4.3 (one standard
error).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import GONE
from piezo_opt.diagnosis.entering import Entering, Quantity
from piezo_opt.diagnosis.evidence import WORTH
from piezo_opt.diagnosis.judge import BLOCKS
from piezo_opt.diagnosis.noise import NoiseFloor, noise_floor
from piezo_opt.effects.base import Place
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.stopping import Pool
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

SMOOTH: Final = 4
"""T, in samples: a correction is straight between samples, which follows what varies like
exp(-t / T) to 1 / (8 T^2) = 0.8 %."""
ITERATIONS: Final = 200
"""Of LSQR, for a place that cannot explain the residual; one that can needs ten to fifty."""
RATES: Final = (Quantity.DRIVE_RATE, Quantity.VELOCITY)
"""Signals that may multiply a function of another."""
_HOME: Final = {
    Place.INPUT: (),
    Place.LOOP: (Quantity.DRIVE_RATE,),
    Place.STRAIN: (Quantity.DRIVE, Quantity.HYSTERESIS, Quantity.SINCE_REVERSAL),
    Place.MOTION: (Quantity.POSITION, Quantity.VELOCITY),
    Place.OUTPUT: (Quantity.TIME,),
}


@final
@dataclass(frozen=True)
class Dependence:
    """How far a function of one signal, entering one place, replaces the correction.

    Attributes:
        place: where it enters.
        quantity: the signal.
        times: a rate that multiplies the function (a damping that depends on the position is
            x' times a function of x), None for the function alone.
        share: of what the noise does not explain, the part explained on left-out stretches; a
            little below 0 where it explains none, above 1 where the floor is too high.
        error: standard error of the share.
    """

    place: Place
    quantity: Quantity
    times: Quantity | None
    share: float
    error: float

    def __str__(self) -> str:
        times = "" if self.times is None else f", times {self.times.value}"
        return f"{self.quantity.value}{times}"


@final
@dataclass(frozen=True, eq=False)
class Force:
    """The smallest correction entering one place.

    Attributes:
        place: where it enters.
        time: (N_i,) of each record [s].
        correction: w (N_i,) at the samples of each record, in the place's unit.
        signals: (N_i,) of each record by quantity, to draw w against.
        rms: root mean square of w, in the place's unit.
        relative: the same over the drive-shaped correction that moves the reading as much as it
            moves anyway: without unit, comparable between places.
        rms_after: root mean square of the residual [m] with it.
        share: of what the noise does not explain, the part that w explains, 0..1.
        against: how far a function of each signal would do instead, the one to be told first.
        likely: whether that one explains as much as the best of all places, to one standard
            error, and surely more than nothing.
    """

    place: Place
    time: tuple[FloatArray, ...]
    correction: tuple[FloatArray, ...]
    signals: dict[Quantity, tuple[FloatArray, ...]]
    rms: float
    relative: float
    rms_after: float
    share: float
    against: tuple[Dependence, ...]
    likely: bool

    @property
    def described(self) -> float:
        """Share of the function that is told, 0..1."""
        return float(np.clip(self.against[0].share, 0.0, 1.0)) if self.against else 0.0

    def __str__(self) -> str:
        told = f", a function of {self.against[0]} {100 * self.described:.0f} %"
        return (
            f"{self.place.name.lower()}: a correction of {show(self.rms, self.place.unit)} rms "
            f"({100 * self.relative:.2g} % of what the drive does there) explains "
            f"{100 * self.share:.0f} %{told * bool(self.against)}"
        )


def forces(
    fit: Fit,
    noise: NoiseFloor | None = None,
    *,
    places: Sequence[Place] | None = None,
    entering: Entering | None = None,
    threads: int = 1,
) -> tuple[Force, ...]:
    """The smallest correction entering each place of the chain, the likeliest place first.

    Args:
        fit: the fit whose residual is to be explained.
        noise: the floor; estimated from the fit where none is given.
        places: those that are asked; all that the model has unless given.
        entering: the fit's answers to corrections, where they are known.
        threads: places that are asked at a time.

    Raises:
        InputError: the model has no such place.
    """
    chain = Entering(fit) if entering is None else entering
    asked = chain.places if places is None else tuple(places)
    for place in asked:
        if place not in chain.places:
            raise InputError(
                f"The model has no {place.value} that a correction could enter; it has "
                f"{', '.join(p.value for p in chain.places)}."
            )
    floor = noise_floor(fit) if noise is None else noise
    r = chain.residual
    told: list[Dependence] = []
    with Pool(max_workers=threads) as pool:
        for rates in ((None,), RATES):
            # Where a function of one signal leaves nothing that could bear a name, none of two is
            # asked.
            left = (1.0 - max((d.share for d in told), default=0.0)) * beyond(r, floor)
            if left > WORTH**2 * r.size * floor.rms**2 * bool(told):
                for own in pool.map(lambda p, by=rates: _described(chain, p, floor, by), asked):
                    told += own
        smallest = list(pool.map(lambda p: _smallest(chain, p, floor), asked))
    best = max(told, key=lambda d: d.share, default=None)
    equal = sure = 0.0
    if best is not None:
        equal = best.share - best.error
        # By chance once in 20, for all functions of a place together, from the stretches' scatter.
        looks = len(told) / len(asked)
        sure = best.error * float(scipy.special.stdtrit(BLOCKS - 1, 1.0 - 0.05 / looks))
    found: list[Force] = []
    for place, (correction, rest) in zip(asked, smallest, strict=True):
        own = [d for d in told if d.place is place]
        own.sort(key=lambda d: (d.share < equal, d.times is not None, -d.share))
        rms = float(np.sqrt(np.mean(correction**2)))
        force = Force(
            place=place,
            time=tuple(record.time for record in fit.records),
            correction=tuple(chain.split(correction)),
            signals={q: tuple(chain.split(s)) for q, s in chain.signals.items()},
            rms=rms,
            relative=rms / _natural(chain, place),
            rms_after=float(np.sqrt(np.mean(rest**2))),
            share=float(np.clip(share_of(r, rest**2, floor)[0], 0.0, 1.0)),
            against=tuple(own),
            likely=best is not None and best.share > sure and own[0].share >= equal,
        )
        found.append(force)

    def key(force: Force) -> tuple[bool, bool, float]:
        signals = {d.times or d.quantity for d in force.against[:1] if force.likely}
        return not force.likely, signals.isdisjoint(_HOME[force.place]), force.relative

    return tuple(sorted(found, key=key))


def _smallest(chain: Entering, place: Place, noise: NoiseFloor) -> tuple[FloatArray, FloatArray]:
    """The correction (N,), and what it leaves of the residual (M,)."""
    r, fade = chain.residual, SMOOTH / (SMOOTH + 1.0)
    if beyond(r, noise) == 0.0:
        return np.zeros(sum(chain.lengths)), r

    def smoothed(u: FloatArray) -> FloatArray:
        # w + T w' = u, so that the size of u is integral (w^2 + T^2 w'^2) but for the ends.
        return np.asarray(scipy.signal.lfilter([1.0 - fade], [1.0, -fade], u))

    operator = scipy.sparse.linalg.LinearOperator(
        (r.size, sum(chain.lengths)), dtype=float,
        matvec=lambda u: chain.project(chain.answers(place, smoothed(u)[:, None])[:, 0]),
        rmatvec=lambda y: smoothed(chain.back(place, chain.project(y))[::-1])[::-1],
    )  # fmt: skip
    target, total = r.size * noise.rms**2, float(r @ r)
    u = scipy.sparse.linalg.lsqr(
        operator, r, atol=0.0, btol=np.sqrt(target / total), conlim=0.0, iter_lim=ITERATIONS
    )[0]
    moved = operator.matvec(u)
    # Of the last step no more than leads to the target.
    along, square = float(r @ moved), float(moved @ moved)
    part = (along - np.sqrt(max(0.0, along**2 - square * (total - target)))) / (square or 1.0)
    return part * smoothed(u), r - part * moved


def _described(
    chain: Entering, place: Place, noise: NoiseFloor, rates: Sequence[Quantity | None]
) -> list[Dependence]:
    """How much functions of each signal, times each rate, explain where they enter the place.

    A function is piecewise linear in its signal. It is judged where the noise is, in the reading:
    regressing the correction itself would count the noise that the inversion of the chain has
    blown up. Without a rate (None) it is the function alone.
    """
    r = chain.residual
    found: list[Dependence] = []
    for rate, (quantity, hats) in product(rates, chain.hats.items()):
        # x' f(x) in the rate of the loop is F(x) in the strain: there only v' multiplies.
        same = place is Place.LOOP and rate is Quantity.VELOCITY
        if same or (rate is not None and (rate not in chain.signals or quantity in RATES)):
            continue
        parts = hats if rate is None else hats * chain.signals[rate][:, None]
        columns, _ = answers(chain, place, parts)
        share, error = share_of(r, left_out(columns, r), noise)
        found.append(Dependence(place, quantity, rate, share, error))
    return found


def answers(
    chain: Entering, place: Place, corrections: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What the fitted parameters leave of answers to corrections (N, q), and their lengths (q,).

    They are of length one before, so that what is explained away stays small.
    """
    whole = chain.answers(place, corrections)
    lengths = np.maximum(np.linalg.norm(whole, axis=0), np.finfo(float).tiny)
    return chain.project(whole / lengths), lengths


def left_out(columns: FloatArray, r: FloatArray) -> FloatArray:
    """Squares (M,) of r where each stretch is predicted from the others by damped regression."""
    stretches = np.array_split(np.arange(r.size), BLOCKS)
    grams = [columns[s].T @ columns[s] for s in stretches]
    sides = [columns[s].T @ r[s] for s in stretches]
    gram, side = sum(grams) + GONE * np.eye(columns.shape[1]), sum(sides)
    left = r.copy()
    for s, own_gram, own_side in zip(stretches, grams, sides, strict=True):
        left[s] -= columns[s] @ np.linalg.solve(gram - own_gram, side - own_side)
    return np.asarray(left**2)


def beyond(r: FloatArray, noise: NoiseFloor) -> float:
    """Squares of r that the noise does not explain; 0 where white noise has as many once in 40."""
    total = float(r @ r) / noise.rms**2
    usual = float(scipy.special.chdtri(r.size, 0.025))
    return 0.0 if total <= usual else (total - r.size) * noise.rms**2


def share_of(r: FloatArray, left: FloatArray, noise: NoiseFloor) -> tuple[float, float]:
    """Part of what is not noise that is explained when these squares (M,) are left.

    And its standard error, from the scatter between stretches.
    """
    more = beyond(r, noise)
    if more == 0.0:
        return 0.0, 0.0
    sums = np.array([part.sum() for part in np.array_split(left, BLOCKS)])
    share = (float(r @ r) - float(sums.sum())) / more
    error = float(np.sqrt(BLOCKS) * sums.std(ddof=1)) / more
    return share, error


def _natural(chain: Entering, place: Place) -> float:
    """Root mean square of the drive-shaped correction that moves the reading as the drive does."""
    shape = chain.signals[Quantity.DRIVE_RATE if place is Place.LOOP else Quantity.DRIVE]
    shape = shape - shape.mean() * (place is not Place.LOOP)
    shape = shape / np.sqrt(np.mean(shape**2))
    moved = float(np.std(chain.answers(place, shape[:, None])[:, 0]))
    reading = np.concatenate([r.position[r.counted] for r in chain.fit.records])
    return float(np.std(reading)) / moved if moved > 0 else float("inf")
