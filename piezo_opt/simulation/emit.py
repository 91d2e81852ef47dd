"""Straight-line expressions written as C, with what does not change hoisted out of the loops.

CasADi's own generator writes a function with pointer tests for every input and output; in the
inner loop of a simulation they cost more than the physics. Here the same instruction list is
written as named local variables, each at the outermost loop level where its inputs are known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import casadi as ca

_BINARY = {
    ca.OP_ADD: "({0} + {1})",
    ca.OP_SUB: "({0} - {1})",
    ca.OP_MUL: "({0} * {1})",
    ca.OP_DIV: "({0} / {1})",
    ca.OP_POW: "pow({0}, {1})",
    ca.OP_CONSTPOW: "pow({0}, {1})",
    # Not fmin and fmax: their rule for NaN costs a call, a comparison is one instruction.
    ca.OP_FMIN: "({0} < {1} ? {0} : {1})",
    ca.OP_FMAX: "({0} > {1} ? {0} : {1})",
    ca.OP_LT: "(double)({0} < {1})",
    ca.OP_LE: "(double)({0} <= {1})",
    ca.OP_EQ: "(double)({0} == {1})",
    ca.OP_NE: "(double)({0} != {1})",
    ca.OP_AND: "(double)({0} && {1})",
    ca.OP_OR: "(double)({0} || {1})",
    ca.OP_IF_ELSE_ZERO: "({0} ? {1} : 0.0)",
    ca.OP_ATAN2: "atan2({0}, {1})",
    ca.OP_FMOD: "fmod({0}, {1})",
    ca.OP_REMAINDER: "remainder({0}, {1})",
    ca.OP_COPYSIGN: "copysign({0}, {1})",
    ca.OP_HYPOT: "hypot({0}, {1})",
}
_UNARY = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "(-{0})",
    ca.OP_SQ: "({0} * {0})",
    ca.OP_TWICE: "({0} + {0})",
    ca.OP_INV: "(1.0 / {0})",
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_EXP: "exp({0})",
    ca.OP_LOG: "log({0})",
    ca.OP_LOG1P: "log1p({0})",
    ca.OP_EXPM1: "expm1({0})",
    ca.OP_SIN: "sin({0})",
    ca.OP_COS: "cos({0})",
    ca.OP_TAN: "tan({0})",
    ca.OP_ASIN: "asin({0})",
    ca.OP_ACOS: "acos({0})",
    ca.OP_ATAN: "atan({0})",
    ca.OP_SINH: "sinh({0})",
    ca.OP_COSH: "cosh({0})",
    ca.OP_TANH: "tanh({0})",
    ca.OP_ASINH: "asinh({0})",
    ca.OP_ACOSH: "acosh({0})",
    ca.OP_ATANH: "atanh({0})",
    ca.OP_ERF: "erf({0})",
    ca.OP_FABS: "fabs({0})",
    ca.OP_FLOOR: "floor({0})",
    ca.OP_CEIL: "ceil({0})",
    ca.OP_NOT: "(double)(!{0})",
    ca.OP_SIGN: "(double)(({0} > 0.0) - ({0} < 0.0))",
}


@final
@dataclass(frozen=True)
class Block:
    """C lines of one function: one list of lines a loop level, outermost first."""

    levels: tuple[tuple[str, ...], ...]
    outputs: tuple[tuple[str, ...], ...]
    """For each output of the function the C expression of each of its elements."""


def emit(
    function: ca.Function,
    names: Sequence[str],
    levels: Sequence[int],
    prefix: str,
    depth: int,
) -> Block:
    """Write an SX function as C statements.

    Args:
        function: SX function whose inputs and outputs are dense columns.
        names: C prefix of each input; element i of input ``x`` is the variable ``x_i``.
        levels: loop level at which each input is known, 0 outermost.
        prefix: prefix of the variables made here.
        depth: number of levels.

    Raises:
        NotImplementedError: an operation that has no C text; the operation's number is named.
    """
    lines: list[list[str]] = [[] for _ in range(depth)]
    text: dict[int, str] = {}
    level: dict[int, int] = {}
    outputs = [["0.0"] * function.numel_out(i) for i in range(function.n_out())]
    count = 0
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = text[source[0]]
            continue
        if op == ca.OP_INPUT:
            text[target[0]] = f"{names[source[0]]}_{source[1]}"
            level[target[0]] = levels[source[0]]
            continue
        if op == ca.OP_CONST:
            text[target[0]] = _number(function.instruction_constant(k))
            level[target[0]] = 0
            continue
        pattern = _BINARY.get(op) or _UNARY.get(op)
        if pattern is None:
            raise NotImplementedError(f"CasADi operation {op} has no C text in {__name__}.")
        inputs = [text[i] for i in source]
        at = max((level[i] for i in source), default=0)
        name = f"{prefix}{count}"
        count += 1
        lines[at].append(f"const double {name} = {pattern.format(*inputs)};")
        text[target[0]], level[target[0]] = name, at
    return Block(tuple(tuple(ls) for ls in lines), tuple(tuple(o) for o in outputs))


def _number(value: float) -> str:
    text = repr(float(value))
    mapping: Mapping[str, str] = {"inf": "INFINITY", "-inf": "(-INFINITY)", "nan": "NAN"}
    if text in mapping:
        return mapping[text]
    return f"({text})" if value < 0 else text
