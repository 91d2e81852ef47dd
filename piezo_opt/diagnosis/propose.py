"""Sparse regression: a short formula for the correction that enters a place.

    r ~ sum_k c_k P S f_k

Terms are judged in the reading: S is the chain's answer to a correction entering the place and P
the projector of the fitted parameters, the same least squares as the score test. They are chosen
forward; after each choice every term is exchanged for the best one beside the others, and the
wavelengths of chosen waves are tuned. The sum grows while stretches of the record that are left
out are predicted better by more than one standard error (``forces``).

Why not a library. PySINDy and scikit-learn regress a given w on given columns. The correction
itself is a bad target (inverting the chain has coloured its noise), and with the columns carried
through the chain what is left is forward selection among a few hundred terms.

Sources: Brunton, Proctor & Kutz (2016), PNAS 113(15), 3932-3937 (sparse regression of dynamics);
Miller (2002), Subset Selection in Regression, 2nd ed., sec. 3.3 (sequential replacement).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.diagnosis.entering import PIECES, Entering, Quantity, assembles
from piezo_opt.diagnosis.evidence import WORTH
from piezo_opt.diagnosis.forces import (
    DAMPING,
    RATES,
    beyond,
    left_out,
    lengths,
    share_of,
)
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
    terms = library(signals)
    if period is not None and Quantity.POSITION in signals:
        terms += waves_of(Quantity.POSITION, period / (2.0 * np.pi), signals)
    columns = _Columns(chain, place, signals)
    columns.offer(terms)
    chosen, share, error = columns.select(noise)
    if not chosen:
        return None
    return Formula(
        place,
        tuple(columns.terms[k] for k in chosen),
        columns.coefficients(chosen),
        share,
        columns.rivals(chosen, error * beyond(chain.residual, noise)),
    )


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
    plain = [s for s in Shape if not s.is_wave]
    terms = [Term((Factor(q, s, scale_of(along)),)) for q, along in signals.items() for s in plain]
    order = list(signals)
    for q in order:
        for other in order:
            inner = Factor(other, Shape.LINEAR, scale_of(signals[other]))
            for shape in (Shape.LINEAR, Shape.SIZE, Shape.SQUARE, Shape.SIGN):
                # The product of two linear factors has no order.
                again = shape is Shape.LINEAR and order.index(q) > order.index(other)
                if other is not q and not again:
                    terms.append(Term((Factor(q, shape, scale_of(signals[q])), inner)))
    for q in (Quantity.DRIVE, Quantity.POSITION):
        if q in signals:
            for waves in np.arange(1.0, PIECES / 2 + 0.5, 0.5):
                terms += waves_of(q, float(np.ptp(signals[q]) / (2.0 * np.pi * waves)), signals)
    return terms


def waves_of(
    quantity: Quantity, scale: float, signals: Mapping[Quantity, FloatArray]
) -> list[Term]:
    """Sine and cosine of a signal, alone and times its rate: a gain or damping along the travel."""
    rate = RATES[0] if quantity is Quantity.DRIVE else RATES[1]
    terms = []
    for shape in (Shape.SINE, Shape.COSINE):
        wave = Factor(quantity, shape, scale)
        terms.append(Term((wave,)))
        if rate in signals:
            terms.append(Term((wave, Factor(rate, Shape.LINEAR, scale_of(signals[rate])))))
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
        self.terms: list[Term] = []
        self._chain, self._place, self._signals = chain, place, signals
        self._r = chain.residual
        self._columns = np.zeros((self._r.size, 0))
        self._lengths = np.zeros(0)

    def _entered(self, terms: Sequence[Term]) -> tuple[FloatArray, FloatArray]:
        """Answers (M, q) in the reading, and the lengths (q,) that they were scaled by."""
        along = np.column_stack([term.along(self._signals) for term in terms])
        whole = self._chain.answers(self._place, along)
        scale = lengths(whole)
        return self._chain.project(whole / scale), scale

    def offer(self, terms: Sequence[Term]) -> None:
        """Add terms."""
        columns, scale = self._entered(terms)
        self.terms += terms
        columns = np.where(np.isfinite(columns), columns, 0.0)
        self._columns = np.hstack([self._columns, columns])
        self._lengths = np.concatenate([self._lengths, scale])

    def coefficients(self, chosen: Sequence[int]) -> tuple[float, ...]:
        """Coefficients of the chosen terms, in the place's unit."""
        found, *_ = np.linalg.lstsq(self._columns[:, chosen], self._r)
        return tuple((found / self._lengths[chosen]).tolist())

    def _gains(self, kept: Sequence[int], columns: FloatArray) -> FloatArray:
        """Squares that each column (M, q) explains beside those kept."""
        basis, _ = np.linalg.qr(self._columns[:, kept])
        left = self._r - basis @ (basis.T @ self._r)
        power = np.einsum("mq,mq->q", columns, columns)
        power -= np.sum((basis.T @ columns) ** 2, axis=0)
        return np.asarray((left @ columns) ** 2 / (np.maximum(power, 0.0) + DAMPING))

    def _best(self, kept: Sequence[int]) -> int:
        return int(np.argmax(self._gains(kept, self._columns)))

    def select(self, noise: NoiseFloor) -> tuple[list[int], float, float]:
        """Chosen terms, their share and its standard error; none where none is worth its price."""
        chosen: list[int] = []
        share, error, before = 0.0, 0.0, np.inf
        while len(chosen) < MOST_TERMS:
            grown = [*chosen, self._best(chosen)]
            for _ in range(2 * len(grown)):
                kept = grown[1:]
                grown = [*kept, self._tuned(self._best(kept), kept)]
            left = left_out(self._columns[:, grown], self._r)
            now, its_error = share_of(self._r, left, noise)
            if now - its_error <= share or before < (1.0 + WORTH**2) * left.sum():
                break
            chosen, share, error, before = grown, now, its_error, left.sum()
        return chosen, share, error

    def _tuned(self, index: int, kept: Sequence[int]) -> int:
        """The term; where it is a wave, one of the best wavelength within half a wave."""
        term = self.terms[index]
        wave = next((f for f in term.factors if f.shape.is_wave), None)
        if wave is None:
            return index
        span = float(np.ptp(self._signals[wave.quantity])) / (2.0 * np.pi)

        def of(waves: float) -> Term:
            tuned = replace(wave, scale=span / waves)
            return Term(tuple(tuned if f is wave else f for f in term.factors))

        found = scipy.optimize.minimize_scalar(
            lambda waves: -float(self._gains(kept, self._entered([of(waves)])[0])[0]),
            bounds=(span / wave.scale - 0.5, span / wave.scale + 0.5),
        )
        self.offer([of(float(found.x))])
        return len(self.terms) - 1

    def rivals(self, chosen: Sequence[int], error: float) -> tuple[str, ...]:
        """Other first terms that explain as much but for an error [m^2]; a wave is no rival."""
        gains = self._gains(chosen[1:], self._columns)
        others = [
            k for k, term in enumerate(self.terms)
            if k not in chosen and not any(f.shape.is_wave for f in term.factors)
            and gains[k] > gains[chosen[0]] - error
        ]  # fmt: skip
        return tuple(str(self.terms[k]) for k in sorted(others, key=lambda k: -gains[k])[:3])
