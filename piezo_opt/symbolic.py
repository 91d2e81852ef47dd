"""The border to CasADi: the few mathematical words in which effects are written.

An effect is written with ``+ - * /`` and the functions of this module, on symbols that the
assembler hands it. Nothing else of the package's physics knows which symbolic engine is behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import casadi as ca

Expression: TypeAlias = Any
"""A scalar or column of the symbolic engine (or a float); the engine carries no type hints."""

_TINY = 1e-300


def abs_(a: Expression) -> Expression:
    """Absolute value ``|a|``, element by element."""
    return ca.fabs(a)


def sign_(a: Expression) -> Expression:
    """Sign of ``a``: -1, 0 or 1, element by element."""
    return ca.sign(a)


def min_(a: Expression, b: Expression) -> Expression:
    """The smaller of ``a`` and ``b``, element by element."""
    return ca.fmin(a, b)


def max_(a: Expression, b: Expression) -> Expression:
    """The larger of ``a`` and ``b``, element by element."""
    return ca.fmax(a, b)


def clip_(a: Expression, low: Expression, high: Expression) -> Expression:
    """``a`` held between ``low`` and ``high``."""
    return ca.fmax(low, ca.fmin(high, a))


def exp(a: Expression) -> Expression:
    """Exponential function."""
    return ca.exp(a)


def log(a: Expression) -> Expression:
    """Natural logarithm."""
    return ca.log(a)


def expm1(a: Expression) -> Expression:
    """``exp(a) - 1`` without cancellation near 0."""
    return ca.expm1(a)


def sqrt(a: Expression) -> Expression:
    """Square root."""
    return ca.sqrt(a)


def sin(a: Expression) -> Expression:
    """Sine of an angle in radians."""
    return ca.sin(a)


def cos(a: Expression) -> Expression:
    """Cosine of an angle in radians."""
    return ca.cos(a)


def tanh(a: Expression) -> Expression:
    """Hyperbolic tangent."""
    return ca.tanh(a)


def softplus(a: Expression) -> Expression:
    """Smooth positive part ``log(1 + exp(a))``, written so that it never overflows."""
    size = ca.fabs(a)
    # (a + |a|)/2 and not max(a, 0): its derivative at 0 is 1/2, the true one, not 0 or 1.
    return 0.5 * (a + size) + ca.log1p(ca.exp(-size))


def where_(condition: Expression, then: Expression, otherwise: Expression) -> Expression:
    """``then`` where the condition holds, ``otherwise`` elsewhere."""
    return ca.if_else(condition, then, otherwise)


def power_(base: Expression, exponent: Expression) -> Expression:
    """``base ** exponent`` for a base that is never negative.

    Regular at ``base = 0``: the derivative by the exponent is 0 there, not NaN. Exponents that
    are plain numbers 0, 1 and 2 cost nothing.
    """
    constant = _constant(exponent)
    if constant == 0.0:
        return 1.0 + 0.0 * base
    if constant == 1.0:
        return base
    if constant == 2.0:
        return base * base
    return ca.exp(exponent * ca.log(base + _TINY))


def play(before: Expression, value: Expression, radius: Expression) -> Expression:
    """Play operator over a monotone stretch: ``before`` dragged along to stay near ``value``.

    ``min(max(before, value - radius), value + radius)``, element by element. Written by cases,
    so that the derivatives are right even at radius 0, where minimum and maximum meet.
    """
    pulled_down = ca.if_else(before - value > radius, value + radius, before)
    return ca.if_else(value - before > radius, value - radius, pulled_down)


def stack(parts: Sequence[Expression]) -> Expression:
    """One column from scalars or columns."""
    return ca.vertcat(*parts)


def sum_(column: Expression) -> Expression:
    """Sum of a column's elements."""
    return ca.sum1(column)


def _constant(a: Expression) -> float | None:
    if isinstance(a, int | float):
        return float(a)
    if isinstance(a, ca.SX | ca.DM) and a.is_constant() and a.numel() == 1:
        return float(a)
    return None
