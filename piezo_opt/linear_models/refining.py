"""From given poles to the nearest least squares, with exact derivatives and within bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np

from piezo_opt.linear_models.cascade import Cascade
from piezo_opt.linear_models.question import LinearQuestion
from piezo_opt.linear_models.responses import Point, Prepared, solved
from piezo_opt.measurement import FloatArray

FASTEST: Final = 10.0
"""A pole may be so many times as fast as half the sampling rate; a held drive shows of a faster one
only that it is fast."""
SLOWEST: Final = 0.01
"""A pole may turn by so many times 2 pi over the longest record; a slower one is a drift."""
GROWTH: Final = 50.0
"""An unstable pole grows by at most e^50 over the longest record; beyond, only it is seen."""
_TOLERANCE: Final = 1e-11
_PATIENCE: Final = 80


@final
@dataclass(frozen=True, eq=False)
class Poles:
    """Poles as the unknowns p of a chain, and the least squares there."""

    cascade: Cascade
    p: FloatArray
    point: Point
    evaluations: int = 0
    converged: bool = True

    @property
    def cost(self) -> float:
        """Sum of squares, scaled."""
        return self.point.cost


def limits(question: LinearQuestion) -> tuple[float, float]:
    """Slowest and fastest angular frequency of a pole [1/s] that records of this length show."""
    records = question.records.records
    longest = max(one.duration for one in records)
    finest = min(one.step for one in records)
    return SLOWEST * 2.0 * np.pi / longest, FASTEST * np.pi / finest


def bounds(question: LinearQuestion, cascade: Cascade) -> tuple[FloatArray, FloatArray]:
    """(n,) lower and upper bounds of p."""
    n = cascade.order
    slow, fast = limits(question)
    low, high = np.zeros(n), np.zeros(n)
    at = 0
    if not cascade.stable:
        growth = GROWTH / max(one.duration for one in question.records.records)
        for order, rate in zip(cascade.orders, cascade.rates, strict=True):
            low[at], high[at] = -((growth / rate) ** order), (fast / rate) ** order
            if order == 2:
                low[at + 1], high[at + 1] = -2.0 * growth / rate, 2.0 * fast / rate
            at += order
        return low, high
    for order, rate in zip(cascade.orders, cascade.rates, strict=True):
        low[at], high[at] = order * np.log(slow / rate), order * np.log(fast / rate)
        if order == 2:
            low[at + 1], high[at + 1] = np.log(0.01 * slow / rate), np.log(2.0 * fast / rate)
        at += order
    return low, high


def refined(
    question: LinearQuestion,
    records: tuple[Prepared, ...],
    cascade: Cascade,
    p: FloatArray,
    *,
    patience: int = _PATIENCE,
    tolerance: float = _TOLERANCE,
) -> Poles:
    """The nearest minimum from the poles p, by a trust region on the projected least squares.

    Source: Branch, Coleman & Li (1999), SIAM J. Sci. Comput. 21, 1-23.
    """
    from scipy import optimize

    kept: dict[bytes, Point] = {}

    def at(x: FloatArray) -> Point:
        key = x.tobytes()
        if key not in kept:
            if len(kept) > 4:
                kept.clear()
            kept[key] = solved(records, cascade, x, question)
        return kept[key]

    low, high = bounds(question, cascade)
    begin = np.clip(p, low + 1e-9, high - 1e-9)

    def residual(x: FloatArray) -> FloatArray:
        return at(x).residual

    def slope(x: FloatArray) -> FloatArray:
        return -at(x).slope

    answer = optimize.least_squares(
        residual,
        begin,
        slope,
        bounds=(low, high),
        ftol=tolerance,
        xtol=tolerance,
        gtol=1e-15,
        max_nfev=patience,
    )
    found = np.asarray(answer.x, dtype=np.float64)
    return Poles(cascade, found, at(found), int(answer.nfev), bool(answer.status > 0))


def rescaled(poles: Poles) -> Poles:
    """The same poles with the reference rates moved to where they are, so that p is near 0."""
    cascade, p = poles.cascade, poles.p.copy()
    q = cascade.coefficients(p)
    rates, at = cascade.rates.copy(), 0
    for k, order in enumerate(cascade.orders):
        size = abs(float(q[at])) ** (1.0 / order)
        if size > 0.0:
            rates[k] *= size
            factor = np.array([1.0 / size**order, 1.0 / size][:order])
            own = q[at : at + order] * factor
            p[at : at + order] = np.log(own) if cascade.stable else own
        at += order
    return replace(poles, cascade=replace(cascade, rates=rates), p=p)
