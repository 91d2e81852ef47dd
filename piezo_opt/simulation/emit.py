"""Straight-line expressions written as C, with what does not change hoisted out of the loops.

CasADi's own generator writes a function with pointer tests for every input and output; in the
inner loop of a simulation they cost more than the physics. Here the same instruction list is
written as named local variables, each at the outermost loop level where its inputs are known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

import casadi as ca

from piezo_opt.simulation.instructions import Instruction, fused, instructions, known_at
from piezo_opt.simulation.quick import Quick
from piezo_opt.simulation.tangents import Carried, Lanes, Tangents

BINARY: Final = {
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
UNARY: Final = {
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
    innermost: tuple[tuple[str, ...], ...]
    """For each output of the function those lines of the innermost level that it needs."""
    outputs: tuple[tuple[str, ...], ...]
    """For each output of the function the C expression of each of its elements."""
    tangents: tuple[tuple[tuple[str | None, ...], ...], ...]
    """The same for their tangents, one a group of directions; None where it is zero."""
    chain: int
    """Most operations of the innermost level that wait for one another."""


def emit(
    function: ca.Function,
    names: Sequence[str],
    levels: Sequence[int],
    prefix: str,
    depth: int,
    along: Tangents | None = None,
    tables: bool = True,
) -> Block:
    """Write an SX function as C statements.

    Args:
        function: SX function whose inputs and outputs are dense columns.
        names: C prefix of each input; element i of input ``x`` is the variable ``x_i``.
        levels: loop level at which each input is known, 0 outermost.
        prefix: prefix of the variables made here.
        depth: number of levels.
        along: the tangents to be carried along with every result; without them none.
        tables: whether powers come from tables of their own.

    Raises:
        NotImplementedError: an operation that has no C text; the operation's number is named.
    """
    program = fused(instructions(function))
    level = known_at(program, levels)
    quick = Quick(program, level, prefix, tables)
    lines: list[list[tuple[int, str]]] = [[] for _ in range(depth)]
    text: dict[int, str] = {}
    waits: dict[int, int] = {}
    outputs = [["0.0"] * function.numel_out(i) for i in range(function.n_out())]
    along = along or Tangents(Lanes(()), {}, prefix)
    none: tuple[str | None, ...] = (None,) * len(along.lanes.groups)
    moved = [[none] * function.numel_out(i) for i in range(function.n_out())]
    for k, one in program.items():
        if one.op == ca.OP_OUTPUT:
            outputs[one.place[0]][one.place[1]] = text[one.inputs[0]]
            found = along[one.inputs[0]]
            moved[one.place[0]][one.place[1]] = tuple(t and t.text for t in found)
            continue
        waits[k] = 0
        if one.op == ca.OP_INPUT:
            text[k] = f"{names[one.place[0]]}_{one.place[1]}"
            along.of_input(k, one.place)
        elif one.op == ca.OP_CONST:
            text[k] = number(one.constant)
            along.of_constant(k)
        else:
            pattern = BINARY.get(one.op) or UNARY.get(one.op)
            if pattern is None:
                raise NotImplementedError(f"CasADi operation {one.op} has no C text in {__name__}.")
            text[k] = f"{prefix}{k}"
            said = quick.said(k, text) or pattern.format(*(text[i] for i in one.inputs))
            for at, line in quick.hoisted(k):
                lines[at].append((k, line))
            lines[level[k]].append((k, f"const double {text[k]} = {said};"))
            if level[k] == depth - 1:
                waits[k] = 1 + max(waits[i] for i in one.inputs)
            operands = [Carried(text[i], level[i]) for i in one.inputs]
            result = Carried(text[k], level[k])
            for at, line in along.of_operation(k, one.op, one.inputs, operands, result):
                lines[at].append((k, line))
    needed = [_needed(program, i) for i in range(function.n_out())]
    return Block(
        tuple(tuple(line for _, line in ls) for ls in lines),
        tuple(tuple(line for k, line in lines[-1] if k in those) for those in needed),
        tuple(tuple(o) for o in outputs),
        tuple(tuple(m) for m in moved),
        max(waits.values(), default=0),
    )


def _needed(program: Mapping[int, Instruction], output: int) -> set[int]:
    """Numbers of the instructions that an output of the function follows from."""
    found: set[int] = set()
    ends = (k for k, one in program.items() if one.op == ca.OP_OUTPUT and one.place[0] == output)
    to_see = list(ends)
    while to_see:
        k = to_see.pop()
        if k not in found:
            found.add(k)
            to_see += program[k].inputs
    return found


def number(value: float) -> str:
    text = repr(float(value))
    mapping: Mapping[str, str] = {"inf": "INFINITY", "-inf": "(-INFINITY)", "nan": "NAN"}
    if text in mapping:
        return mapping[text]
    return f"({text})" if value < 0 else text
