"""Chances of normal numbers, their squares and ratios of these, in double precision.

The library of special functions takes a third of a second to load, as long as a fit; these are all
that a fit asks of it, and their tests compare them with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import NormalDist
from typing import Final

_EPSILON: Final = 1e-16
_TINY: Final = 1e-300
_STIRLING: Final = ((1, 1.0 / 12.0), (3, -1.0 / 360.0), (5, 1.0 / 1260.0), (7, -1.0 / 1680.0))
_LARGE: Final = 50.0
"""From here on the next term of Stirling's series is below a double's last digit."""


def normal_quantile(chance: float) -> float:
    """What a standard normal number stays below with a chance between 0 and 1.

    Source: Wichura (1988), Applied Statistics 37, 477-484, by way of Python's own library.
    """
    return NormalDist().inv_cdf(chance)


def chi_squared_tail(freedom: float, value: float) -> float:
    """Chance of a sum of so many squares of standard normal numbers to exceed a value.

        Q(a, x) = Gamma(a, x) / Gamma(a),  a = freedom / 2,  x = value / 2

    By the series of the lower function where x < a + 1, else by the continued fraction of the
    upper one, which keeps small chances to all their digits.

    Source: NIST Handbook of Mathematical Functions, 8.7.1 and 8.9.2; Lentz (1976), Applied Optics
    15, 668-671.
    """
    a, x = 0.5 * freedom, 0.5 * value
    if math.isnan(x) or x <= 0.0:
        return math.nan if math.isnan(x) else 1.0
    if math.isinf(x):
        return 0.0
    return 1.0 - _below(a, x) if x < a + 1.0 else _beyond(a, x)


def chi_squared_quantile(freedom: float, chance: float) -> float:
    """The value that such a sum exceeds with a chance between 0 and 1.

    Wilson's and Hilferty's cube of a normal number begins.
    """
    share = 2.0 / (9.0 * freedom)
    cube = 1.0 - share + normal_quantile(1.0 - chance) * math.sqrt(share)
    return _exceeded(
        chance,
        freedom * max(cube, 0.01) ** 3,
        lambda value: chi_squared_tail(freedom, value),
        lambda value: _front(0.5 * freedom, 0.5 * value) / value,
    )


def f_tail(above: float, below: float, value: float) -> float:
    """Chance of a ratio of two mean squares of normal numbers to exceed a value.

        I_x(below / 2, above / 2),  x = below / (below + above value)

    Args:
        above, below: degrees of freedom of numerator and denominator.
        value: the ratio.

    Source: NIST Handbook of Mathematical Functions, 8.17.22; Lentz (1976).
    """
    whole = below + above * value
    return _beta(0.5 * below, 0.5 * above, below / whole, above * value / whole)


def t_quantile(freedom: float, chance: float) -> float:
    """What Student's t stays below with a chance between 0.5 and 1."""

    def tail(value: float) -> float:
        square = value**2
        whole = freedom + square
        return 0.5 * _beta(0.5 * freedom, 0.5, freedom / whole, square / whole)

    flat = _rise(0.5 * freedom, 0.5)

    def density(value: float) -> float:
        bend = 0.5 * (freedom + 1.0) * math.log1p(value**2 / freedom)
        return math.exp(flat - bend) / math.sqrt(freedom * math.pi)

    return _exceeded(1.0 - chance, normal_quantile(chance), tail, density)


def _exceeded(
    chance: float,
    begin: float,
    tail: Callable[[float], float],
    density: Callable[[float], float],
) -> float:
    """The positive value beyond which a tail is a chance: Newton's steps between known bounds."""
    value, low, high = begin, 0.0, math.inf
    for _ in range(100):
        excess = tail(value) - chance
        if excess > 0.0:
            low = value
        else:
            high = value
        slope = density(value)
        there = value + excess / slope if slope > 0.0 else math.nan
        if not low < there < high:
            there = 0.5 * (low + high) if high < math.inf else 2.0 * value
        if abs(there - value) <= 1e-15 * value:
            return there
        value = there
    return value


def _front(a: float, x: float) -> float:
    """x^a exp(-x) / Gamma(a)."""
    return math.exp(a * math.log(x) - x - math.lgamma(a))


def _below(a: float, x: float) -> float:
    """The lower function over the whole, by its series."""
    term = total = 1.0 / a
    k = a
    while term > _EPSILON * total:
        k += 1.0
        term *= x / k
        total += term
    return total * _front(a, x)


def _beyond(a: float, x: float) -> float:
    """The upper function over the whole, by its continued fraction."""
    b = x + 1.0 - a
    c, d = 1.0 / _TINY, 1.0 / b
    fraction, k = d, 0
    while True:
        k += 1
        step = -k * (k - a)
        b += 2.0
        d = 1.0 / _nonzero(step * d + b)
        c = _nonzero(b + step / c)
        fraction *= c * d
        if abs(c * d - 1.0) <= 4.0 * _EPSILON:
            return fraction * _front(a, x)


def _beta(a: float, b: float, x: float, rest: float) -> float:
    """The incomplete beta function over the whole at x = 1 - rest, by its continued fraction."""
    if x > (a + 1.0) / (a + b + 2.0):
        return 1.0 - _beta(b, a, rest, x)
    if x <= 0.0:
        return 0.0
    whole = _rise(max(a, b), min(a, b)) - math.lgamma(min(a, b))
    near = math.log1p(-rest) if rest < 0.5 else math.log(x)
    front = math.exp(whole + a * near + b * math.log(rest)) / a
    c = 1.0
    fraction = d = 1.0 / _nonzero(1.0 - (a + b) * x / (a + 1.0))
    m = 0
    while True:
        m += 1
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        moved = 1.0
        for step in (even, odd):
            d = 1.0 / _nonzero(1.0 + step * d)
            c = _nonzero(1.0 + step / c)
            moved *= c * d
        fraction *= moved
        if abs(moved - 1.0) <= 4.0 * _EPSILON:
            return front * fraction


def _rise(a: float, by: float) -> float:
    """log(Gamma(a + by) / Gamma(a)); of large numbers by Stirling's series, term by term.

    Source: NIST Handbook of Mathematical Functions, 5.11.1.
    """
    if a < _LARGE:
        return math.lgamma(a + by) - math.lgamma(a)
    small = [sum(c / z**k for k, c in _STIRLING) for z in (a, a + by)]
    return (a + by - 0.5) * math.log1p(by / a) + by * (math.log(a) - 1.0) + small[1] - small[0]


def _nonzero(value: float) -> float:
    return value if value != 0.0 else _TINY
