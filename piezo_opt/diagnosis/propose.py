"""Sparse regression: a short formula for the correction that enters a place.

    r ~ sum_k c_k P S f_k

Terms are judged in the reading: S is the chain's answer to a correction entering the place and P
the projector of the fitted parameters, the same least squares as the score test. They are chosen
forward, waves with their lengths tuned; after each choice every term is exchanged for the best one
beside the others, twice round. The sum grows while stretches of the record that are left out are
predicted better by more than one standard error (``forces``), and a further term leaves an eighth
fewer squares, as an effect that bears a name does (``evidence``).

Why not a library. PySINDy and scikit-learn regress a given w on given columns. The correction
itself is a bad target (inverting the chain has coloured its noise), and with the columns carried
through the chain what is left is forward selection among a few hundred terms.

Sources: Brunton, Proctor & Kutz (2016), PNAS 113(15), 3932-3937 (sparse regression of dynamics);
Miller (2002), Subset Selection in Regression, 2nd ed., sec. 3.3 (sequential replacement).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, permutations, product
from typing import Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import GONE
from piezo_opt.diagnosis.entering import PIECES, Entering, Quantity, assembles
from piezo_opt.diagnosis.evidence import WORTH
from piezo_opt.diagnosis.forces import RATES, answers, beyond, left_out, share_of
from piezo_opt.diagnosis.formula import Factor, Formula, Shape, Term
from piezo_opt.diagnosis.noise import NoiseFloor
from piezo_opt.effects.base import Place

FloatArray = NDArray[np.float64]

MOST_TERMS: Final = 3
"""A formula is for reading."""


def propose(
    chain: Entering, place: Place, noise: NoiseFloor, period: float | None = None
) -> Formula | None:
    """A formula for the correction that enters a place; None where no term is worth its price.

    Args:
        chain: the fit's answers to corrections.
        place: where it enters.
        noise: the floor.
        period: of a wave along the position [m] that is known, and offered beside the usual ones.
    """
    signals = {q: chain.signals[q] for q in readable(chain, place)}
    columns = _Columns(chain, place, signals)
    terms = library(signals)
    if period is not None and Quantity.POSITION in signals:
        terms += waves_of(Quantity.POSITION, period / (2.0 * np.pi), signals)
    columns.offer(terms)
    return columns.selected(noise)


def readable(chain: Entering, place: Place) -> tuple[Quantity, ...]:
    """Signals that an effect of this model at this place can read without an algebraic loop."""

    def can(quantity: Quantity) -> bool:
        if quantity is Quantity.SINCE_REVERSAL:
            return False  # no signal of the chain
        if place is Place.INPUT and quantity is Quantity.DRIVE_RATE:
            return False  # it jumps at every sample, and the loop would not follow the jumps
        term = Term((Factor(quantity, Shape.LINEAR, 1.0),))
        return assembles(chain.fit.model + Formula(place, (term,), (1.0,), 0.0).as_effect())

    return tuple(filter(can, chain.signals))


def library(signals: Mapping[Quantity, FloatArray]) -> list[Term]:
    """Terms in these signals: shapes of one, products of two, waves of drive and position.

    From one wave over the signal's span to as many as a function of that many knots could show
    (``entering.PIECES``), in steps of half a wave: any between is within a quarter of one of them.
    """

    def of(shape: Shape, q: Quantity) -> Factor:
        return Factor(q, shape, scale_of(signals[q]))

    plain = [shape for shape in Shape if not shape.is_wave]
    terms = [Term((of(shape, q),)) for q, shape in product(signals, plain)]
    # The product of two linear factors has no order.
    bent = product((Shape.SIZE, Shape.SQUARE, Shape.SIGN), permutations(signals, 2))
    linear = product((Shape.LINEAR,), combinations(signals, 2))
    terms += [
        Term((of(shape, q), of(Shape.LINEAR, other))) for shape, (q, other) in (*linear, *bent)
    ]
    for q in (Quantity.DRIVE, Quantity.POSITION):
        if q in signals:
            scales = np.ptp(signals[q]) / (np.pi * np.arange(2, PIECES + 1))
            terms += [term for scale in scales.tolist() for term in waves_of(q, scale, signals)]
    return terms


def waves_of(
    quantity: Quantity, scale: float, signals: Mapping[Quantity, FloatArray]
) -> list[Term]:
    """Sine and cosine of a signal, alone and times its rate: a gain or damping along the travel."""
    rate = RATES[0] if quantity is Quantity.DRIVE else RATES[1]
    waves = [Factor(quantity, shape, scale) for shape in (Shape.SINE, Shape.COSINE)]
    terms = [Term((wave,)) for wave in waves]
    if rate in signals:
        times = Factor(rate, Shape.LINEAR, scale_of(signals[rate]))
        terms += [Term((wave, times)) for wave in waves]
    return terms


def scale_of(along: FloatArray) -> float:
    """The power of ten nearest to a signal's size: a scale that reads well."""
    return float(10.0 ** np.round(np.log10(np.sqrt(np.mean(along**2)))))


