"""Sparse regression: a short formula for the correction that enters a place.

    r ~ sum_k c_k P S f_k

Terms are judged in the reading: S is the chain's answer to a correction entering the place and P
the projector of the fitted parameters, the same least squares as the score test. They are chosen
forward; after each choice every term may be exchanged for a better one; the sum grows while BIC
falls by more than 10 and the explained share grows by more than 1 %. Wavelengths are then refined
around those chosen.

Why not a library. PySINDy and scikit-learn regress a given w on given columns. The correction
itself is a bad target (inverting the chain has coloured its noise), and with the columns carried
through the chain what is left is forward selection on the Gram matrix of a few hundred terms.

Sources: Brunton, Proctor & Kutz (2016), PNAS 113(15), 3932-3937 (sparse regression of dynamics);
Miller (2002), Subset Selection in Regression, 2nd ed., sec. 3.3 (sequential replacement).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import assemble
from piezo_opt.diagnosis.entering import Entering
from piezo_opt.diagnosis.forces import RATES, share_of
from piezo_opt.diagnosis.formula import Factor, Formula, Shape, Term
from piezo_opt.diagnosis.noise import NoiseFloor
from piezo_opt.diagnosis.scores import effective_samples
from piezo_opt.diagnosis.trajectory import Quantity
from piezo_opt.effects.base import Place
from piezo_opt.errors import ModelError

FloatArray = NDArray[np.float64]

MOST_TERMS: Final = 3
STRONG: Final = 10.0
"""Fall of BIC that a term must bring (Kass & Raftery 1995: very strong evidence)."""
WORTH: Final = 0.01
"""Share that a term must bring: a formula is for reading."""
RIVAL: Final = 0.02
"""Share by which another first term may be worse and still be named."""
_WAVES: Final = 40
"""Wavelengths tried for a wave, from a sixteenth of the signal's span to the span."""
_REFINED: Final = 3
"""Times that the grid of wavelengths is made four times finer around those chosen."""
_GONE: Final = 1e-6
"""Squared share of a term below which the fitted parameters or other terms explain it away."""


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
    signals = {q: chain.trajectory.signals[q] for q in readable(chain, place)}
    columns = _Columns(chain, place, signals)
    columns.offer(library(signals))
    if period is not None and Quantity.POSITION in signals:
        columns.offer(waves_of(Quantity.POSITION, period / (2.0 * np.pi), signals))
    chosen = columns.select(noise)
    step = 16.0 ** (1.0 / (_WAVES - 1))
    for _ in range(_REFINED):
        # Between two wavelengths of the grid a pair of neighbours would be taken for one wave.
        waves = {f for k in chosen for f in columns.terms[k].factors if f.shape.is_wave}
        if not waves:
            break
        lengths = [
            (w.quantity, w.scale * f) for w in waves for f in np.geomspace(1 / step, step, 9)
        ]
        columns.offer([t for q, scale in lengths for t in waves_of(q, float(scale), signals)])
        chosen = columns.select(noise)
        step = step**0.25
    if not chosen:
        return None
    return Formula(
        place,
        tuple(columns.terms[k] for k in chosen),
        columns.coefficients(chosen),
        columns.share(chosen, noise),
        columns.rivals(chosen, noise),
    )


def readable(chain: Entering, place: Place) -> tuple[Quantity, ...]:
    """Signals that an effect of this model at this place can read without an algebraic loop."""
    found = []
    for quantity in chain.trajectory.signals:
        if quantity is Quantity.SINCE_REVERSAL:
            continue  # no signal of the chain
        if place is Place.INPUT and quantity is Quantity.DRIVE_RATE:
            continue  # it jumps at every sample, and the loop would not follow the jumps
        term = Term((Factor(quantity, Shape.LINEAR, 1.0),))
        try:
            assemble(chain.fit.model + Formula(place, (term,), (1.0,), 0.0).as_effect())
        except ModelError:
            continue
        found.append(quantity)
    return tuple(found)


