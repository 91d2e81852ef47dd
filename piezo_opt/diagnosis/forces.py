"""What no effect explains: the smallest correction that would, place by place, and of what.

For one place of the chain at a time, the correction w(t) that brings the residual r down to the
noise and is otherwise as small and as smooth as it can be:

    minimise  integral (w^2 + T^2 w'^2) dt    such that    |P (r - S w)|^2 = M sigma^2

S is the answer of the chain to a correction entering the place, P removes what the fitted
parameters would explain as well (they are projected out, not held: a correction must not be paid
for what a refit does for nothing), and T is a few samples.

How it is solved. As a nonlinear program this is multiple shooting with one control a sample. Near
the fit it is a linear least squares problem with as many unknowns as samples, and S is a sparse
triangular solve (``entering``). Conjugate gradients on the normal equations, begun at w = 0 and
stopped where the residual has reached the noise, is then the whole method: the iterations grow
the correction as little as each gain asks for, and the discrepancy principle is the stopping rule,
so that no penalty has to be searched. Each iteration is two solves, linear in N; periodic starts,
delays and held drives are treated as in the fit. The price is the first order: under a correction
so large that it bends the chain the picture is only rough.

Where. Any place can explain any residual at some price, and places near each other (strain and
motion, strain and output below the resonance) at nearly the same. So two numbers are reported:
the size of w over that of the drive-shaped correction which would move the reading as much as it
moves anyway, and how much of the residual a *function of one signal* entering there explains on
stretches that were left out. Physics is a function of signals: the second number decides. Where
it is equal, the place decides to which the signal belongs (a function of position and velocity is
a force, one of the drive a strain), then the size.

Sources: Hooker (2009), Biometrics 65(3), 928-936 (forcing functions as diagnostics); Kristensen,
Madsen & Jorgensen (2004), Automatica 40(2), 225-237; Hanke (1995), Conjugate Gradient Type
Methods for Ill-Posed Problems, ch. 3 (stopping by the discrepancy principle).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.diagnosis.entering import Entering
from piezo_opt.diagnosis.noise import NoiseFloor, noise_floor
from piezo_opt.diagnosis.trajectory import Quantity
from piezo_opt.effects.base import Place
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.stopping import Pool
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

SMOOTH: Final = 4
"""T, in samples: shorter than that a correction is not asked for."""
ITERATIONS: Final = 200
"""Of conjugate gradients; places that explain the residual need ten to fifty."""
PIECES: Final = 16
"""Knots of a function of one signal."""
FOLDS: Final = 8
"""Stretches of the record, each left out once."""
MARGIN: Final = 1.02
"""Residual over noise below which nothing is explained."""
LEVEL: Final = 0.03
"""Shares nearer than this are equal: the stretches left out are few."""
RATES: Final = (Quantity.DRIVE_RATE, Quantity.VELOCITY)
"""Signals that may multiply a function of another."""
ENOUGH: Final = 0.9
"""Share from which a function of one signal needs no second one."""
SEEN: Final = 0.2
"""Share from which a function of a signal is worth naming."""
_Hats: TypeAlias = Mapping[Quantity, FloatArray]
_Each: TypeAlias = Callable[[Callable[["Force"], "Force"], Iterable["Force"]], Iterable["Force"]]
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
    """How far a function of one signal replaces the correction.

    Attributes:
        quantity: the signal.
        times: a rate that multiplies the function (a damping that depends on the position is
            x' times a function of x), None for the function alone.
        share: of what the noise does not explain, the part explained on left-out stretches, 0..1.
    """

    quantity: Quantity
    times: Quantity | None
    share: float

    def __str__(self) -> str:
        if self.times is None:
            return self.quantity.value
        return f"{self.quantity.value}, times {self.times.value}"


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
        rms_before, rms_after: of the residual [m] without and with it.
        share: of what the noise does not explain, the part that w explains, 0..1.
        against: how far a function of each signal would do instead, best first.
        iterations: of conjugate gradients.
    """

    place: Place
    time: tuple[FloatArray, ...]
    correction: tuple[FloatArray, ...]
    signals: dict[Quantity, tuple[FloatArray, ...]]
    rms: float
    relative: float
    rms_before: float
    rms_after: float
    share: float
    against: tuple[Dependence, ...]
    iterations: int

    @property
    def described(self) -> float:
        """Share of the best function of one signal."""
        return self.against[0].share if self.against else 0.0

    def __str__(self) -> str:
        text = (
            f"{self.place.name.lower()}: a correction of {show(self.rms, self.place.unit)} rms "
            f"({100 * self.relative:.2g} % of what the drive does there) explains "
            f"{100 * self.share:.0f} %"
        )
        if not self.against:
            return text
        best = self.against[0]
        return f"{text}, a function of {best} {100 * best.share:.0f} %"


def correction_force(
    fit: Fit,
    place: Place,
    noise: NoiseFloor | None = None,
    *,
    entering: Entering | None = None,
) -> Force:
    """The smallest correction entering one place that brings the residual down to the noise.

    Args:
        fit: the fit whose residual is to be explained.
        place: where the correction enters.
        noise: the floor; estimated from the fit where none is given.
        entering: the fit's answers to corrections, where several places are asked.

    Raises:
        InputError: the model has no such place.
    """
    chain = Entering(fit) if entering is None else entering
    if place not in chain.places:
        raise InputError(
            f"The model has no {place.value} that a correction could enter; it has "
            f"{', '.join(p.value for p in chain.places)}."
        )
    floor = noise_floor(fit) if noise is None else noise
    hats = _hats(chain)
    return _with_products(chain, [_force(chain, place, floor, hats)], floor, hats)[0]


def forces(
    fit: Fit,
    noise: NoiseFloor | None = None,
    *,
    entering: Entering | None = None,
    threads: int = 1,
) -> tuple[Force, ...]:
    """The smallest correction for every place of the chain, the likeliest place first.

    Args:
        fit: the fit whose residual is to be explained.
        noise: the floor; estimated from the fit where none is given.
        entering: the fit's answers to corrections, where they are known.
        threads: places that are asked at a time.
    """
    chain = Entering(fit) if entering is None else entering
    floor = noise_floor(fit) if noise is None else noise
    hats = _hats(chain)
    with Pool(max_workers=threads) as pool:
        found = list(pool.map(lambda place: _force(chain, place, floor, hats), chain.places))
        return tuple(ranked(_with_products(chain, found, floor, hats, pool.map)))


def _hats(chain: Entering) -> _Hats:
    return {q: pieces(along) for q, along in chain.trajectory.signals.items()}


def _force(chain: Entering, place: Place, floor: NoiseFloor, hats: _Hats) -> Force:
    r = chain.residual
    quiet = float(r @ r) <= r.size * bar(floor) ** 2
    found = _smallest(chain, place, r, np.inf if quiet else r.size * floor.rms**2)
    rms = float(np.sqrt(np.mean(found.correction**2)))
    split = chain.trajectory.split
    return Force(
        place=place,
        time=tuple(record.time for record in chain.fit.records),
        correction=tuple(split(found.correction)),
        signals={q: tuple(split(s)) for q, s in chain.trajectory.signals.items()},
        rms=rms,
        relative=rms / _natural(chain, place),
        rms_before=float(np.sqrt(r @ r / r.size)),
        rms_after=float(np.sqrt(found.left / r.size)),
        share=share_of(chain, found.left, floor),
        against=() if quiet else _described(chain, place, floor, hats, (None,)),
        iterations=found.iterations,
    )


def _with_products(
    chain: Entering, found: list[Force], floor: NoiseFloor, hats: _Hats, each: _Each = map
) -> list[Force]:
    """Functions of a second signal are asked only where one signal is not enough."""
    most = max(f.described for f in found)
    if most >= ENOUGH or not any(f.against for f in found):
        return found

    def richer(force: Force) -> Force:
        products = _described(chain, force.place, floor, hats, RATES)
        return replace(force, against=_best_first((*force.against, *products)))

    return list(each(richer, found))


def _best_first(found: Iterable[Dependence]) -> tuple[Dependence, ...]:
    # A product must be worth its second signal.
    return tuple(sorted(found, key=lambda d: -(d.share - (LEVEL if d.times else 0.0))))


def ranked(found: Sequence[Force]) -> list[Force]:
    """Places in the order of likelihood: best described, then at home with the signal, then least.

    Places within ``LEVEL`` of the best are equally well described. Where no function of a signal
    explains anything worth naming, the size alone decides.
    """
    if max((f.described for f in found), default=0.0) < SEEN:
        return sorted(found, key=lambda f: f.relative)
    top = max((f.described for f in found), default=0.0)

    def key(force: Force) -> tuple[bool, bool, float, float]:
        level = force.described >= top - LEVEL
        best = force.against[0] if force.against else None
        at_home = best is not None and (best.times or best.quantity) in _HOME[force.place]
        return (
            not level, level and not at_home,
            0.0 if level else -force.described, force.relative,
        )  # fmt: skip

    return sorted(found, key=key)


def _described(
    chain: Entering,
    place: Place,
    noise: NoiseFloor,
    hats: _Hats,
    times: Sequence[Quantity | None],
) -> tuple[Dependence, ...]:
    """How much a function of each signal, entering a place, explains of the residual; best first.

    The function is piecewise linear in the signal, and it is judged where the noise is, in the
    reading: regressing the correction itself would count the noise that the inversion of the
    chain has blown up. Each of eight stretches is predicted from the other seven.

    Args:
        chain: the fit's answers to corrections.
        place: where the function enters.
        noise: the floor.
        hats: pieces of each signal.
        times: rates that may multiply the function; None is the function alone.
    """
    signals, r = chain.trajectory.signals, chain.residual
    found = []
    for rate in times:
        # x' f(x) in the rate of the loop is F(x) in the strain: there only v' multiplies.
        absent = rate is not None and rate not in signals
        if absent or (place is Place.LOOP and rate is Quantity.VELOCITY):
            continue
        for quantity, single in hats.items():
            if rate is not None and quantity in RATES:
                continue
            parts = single if rate is None else single * signals[rate][:, None]
            whole = chain.answers(place, parts)
            # Scaled as they are: what the fitted parameters explain away must stay small.
            whole = whole / np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
            left = left_out(chain.project(whole), r)
            found.append(Dependence(quantity, rate, share_of(chain, left, noise)))
    return _best_first(found)


def pieces(along: FloatArray) -> FloatArray:
    """Hat functions (N, q) of a signal, their knots between evenly spaced and evenly filled."""
    even = np.linspace(along.min(), along.max(), PIECES)
    filled = np.quantile(along, np.linspace(0.0, 1.0, PIECES))
    knots = np.unique(0.5 * (even + filled))
    return np.column_stack([np.interp(along, knots, row) for row in np.eye(knots.size)])


def share_of(chain: Entering, left: float, noise: NoiseFloor) -> float:
    """Part of what is not noise that is explained when this sum of squares is left."""
    r = chain.residual
    total = float(r @ r)
    beyond = total - r.size * noise.rms**2
    if total <= r.size * bar(noise) ** 2:
        return 0.0
    return float(np.clip((total - left) / beyond, 0.0, 1.0))


def bar(noise: NoiseFloor) -> float:
    """Residual [m] below which nothing is left to explain: the floor, less sure than it says."""
    return min(noise.high, MARGIN * noise.rms)


def left_out(columns: FloatArray, r: FloatArray, damping: float = 1e-6) -> float:
    """Sum of squares of r when each stretch is predicted from the others by damped regression."""
    stretches = np.array_split(np.arange(r.size), FOLDS)
    grams = [columns[s].T @ columns[s] for s in stretches]
    sides = [columns[s].T @ r[s] for s in stretches]
    gram, side = sum(grams), sum(sides)
    ridge = damping * np.eye(columns.shape[1])
    left = 0.0
    for s, own_gram, own_side in zip(stretches, grams, sides, strict=True):
        c = scipy.linalg.solve(gram - own_gram + ridge, side - own_side, assume_a="pos")
        left += float(np.sum((r[s] - columns[s] @ c) ** 2))
    return left


@final
@dataclass(frozen=True, eq=False)
class _Correction:
    correction: FloatArray
    left: float
    iterations: int


def _smallest(chain: Entering, place: Place, r: FloatArray, target: float) -> _Correction:
    """Conjugate gradients on the normal equations from 0 until |r - S w|^2 is the target."""
    split = chain.trajectory.split

    def answer(u: FloatArray) -> FloatArray:
        smooth = np.concatenate([_smoothed(part) for part in split(u)])
        return chain.project(chain.answers(place, smooth[:, None])[:, 0])

    def back(rows: FloatArray) -> FloatArray:
        pulled = chain.back(place, chain.project(rows))
        return np.concatenate([_smoothed(part[::-1])[::-1] for part in split(pulled)])

    left, u = r.copy(), np.zeros(sum(chain.trajectory.lengths))
    gradient = back(left)
    direction, power = gradient, float(gradient @ gradient)
    iterations = 0
    while float(left @ left) > target and iterations < ITERATIONS and power > 0.0:
        moved = answer(direction)
        step = power / float(moved @ moved)
        # The last step is cut where the target is reached.
        before, along = float(left @ left), float(left @ moved)
        square = float(moved @ moved)
        if before - 2.0 * step * along + step**2 * square < target:
            step = (along - np.sqrt(max(0.0, along**2 - square * (before - target)))) / square
        u = u + step * direction
        left = left - step * moved
        iterations += 1
        gradient = back(left)
        renewed = float(gradient @ gradient)
        direction, power = gradient + (renewed / power) * direction, renewed
        if step * along < 1e-5 * before:
            break
    correction = np.concatenate([_smoothed(part) for part in split(u)])
    return _Correction(correction, float(left @ left), iterations)


def _smoothed(u: FloatArray) -> FloatArray:
    """w with w + T w' = u, so that the size of u is integral (w^2 + T^2 w'^2) but for the ends."""
    fade = SMOOTH / (SMOOTH + 1.0)
    return np.asarray(scipy.signal.lfilter([1.0 - fade], [1.0, -fade], u))


def _natural(chain: Entering, place: Place) -> float:
    """Root mean square of the drive-shaped correction that moves the reading as the drive does."""
    rate = place is Place.LOOP
    shape = chain.trajectory.signals[Quantity.DRIVE_RATE if rate else Quantity.DRIVE]
    shape = shape if rate else shape - shape.mean()
    shape = shape / np.sqrt(np.mean(shape**2))
    moved = float(np.std(chain.answers(place, shape[:, None])[:, 0]))
    reading = np.concatenate([r.position[r.counted] for r in chain.fit.records])
    return float(np.std(reading)) / moved if moved > 0 else float("inf")