@final
class _Columns:
    """The answers to terms entering a place, and least squares on few of them."""

    def __init__(
        self, chain: Entering, place: Place, signals: Mapping[Quantity, FloatArray]
    ) -> None:
        self._chain, self._place, self._signals = chain, place, signals
        self._terms: list[Term] = []
        self._columns = np.zeros((chain.residual.size, 0))

    def _entered(self, terms: Sequence[Term]) -> tuple[FloatArray, FloatArray]:
        along = np.column_stack([term.along(self._signals) for term in terms])
        return answers(self._chain, self._place, along)

    def offer(self, terms: Sequence[Term]) -> int:
        """Add terms; the index of the last one."""
        columns, _ = self._entered(terms)
        self._terms += terms
        self._columns = np.hstack([self._columns, np.where(np.isfinite(columns), columns, 0.0)])
        return len(self._terms) - 1

    def _gains(self, kept: Sequence[int], columns: FloatArray) -> FloatArray:
        """Squares that each column (M, q) explains beside those kept."""
        r = self._chain.residual
        basis, _ = np.linalg.qr(self._columns[:, kept])
        power = np.einsum("mq,mq->q", columns, columns) - np.sum((basis.T @ columns) ** 2, axis=0)
        along = (r - basis @ (basis.T @ r)) @ columns
        return np.asarray(along**2 / (np.maximum(power, 0.0) + GONE))

    def _best(self, kept: Sequence[int]) -> int:
        """The best term beside those kept; of a wave, of the best length within half a wave."""
        index = int(np.argmax(self._gains(kept, self._columns)))
        term, wave = self._terms[index], self._terms[index].wave
        if wave is None:
            return index
        span = float(np.ptp(self._signals[wave.quantity])) / (2.0 * np.pi)

        def of(waves: float) -> Term:
            tuned = replace(wave, scale=span / waves)
            return Term(tuple(tuned if f is wave else f for f in term.factors))

        found = scipy.optimize.minimize_scalar(
            lambda waves: -float(self._gains(kept, self._entered([of(waves)])[0])[0]),
            bounds=(span / wave.scale - 0.5, span / wave.scale + 0.5),
            options={"xatol": 1e-3},  # of a wave: less than a refit's error
        )
        return self.offer([of(float(found.x))])

    def selected(self, noise: NoiseFloor) -> Formula | None:
        """The sum that explains what is worth it; None where no term is."""
        r = self._chain.residual

        def judged(indices: list[int]) -> tuple[float, float, float]:
            left = left_out(self._columns[:, indices], r)
            return *share_of(r, left, noise), float(left.sum())

        chosen: list[int] = []
        share, error, before = 0.0, 0.0, np.inf
        while len(chosen) < MOST_TERMS:
            grown = [*chosen, self._best(chosen)]
            now, its_error, left = judged(grown)
            if now - its_error <= share or before < (1.0 + WORTH**2) * left:
                break
            for _ in range(2 * len(grown) * bool(chosen)):
                grown = [*grown[1:], self._best(grown[1:])]
            chosen, (share, error, before) = grown, judged(grown)
        if not chosen:
            return None
        # Other first terms that explain as much but for the error; a wave is no rival.
        gains = self._gains(chosen[1:], self._columns)
        least = gains[chosen[0]] - error * beyond(r, noise)
        rivals = [
            str(self._terms[k]) for k in np.argsort(-gains).tolist()
            if gains[k] > least and k not in chosen and self._terms[k].wave is None
        ]  # fmt: skip
        terms = tuple(self._terms[k] for k in chosen)
        columns, lengths = self._entered(terms)
        size, *_ = np.linalg.lstsq(columns, r)
        coefficients = tuple((size / lengths).tolist())
        return Formula(self._place, terms, coefficients, min(share, 1.0), tuple(rivals[:3]))
