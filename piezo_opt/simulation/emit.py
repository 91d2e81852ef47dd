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

from piezo_opt.simulation.instructions import (
    EXP,
    LOG,
    LOG_ABOVE,
    TANH,
    fused,
    instructions,
    known_at,
    quick,
)

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
    EXP: "po_exp({0})",
    TANH: "po_tanh({0})",
    LOG: "po_log({0})",
    LOG_ABOVE: "po_log(1.0 + {0})",
}


@final
@dataclass(frozen=True)
class Block:
    """C lines of one function: one list of lines a loop level, outermost first."""

    levels: tuple[tuple[str, ...], ...]
    outputs: tuple[tuple[str, ...], ...]
    """For each output of the function the C expression of each of its elements."""


LANE: Final = "@"
"""Ends the name of a variable that is several numbers side by side, one for each derivative."""
BESIDE: Final = {
    ca.OP_ADD: "({0} + {1})",
    ca.OP_SUB: "({0} - {1})",
    ca.OP_MUL: "({0} * {1})",
    ca.OP_DIV: "({0} / {1})",
    ca.OP_IF_ELSE_ZERO: "({0} ? {1} : none)",
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "(-{0})",
    ca.OP_TWICE: "({0} + {0})",
}
"""What is done to derivatives, which only ever enter linearly."""


def emit(
    function: ca.Function, names: Sequence[str], levels: Sequence[int], prefix: str, depth: int,
    wide: Sequence[int] = (),
) -> Block:  # fmt: skip
    """Write an SX function as C statements.

    Args:
        function: SX function whose inputs and outputs are dense columns.
        names: C prefix of each input; element i of input ``x`` is the variable ``x_i``.
        levels: loop level at which each input is known, 0 outermost.
        prefix: prefix of the variables made here.
        depth: number of levels.
        wide: inputs whose elements are lanes: their names, and those of what is made of them, end
            with :data:`LANE`, and lines that hold it are of the type ``lane``.

    Raises:
        NotImplementedError: an operation that has no C text; the operation's number is named.
    """
    program = quick(fused(instructions(function)), levels)
    level = known_at(program, levels)
    lines: list[list[str]] = [[] for _ in range(depth)]
    text: dict[int, str] = {}
    outputs = [["0.0"] * function.numel_out(i) for i in range(function.n_out())]
    for k, one in program.items():
        if one.op == ca.OP_OUTPUT:
            outputs[one.place[0]][one.place[1]] = text[one.inputs[0]]
        elif one.op == ca.OP_INPUT:
            text[k] = f"{names[one.place[0]]}_{one.place[1]}{LANE * (one.place[0] in wide)}"
        elif one.op == ca.OP_CONST:
            text[k] = number(one.constant)
        else:
            beside = any(LANE in text[i] for i in one.inputs)
            text[k] = f"{prefix}{k}{LANE * beside}"
            said = pattern(one.op, beside).format(*(text[i] for i in one.inputs))
            kind = "lane" if beside else "double"
            lines[level[k]].append(f"const {kind} {text[k]} = {said};")
    return Block(tuple(map(tuple, lines)), tuple(map(tuple, outputs)))


def pattern(op: int, beside: bool = False) -> str:
    """The C text of an operation, on numbers or on lanes.

    Raises:
        NotImplementedError: there is none.
    """
    found = BESIDE.get(op) if beside else BINARY.get(op) or UNARY.get(op)
    if found is None:
        raise NotImplementedError(f"CasADi operation {op} has no C text in {__name__}.")
    return found


def number(value: float) -> str:
    """A number as C."""
    text = repr(float(value))
    mapping: Mapping[str, str] = {"inf": "INFINITY", "-inf": "(-INFINITY)", "nan": "NAN"}
    if text in mapping:
        return mapping[text]
    return f"({text})" if value < 0 else text
