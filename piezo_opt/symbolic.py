"""The border to CasADi: the few mathematical words in which effects are written.

An effect is written with ``+ - * /`` and the functions of this module, on symbols that the
assembler hands it. Nothing else of the package's physics knows which symbolic engine is behind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from threading import RLock
from typing import Any, Final, ParamSpec, TypeAlias, TypeVar

import casadi as ca

Expression: TypeAlias = Any
"""A scalar or column of the symbolic engine (or a float); the engine carries no type hints."""

_TINY = 1e-300
_ROUNDING = 1e-12
"""Share of two sums by which their rounding may differ: thousands of times a double's last."""
_BUILDING: Final = RLock()
_Given = ParamSpec("_Given")
_Made = TypeVar("_Made")


def one_at_a_time(build: Callable[_Given, _Made]) -> Callable[_Given, _Made]:
    """A function that makes or frees expressions, run by one thread at a time.

    The engine lets go of the interpreter's lock while it builds expressions and while it frees
    them, and two threads that do so at once bring the process down, rarely. What the function
    makes on its way dies within it.
    """

    @wraps(build)
    def alone(*args: _Given.args, **kwargs: _Given.kwargs) -> _Made:
        with _BUILDING:
            return build(*args, **kwargs)

    return alone


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
    as how far it is dragged up or down, so that the derivatives are right even at radius 0, where
    minimum and maximum meet.
    """
    up = value - before - radius
    down = value - before + radius
    return before + ca.if_else(up > 0.0, up, 0.0) + ca.if_else(down < 0.0, down, 0.0)


def dragged(
    before: Expression, value: Expression, rate: Expression, radius: Expression
) -> Expression:
    """Play operator whose rate is right from a stretch's first moment on.

    ``play`` with the same value, for what an effect gives; what a state becomes needs no rate.
    Where a stretch goes on from the contact in which the last one ended, the operator moves with
    ``value`` at once; ``before`` differs from there by the rounding of the two samples, which
    decides nothing here.
    """
    touching = radius - _ROUNDING * (ca.fabs(value) + radius)
    falls = ca.logic_and(rate < 0, before - value >= touching)
    rises = ca.logic_and(rate > 0, value - before >= touching)
    pulled_down = ca.if_else(falls, value + radius, play(before, value, radius))
    return ca.if_else(rises, value - radius, pulled_down)


def taken_along(
    before: Expression, begun: Expression, length: Expression, value: Expression,
    rate: Expression, radius: Expression,
) -> Expression:  # fmt: skip
    """Play operator whose rate is its mean over a stretch, for what follows that rate.

    In the stretch in which the contact is made, the operator rests and then moves. A scheme that
    asks for the rate a few times finds it resting at first, however short the rest is, and errs by
    a sixth of the stretch. Here the operator goes evenly to where it will be at the stretch's end.

    Args:
        before: the operator at the stretch's beginning.
        begun: what drags it, at the stretch's beginning.
        length: of the stretch [s]. Where it is that of another one, the stretch in which contact
            is made is told unevenly; where it is not known yet, 0, contact is made at once.
        value: what drags it, now.
        rate: of that; taken for constant over the stretch.
        radius: half of the lost motion.
    """
    way = rate * length
    before = play(before, begun, radius)
    end = play(before, begun + way, radius)
    moving = ca.fabs(way) > _ROUNDING * (ca.fabs(begun) + ca.fabs(value) + _TINY)
    share = (value - begun) / ca.if_else(moving, way, 1.0)
    at_once = before + value - begun
    still = play(before, value, radius)
    unknown = ca.logic_and(length == 0.0, rate != 0.0)
    return ca.if_else(moving, before + (end - before) * share, ca.if_else(unknown, at_once, still))


def length_of_stretch(
    before: Expression, begun: Expression, value: Expression, rate: Expression
) -> Expression:
    """Length [s] of a stretch that ends now, from the way and the rate; without a way as before.

    Args:
        before: the length as it was known.
        begun: a signal at the stretch's beginning.
        value: the signal now.
        rate: of the signal.
    """
    way = value - begun
    seen = ca.logic_and(
        way * rate > 0.0, ca.fabs(way) > _ROUNDING * (ca.fabs(begun) + ca.fabs(value))
    )
    return ca.if_else(seen, way / ca.if_else(seen, rate, 1.0), before)


def stack(parts: Sequence[Expression]) -> Expression:
    """One column from scalars or columns."""
    return ca.vertcat(*parts)


def sum_(column: Expression) -> Expression:
    """Sum of a column's elements."""
    return ca.sum1(column)


def kinks(function: Any) -> Any:
    """The quantities at whose zero a function has a corner or a jump.

    Args:
        function: an SX function.

    Returns:
        a function of the same inputs whose one output is a column with the argument of every
        absolute value and sign, and the difference of every minimum and maximum, in order.
    """
    found: list[Expression] = []

    def note(argument: Expression) -> None:
        found.append(argument)

    inputs, _ = _replayed(function, note)
    return ca.Function("po_kinks", inputs, [ca.vertcat(*found) if found else ca.SX(0, 1)])


