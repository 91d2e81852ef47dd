"""The part of a chain that is linear, as matrix functions of the sub-step.

A resonance or a lag moves by rates that are linear in its own states, with coefficients
that the parameters alone decide. Over a sub-step h such a part is known exactly once its input is:

    x' = L x + N(t),    x(h) = e^(hL) x + h (phi_1(hL) N + h phi_2(hL) N' + ...)

    phi_k(z) = sum_j z^j / (j + k)!

so that neither its stability nor its swinging asks for short sub-steps. L is block diagonal:
single states, and pairs that drive each other (position and velocity). A pair's functions are
combinations of 1 and z alone, because z^2 = tr(z) z - det(z) (Cayley-Hamilton).

Source: Hochbruck & Ostermann (2010), Exponential integrators, Acta Numerica 19, 209-286; scaling
and doubling: Higham (2008), Functions of Matrices, ch. 10.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from math import factorial
from pathlib import Path
from typing import Final, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.keeping import digest, kept
from piezo_opt.symbolic import one_at_a_time

_REACH: Final = 32.0
"""Size of hL up to which a sub-step is as good as exact."""
_HEARD: Final = 4.0
"""The same where something that is not linear follows what swings or fades within it."""
LENGTHS: Final = 16
"""Lengths of a sub-step for which the weights are kept; they cost several sub-steps."""
_DEPTH: Final = 20
"""Operations deep to which two slopes are compared."""
_NONE: Final = ca.SX(0.0)
_DOUBLINGS: Final = 6
_TERMS: Final = 15
_ORIGIN: Final = f"{metadata.version('casadi')} {digest(Path(__file__).read_bytes())}"
"""What takes a linear part out: the engine, and the lines of this file as imported."""

FloatArray = NDArray[np.float64]
_Pair = tuple[ca.SX, ca.SX]


@final
@dataclass(frozen=True, eq=False)
class LinearPart:
    """Blocks of states whose own rates are linear.

    Attributes:
        blocks: the states of each block, one or two.
        heard: for each, whether something that is in no block follows it.
        matrix: ``(p) -> L`` (n, n) [1/s], block diagonal.
        rest: ``(t, x, u, du, c, dc, p) -> x' - L x``.
        slopes: ``(t, x, u, du, c, dc, p) -> d rest / dx`` (n, n) [1/s].
    """

    blocks: tuple[tuple[int, ...], ...]
    heard: tuple[bool, ...]
    matrix: ca.Function
    rest: ca.Function
    slopes: ca.Function


@final
@dataclass(frozen=True, eq=False)
class Weights:
    """What a block's states and inputs are multiplied by over half a sub-step and a whole one.

    With z = hL: ``e^(z/2)``, ``(h/2) phi_1(z/2)``, ``e^z`` and the weights h (phi_1 - 3 phi_2 +
    4 phi_3), h (2 phi_2 - 4 phi_3) and h (4 phi_3 - phi_2) of the inputs at the beginning, in the
    middle (twice) and at the end.
    """

    half: ca.SX
    half_input: ca.SX
    whole: ca.SX
    first: ca.SX
    middle: ca.SX
    last: ca.SX


@lru_cache(maxsize=2048)
@one_at_a_time
def linear_part(system: System, exact: bool) -> LinearPart:
    """The blocks of a system: terms of its rates that are a state times what only p decides.

    A force that depends on the motion may add to a block's rates what is not linear: it stays in
    the rest.

    Args:
        system: assembled model.
        exact: without it there are no blocks, and all is rest.
    """
    origin = f"{system.recipe}\n{exact=}\n{_ORIGIN}"
    return kept("linear parts", origin, lambda: _taken_out(system, exact), _written_out, _read)


def _written_out(part: LinearPart) -> str:
    functions = (part.matrix, part.rest, part.slopes)
    return json.dumps([part.blocks, part.heard, *(f.serialize() for f in functions)])


def _read(text: str) -> LinearPart:
    blocks, heard, *functions = json.loads(text)
    return LinearPart(
        tuple(tuple(block) for block in blocks), tuple(heard),
        *(ca.Function.deserialize(f) for f in functions),
    )  # fmt: skip


def _taken_out(system: System, exact: bool) -> LinearPart:
    rate = system.rate
    names = rate.name_in()
    given = [ca.SX.sym(name, rate.numel_in(i)) for i, name in enumerate(names)]
    x, p = given[1], given[-1]
    moving = ca.vertcat(*given[:-1])
    n = x.numel()
    states = ca.vertsplit(x)
    rest = ca.densify(rate(*given))
    rows = ca.vertsplit(rest)
    pattern = np.zeros((n, n), dtype=bool)
    for i, row in enumerate(rows if exact else ()):
        pattern[i, list(split(row, dict(enumerate(states)), x, moving)[0])] = True
    blocks = blocks_of(pattern)
    matrix = ca.SX(n, n)
    for block in blocks:
        mates = {j: states[j] for j in block}
        together = ca.vertcat(*mates.values())
        for i in block:
            slopes, rest[i] = split(rows[i], mates, together, moving)
            for j, slope in slopes.items():
                matrix[i, j] = slope
    among = {i for block in blocks for i in block}
    free = ca.vertcat(*(rest[i] for i in range(n) if i not in among))
    heard = [ca.depends_on(free, ca.vertcat(*(states[j] for j in block))) for block in blocks]
    return LinearPart(
        blocks,
        tuple(heard),
        ca.Function("po_linear", [p], [matrix]),
        ca.Function("po_rest", given, [rest], names, rate.name_out()),
        ca.Function("po_slopes", given, [ca.densify(ca.jacobian(rest, x))]),
    )


def split(
    one: ca.SX, wanted: Mapping[int, ca.SX], together: ca.SX, moving: ca.SX
) -> tuple[dict[int, ca.SX], ca.SX]:
    """Where a sum is a state times what only the parameters decide: those factors, and the rest.

    Taken out term by term, so that nothing of it is left to rounding.

    Args:
        one: the sum.
        wanted: states to look for, by their index.
        together: the same as one column.
        moving: whatever is not a parameter.
    """

    def part(index: int) -> tuple[dict[int, ca.SX], ca.SX]:
        return split(one.dep(index), wanted, together, moving)

    if not ca.depends_on(one, together):
        return {}, one
    if one.is_op(ca.OP_ADD) or one.is_op(ca.OP_SUB):
        (left, rest), (right, other) = part(0), part(1)
        if one.is_op(ca.OP_ADD):
            added = {j: left.get(j, _NONE) + right.get(j, _NONE) for j in {**left, **right}}
            return added, rest + other
        less = {j: left.get(j, _NONE) - right.get(j, _NONE) for j in {**left, **right}}
        # A corner that is the difference of two has no slope of its own.
        cancels = {j for j in {*left} & {*right} if ca.is_equal(left[j], right[j], _DEPTH)}
        return {j: slope for j, slope in less.items() if j not in cancels}, rest - other
    if one.is_op(ca.OP_NEG):
        inner, rest = part(0)
        return {j: -slope for j, slope in inner.items()}, -rest
    if one.is_op(ca.OP_DIV) and not ca.depends_on(one.dep(1), moving):
        inner, rest = part(0)
        return {j: slope / one.dep(1) for j, slope in inner.items()}, rest / one.dep(1)
    for factor in (0, 1) if one.is_op(ca.OP_MUL) else ():
        by = one.dep(factor)
        if not ca.depends_on(by, moving):
            inner, rest = part(1 - factor)
            return {j: by * slope for j, slope in inner.items()}, by * rest
    if one.is_op(ca.OP_TWICE):
        inner, rest = part(0)
        return {j: 2.0 * slope for j, slope in inner.items()}, 2.0 * rest
    if one.is_symbolic():
        itself = next(j for j, state in wanted.items() if ca.is_equal(one, state))
        return {itself: ca.SX(1.0)}, ca.SX(0.0)
    return {}, one


def blocks_of(pattern: NDArray[np.bool_]) -> tuple[tuple[int, ...], ...]:
    """Pairs of states that swing or fade one after the other, and those that fade by themselves."""
    n = pattern.shape[0]
    # A position is moved by its velocity alone, whatever else that one moves and is moved by.
    both = [
        (i, j) for i in range(n) for j in range(i + 1, n)
        if pattern[i, j] and pattern[j, i] and not (pattern[i, i] and pattern[j, j])
    ]  # fmt: skip
    both.sort(key=lambda pair: min(int(pattern[i].sum()) for i in pair))
    # Of two poles in a row the second one follows but the first: nothing is sampled between them.
    fading = [i for i in range(n) if _fades(pattern, i)]
    rows = [
        (i, j) for i in fading for j in fading
        if i != j and pattern[j, i] and pattern[j].sum() == 2
    ]  # fmt: skip
    blocks: list[tuple[int, ...]] = []
    taken: set[int] = set()
    for block in (*both, *rows, *((i,) for i in fading)):
        if not taken & {*block}:
            blocks.append(block)
            taken |= {*block}
    return tuple(sorted(blocks))


def _fades(pattern: NDArray[np.bool_], i: int) -> bool:
    """Whether a state drives itself, and no other one that drives it."""
    return bool(pattern[i, i] and (pattern[i] & pattern[:, i]).sum() == 1)


def weights(matrix: ca.SX, h: ca.SX) -> Weights:
    """The weights of a block L (1, 1) or (2, 2) for a sub-step h."""
    return _of_one(matrix, h) if matrix.numel() == 1 else _of_two(matrix, h)


def _of_one(matrix: ca.SX, h: ca.SX) -> Weights:
    z = matrix * h
    half = 0.5 * z
    (inner, *_), (one, two, three) = _phis(half), _phis(z)
    return Weights(1.0 + half * inner, 0.5 * h * inner, 1.0 + z * one, *_inputs(h, one, two, three))


def _inputs(h: ca.SX, one: ca.SX, two: ca.SX, three: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """What inputs at the beginning, in the middle (each of two) and at the end weigh."""
    return (
        h * (one - 3.0 * two + 4.0 * three),
        h * (2.0 * two - 4.0 * three),
        h * (4.0 * three - two),
    )


def _phis(z: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """phi_1, phi_2 and phi_3 of a number: near 0 the series, else the closed form."""
    small = ca.fabs(z) < 1.0
    near, far = ca.if_else(small, z, 0.0), ca.if_else(small, 1.0, z)
    series = [ca.SX(0.0)] * 3
    third = ca.SX(0.0)
    for k in range(_TERMS, -1, -1):
        third = third * near + 1.0 / factorial(k + 3)
    series[2] = third
    series[1] = third * near + 0.5
    series[0] = series[1] * near + 1.0
    one = ca.expm1(far) / far
    two = (one - 1.0) / far
    closed = (one, two, (two - 0.5) / far)
    first, second, last = (ca.if_else(small, a, b) for a, b in zip(series, closed, strict=True))
    return first, second, last


@final
@dataclass(frozen=True, eq=False)
class _Plane:
    """Functions a + b z of a 2 x 2 matrix z of known trace and determinant, as pairs (a, b)."""

    trace: ca.SX
    determinant: ca.SX

    def times(self, left: _Pair, right: _Pair) -> _Pair:
        """The product of two functions."""
        (a, b), (c, d) = left, right
        both = b * d
        return a * c - self.determinant * both, a * d + b * c + self.trace * both

    def after(self, constant: float, function: _Pair) -> _Pair:
        """``constant + z function``."""
        a, b = function
        return constant - self.determinant * b, a + self.trace * b

    def doubled(self) -> _Plane:
        """The same for 2 z."""
        return _Plane(2.0 * self.trace, 4.0 * self.determinant)


def _of_doubled(share: float, *parts: _Pair) -> _Pair:
    """A sum of functions of z times a number, as a function of 2 z."""
    a, b = ca.SX(0.0), ca.SX(0.0)
    for of_one, of_z in parts:
        a, b = a + of_one, b + of_z
    return share * a, 0.5 * share * b


def _of_two(matrix: ca.SX, h: ca.SX) -> Weights:
    """By the series at z / 2^s and doubling, with z = hL.

    phi_k(2z) = (e^z phi_k(z) + sum_j phi_j(z) / (k - j)!) / 2^k for j = 1 ... k.
    """
    scaled = 0.5**_DOUBLINGS * h
    plane = _Plane(scaled * ca.trace(matrix), scaled * scaled * ca.det(matrix))
    three = ca.SX(1.0 / factorial(_TERMS + 3)), ca.SX(0.0)
    for k in range(_TERMS - 1, -1, -1):
        three = plane.after(1.0 / factorial(k + 3), three)
    two = plane.after(0.5, three)
    one = plane.after(1.0, two)
    power = plane.after(1.0, one)
    half_power, half_one = power, one
    for _ in range(_DOUBLINGS):
        half_power, half_one = power, one
        half_of_one = 0.5 * one[0], 0.5 * one[1]
        three = _of_doubled(0.125, plane.times(power, three), half_of_one, two, three)
        two = _of_doubled(0.25, plane.times(power, two), one, two)
        one = _of_doubled(0.5, plane.times(power, one), one)
        power = _of_doubled(1.0, plane.times(power, power))
        plane = plane.doubled()
    whole = matrix * h

    def full(pair: _Pair, of: ca.SX) -> ca.SX:
        return pair[0] * ca.SX.eye(2) + pair[1] * of

    return Weights(
        full(half_power, 0.5 * whole),
        0.5 * h * full(half_one, 0.5 * whole),
        full(power, whole),
        *_inputs(h, full(one, whole), full(two, whole), full(three, whole)),
    )


def longest(part: LinearPart, parameters: FloatArray) -> float:
    """The longest sub-step [s] over which the blocks of a part are as good as exact."""
    if not part.blocks:
        return np.inf
    matrix = part.matrix(parameters).full()
    return reach(matrix, zip(part.blocks, part.heard, strict=True))


def reach(matrix: FloatArray, blocks: Iterable[tuple[Sequence[int], bool]]) -> float:
    """The longest sub-step [s] over which linear blocks are as good as exact.

    Args:
        matrix: L (n, n) [1/s].
        blocks: the states of each, and whether something that is in no block follows it.
    """
    limit = np.inf
    for block, heard in blocks:
        own = matrix[np.ix_(block, block)]
        size = float(np.abs(np.linalg.eigvals(own)).max()) if np.isfinite(own).all() else np.inf
        if size > 0.0:
            limit = min(limit, (_HEARD if heard else _REACH) / size)
    return limit