def library(signals: Mapping[Quantity, FloatArray]) -> list[Term]:
    """Terms in these signals: shapes of one, products of two, waves of drive and position."""
    powers = {q: scale_of(s) for q, s in signals.items()}
    plain = [s for s in Shape if not s.is_wave]
    terms = [Term((Factor(q, s, powers[q]),)) for q in signals for s in plain]
    order = list(signals)
    for q in order:
        for other in order:
            inner = Factor(other, Shape.LINEAR, powers[other])
            for shape in (Shape.LINEAR, Shape.SIZE, Shape.SQUARE, Shape.SIGN):
                # The product of two linear factors has no order.
                again = shape is Shape.LINEAR and order.index(q) > order.index(other)
                if other is not q and not again:
                    terms.append(Term((Factor(q, shape, powers[q]), inner)))
    for q in (Quantity.DRIVE, Quantity.POSITION):
        if q in signals:
            span = float(np.ptp(signals[q])) / (2.0 * np.pi)
            for scale in np.geomspace(span / 16.0, span, _WAVES):
                terms += waves_of(q, float(scale), signals)
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
        self._gram, self._side = np.zeros((0, 0)), np.zeros(0)

    def offer(self, terms: Sequence[Term]) -> None:
        """Add terms that are not there yet."""
        new = [t for t in dict.fromkeys(terms) if t not in self.terms]
        along = np.column_stack([term.along(self._signals) for term in new])
        whole = self._chain.answers(self._place, along)
        # Scaled as they are: what the fitted parameters explain away must stay small.
        lengths = np.maximum(np.sqrt(np.einsum("kq,kq->q", whole, whole)), 1e-300)
        columns = self._chain.project(whole / lengths)
        usable = np.asarray(np.isfinite(columns).all(axis=0))
        self.terms += [t for t, fine in zip(new, usable, strict=True) if fine]
        columns = columns[:, usable]
        across, inner = self._columns.T @ columns, columns.T @ columns
        self._gram = np.block([[self._gram, across], [across.T, inner]])
        self._side = np.concatenate([self._side, columns.T @ self._r])
        self._columns = np.hstack([self._columns, columns])
        self._lengths = np.concatenate([self._lengths, lengths[usable]])

    def _solve(self, chosen: tuple[int, ...]) -> FloatArray:
        index = list(chosen)
        # Damped so little that only dependent columns feel it.
        gram = self._gram[np.ix_(index, index)] + 1e-10 * np.eye(len(index))
        return np.asarray(np.linalg.solve(gram, self._side[index]))

    def coefficients(self, chosen: tuple[int, ...]) -> tuple[float, ...]:
        """Coefficients of the chosen terms, in the place's unit."""
        return tuple((self._solve(chosen) / self._lengths[list(chosen)]).tolist())

    def left(self, chosen: tuple[int, ...]) -> float:
        """Sum of squares that the chosen terms leave."""
        return float(self._r @ self._r - self._side[list(chosen)] @ self._solve(chosen))

    def share(self, chosen: tuple[int, ...], noise: NoiseFloor) -> float:
        """Of what the noise does not explain, the part that the chosen terms explain."""
        return share_of(self._chain, self.left(chosen), noise)

    def _best(self, kept: tuple[int, ...]) -> int:
        """The term that, beside those kept, leaves least."""
        index = list(kept)
        inner = self._gram[np.ix_(index, index)] + 1e-10 * np.eye(len(index))
        back = np.linalg.solve(inner, self._gram[index])
        side = self._side - back.T @ self._side[index]
        power = np.diag(self._gram) - np.einsum("kq,kq->q", self._gram[index], back)
        gain = np.where(power > _GONE, side**2 / np.maximum(power, _GONE), -1.0)
        gain[index] = -1.0
        return int(np.argmax(gain))

    def select(self, noise: NoiseFloor) -> tuple[int, ...]:
        """Forward selection with exchange; empty where no term is worth its price."""
        chosen: tuple[int, ...] = ()
        bic, share = 0.0, 0.0
        while len(chosen) < MOST_TERMS:
            grown = self._exchanged((*chosen, self._best(chosen)))
            now, grown_share = self._bic(grown), self.share(grown, noise)
            if now > bic - STRONG or grown_share < share + WORTH:
                break
            chosen, bic, share = grown, now, grown_share
        return chosen

    def _bic(self, chosen: tuple[int, ...]) -> float:
        """BIC less that of no term, on as many samples as carry news."""
        rest = self._r - self._columns[:, list(chosen)] @ self._solve(chosen)
        n = max(2.0, effective_samples(rest))
        unknowns = sum(self.terms[k].unknowns for k in chosen)
        ratio = float(rest @ rest) / float(self._r @ self._r)
        return n * float(np.log(max(ratio, 1e-300))) + unknowns * float(np.log(n))

    def _exchanged(self, chosen: tuple[int, ...]) -> tuple[int, ...]:
        """Exchange one term at a time for a better one until none is."""
        for _ in range(10):
            before = chosen
            for k in range(len(chosen)):
                rest = (*chosen[:k], *chosen[k + 1 :])
                better = (*chosen[:k], self._best(rest), *chosen[k + 1 :])
                if self.left(better) < self.left(chosen) * (1.0 - 1e-9):
                    chosen = better
            if chosen == before:
                break
        return chosen

    def rivals(self, chosen: tuple[int, ...], noise: NoiseFloor) -> tuple[str, ...]:
        """Other first terms that explain nearly as much; a wave next to another is no rival."""
        least = self.share(chosen, noise) - RIVAL
        found = []
        for k, term in enumerate(self.terms):
            wave = any(f.shape.is_wave for f in term.factors)
            if k not in chosen and not wave:
                share = self.share((k, *chosen[1:]), noise)
                if share > least:
                    found.append((-share, str(term)))
        return tuple(text for _, text in sorted(found)[:3])