def smoothed(function: Any, widths: Sequence[float]) -> Any:
    """The same function with its corners rounded.

        |a| -> sqrt(a^2 + w^2),   sign a -> a / sqrt(a^2 + w^2),
        min, max (a, b) -> (a + b -+ |a - b|) / 2  with that absolute value

    The width w of each is in the unit of its argument. Far from a corner the function does not
    change; at it, an absolute value is w instead of 0. Choices by comparison stay as they are.

    Args:
        function: an SX function.
        widths: one width for each of :func:`kinks`, 0 for a corner that is to stay.
    """
    left = iter(widths)

    def rounded(argument: Expression) -> Expression | None:
        width = next(left)
        return ca.sqrt(argument * argument + width * width) if width else None

    inputs, outputs = _replayed(function, rounded)
    names_in = [function.name_in(i) for i in range(function.n_in())]
    names_out = [function.name_out(i) for i in range(function.n_out())]
    return ca.Function(function.name(), inputs, outputs, names_in, names_out)


_UNARY: Final[dict[int, Callable[[Any], Any]]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_TWICE: lambda a: 2.0 * a,
    ca.OP_INV: lambda a: 1.0 / a,
    ca.OP_SQRT: ca.sqrt,
    ca.OP_EXP: ca.exp,
    ca.OP_LOG: ca.log,
    ca.OP_LOG1P: ca.log1p,
    ca.OP_EXPM1: ca.expm1,
    ca.OP_SIN: ca.sin,
    ca.OP_COS: ca.cos,
    ca.OP_TAN: ca.tan,
    ca.OP_ASIN: ca.asin,
    ca.OP_ACOS: ca.acos,
    ca.OP_ATAN: ca.atan,
    ca.OP_SINH: ca.sinh,
    ca.OP_COSH: ca.cosh,
    ca.OP_TANH: ca.tanh,
    ca.OP_ASINH: ca.asinh,
    ca.OP_ACOSH: ca.acosh,
    ca.OP_ATANH: ca.atanh,
    ca.OP_ERF: ca.erf,
    ca.OP_FLOOR: ca.floor,
    ca.OP_CEIL: ca.ceil,
    ca.OP_NOT: ca.logic_not,
}
_BINARY: Final[dict[int, Callable[[Any, Any], Any]]] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_POW: lambda a, b: a**b,
    ca.OP_CONSTPOW: lambda a, b: a**b,
    ca.OP_LT: lambda a, b: a < b,
    ca.OP_LE: lambda a, b: a <= b,
    ca.OP_EQ: lambda a, b: a == b,
    ca.OP_NE: lambda a, b: a != b,
    ca.OP_AND: ca.logic_and,
    ca.OP_OR: ca.logic_or,
    ca.OP_IF_ELSE_ZERO: lambda a, b: ca.if_else(a, b, 0.0),
    ca.OP_ATAN2: ca.atan2,
    ca.OP_FMOD: ca.fmod,
    ca.OP_COPYSIGN: ca.copysign,
    ca.OP_HYPOT: ca.hypot,
}


def _replayed(
    function: Any, size: Callable[[Expression], Expression | None]
) -> tuple[list[Expression], list[Expression]]:
    """The instructions of a function once more.

    Every absolute value, hidden ones too, is taken by ``size``; where that is None it stays.
    """
    inputs = [
        ca.SX.sym(function.name_in(i), function.sparsity_in(i)) for i in range(function.n_in())
    ]
    entries = [[part.nz[i] for i in range(part.nnz())] for part in inputs]
    outputs: list[list[Expression]] = [
        [ca.SX(0.0)] * function.nnz_out(i) for i in range(function.n_out())
    ]
    work: dict[int, Expression] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        read, written = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_INPUT:
            work[written[0]] = entries[read[0]][read[1]]
        elif operation == ca.OP_OUTPUT:
            outputs[written[0]][written[1]] = work[read[0]]
        elif operation == ca.OP_CONST:
            work[written[0]] = ca.SX(function.instruction_constant(k))
        elif operation == ca.OP_FABS:
            taken = size(work[read[0]])
            work[written[0]] = ca.fabs(work[read[0]]) if taken is None else taken
        elif operation == ca.OP_SIGN:
            taken = size(work[read[0]])
            exact = taken is None
            work[written[0]] = ca.sign(work[read[0]]) if exact else work[read[0]] / taken
        elif operation in (ca.OP_FMIN, ca.OP_FMAX):
            a, b = work[read[0]], work[read[1]]
            apart, low = size(a - b), operation == ca.OP_FMIN
            if apart is None:
                work[written[0]] = ca.fmin(a, b) if low else ca.fmax(a, b)
            else:
                work[written[0]] = 0.5 * (a + b - apart if low else a + b + apart)
        elif operation in _UNARY:
            work[written[0]] = _UNARY[operation](work[read[0]])
        else:
            work[written[0]] = _BINARY[operation](work[read[0]], work[read[1]])
    shapes = [function.sparsity_out(i) for i in range(function.n_out())]
    return inputs, [
        ca.SX(shape, ca.vertcat(*parts)) if parts else ca.SX(shape)
        for shape, parts in zip(shapes, outputs, strict=True)
    ]


def _constant(a: Expression) -> float | None:
    if isinstance(a, int | float):
        return float(a)
    if isinstance(a, ca.SX | ca.DM) and a.is_constant() and a.numel() == 1:
        return float(a)
    return None
