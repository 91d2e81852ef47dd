"""Straight-line expressions written as C, with what does not change hoisted out of the loops.

CasADi's own generator writes a function with pointer tests for every input and output; in the
inner loop of a simulation they cost more than the physics. Here the same instruction list is
written as named local variables, each at the outermost loop level where its inputs are known.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import casadi as ca

from piezo_opt.simulation.tangents import Carried, Lanes, Tangents

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
    tangents: tuple[tuple[tuple[str | None, ...], ...], ...]
    """The same for their tangents, one a group of directions; None where it is zero."""
    chain: int
    """Most operations of the innermost level that wait for one another."""


@final
@dataclass(frozen=True)
class _Instruction:
    """One operation; its number in the list is the number of its result."""

    op: int
    inputs: tuple[int, ...]
    place: tuple[int, int] = (0, 0)
    """Of an input or output of the function: which one, which element."""
    constant: float = 0.0


def emit(
    function: ca.Function,
    names: Sequence[str],
    levels: Sequence[int],
    prefix: str,
    depth: int,
    along: Tangents | None = None,
) -> Block:
    """Write an SX function as C statements.

    Args:
        function: SX function whose inputs and outputs are dense columns.
        names: C prefix of each input; element i of input ``x`` is the variable ``x_i``.
        levels: loop level at which each input is known, 0 outermost.
        prefix: prefix of the variables made here.
        depth: number of levels.
        along: the tangents to be carried along with every result; without them none.

    Raises:
        NotImplementedError: an operation that has no C text; the operation's number is named.
    """
    program = _fused(_instructions(function))
    lines: list[list[str]] = [[] for _ in range(depth)]
    text: dict[int, str] = {}
    level: dict[int, int] = {}
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
        level[k] = max((level[i] for i in one.inputs), default=0)
        waits[k] = 0
        if one.op == ca.OP_INPUT:
            text[k] = f"{names[one.place[0]]}_{one.place[1]}"
            level[k] = levels[one.place[0]]
            along.of_input(k, one.place)
        elif one.op == ca.OP_CONST:
            text[k] = _number(one.constant)
            along.of_constant(k)
        else:
            pattern = _BINARY.get(one.op) or _UNARY.get(one.op)
            if pattern is None:
                raise NotImplementedError(f"CasADi operation {one.op} has no C text in {__name__}.")
            text[k] = f"{prefix}{k}"
            said = pattern.format(*(text[i] for i in one.inputs))
            lines[level[k]].append(f"const double {text[k]} = {said};")
            if level[k] == depth - 1:
                waits[k] = 1 + max(waits[i] for i in one.inputs)
            operands = [Carried(text[i], level[i]) for i in one.inputs]
            result = Carried(text[k], level[k])
            for at, line in along.of_operation(k, one.op, one.inputs, operands, result):
                lines[at].append(line)
    return Block(
        tuple(tuple(ls) for ls in lines),
        tuple(tuple(o) for o in outputs),
        tuple(tuple(m) for m in moved),
        max(waits.values(), default=0),
    )


def _instructions(function: ca.Function) -> dict[int, _Instruction]:
    """The function's operations, results numbered instead of CasADi's re-used registers."""
    program: dict[int, _Instruction] = {}
    holder: dict[int, int] = {}
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_OUTPUT:
            program[k] = _Instruction(op, (holder[source[0]],), (target[0], target[1]))
            continue
        if op == ca.OP_INPUT:
            program[k] = _Instruction(op, (), (source[0], source[1]))
        elif op == ca.OP_CONST:
            program[k] = _Instruction(op, (), constant=float(function.instruction_constant(k)))
        else:
            program[k] = _Instruction(op, tuple(holder[i] for i in source))
        holder[target[0]] = k
    return program


def _fused(program: dict[int, _Instruction]) -> dict[int, _Instruction]:
    """``a - (b c + d e)`` as ``(a - b c) - d e``: two fused operations instead of three.

    In a balance the left side is known early and both products wait for the state, so this takes
    an operation out of the chain that a sub-step waits for. The products' own rounding is as
    large as that of the changed order.
    """
    uses = Counter(i for one in program.values() for i in one.inputs)
    found = dict(program)
    after = max(program, default=0) + 1
    order: list[int] = []
    for k, one in program.items():
        if one.op == ca.OP_SUB and uses[one.inputs[1]] == 1:
            left, right = one.inputs
            both = program[right]
            if both.op == ca.OP_ADD and all(program[i].op == ca.OP_MUL for i in both.inputs):
                order.remove(right)
                found[after] = _Instruction(ca.OP_SUB, (left, both.inputs[0]))
                found[k] = _Instruction(ca.OP_SUB, (after, both.inputs[1]))
                order.append(after)
                after += 1
        order.append(k)
    return {k: found[k] for k in order}


def _number(value: float) -> str:
    text = repr(float(value))
    mapping: Mapping[str, str] = {"inf": "INFINITY", "-inf": "(-INFINITY)", "nan": "NAN"}
    if text in mapping:
        return mapping[text]
    return f"({text})" if value < 0 else text
