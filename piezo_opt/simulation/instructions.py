"""The operations of an expression as a list, each result known by its number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

import casadi as ca

POWER: Final = -1
"""Power of a base with an exponent, from the exponent's tables; like those below no operation of
CasADi's, but one of ``powers.py``."""
EXP: Final = -2
LOG: Final = -3
LOG_ABOVE: Final = -4
"""Logarithm of a number plus one."""
TANH: Final = -5


@final
@dataclass(frozen=True)
class Instruction:
    """One operation; its number in the list is the number of its result."""

    op: int
    inputs: tuple[int, ...]
    place: tuple[int, int] = (0, 0)
    """Of an input or output of the function: which one, which element."""
    constant: float = 0.0


def instructions(function: ca.Function) -> dict[int, Instruction]:
    """The function's operations, results numbered instead of CasADi's re-used registers."""
    program: dict[int, Instruction] = {}
    holder: dict[int, int] = {}
    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_OUTPUT:
            program[k] = Instruction(op, (holder[source[0]],), (target[0], target[1]))
            continue
        if op == ca.OP_INPUT:
            program[k] = Instruction(op, (), (source[0], source[1]))
        elif op == ca.OP_CONST:
            program[k] = Instruction(op, (), constant=float(function.instruction_constant(k)))
        else:
            program[k] = Instruction(op, tuple(holder[i] for i in source))
        holder[target[0]] = k
    return program


def fused(program: dict[int, Instruction]) -> dict[int, Instruction]:
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
                found[after] = Instruction(ca.OP_SUB, (left, both.inputs[0]))
                found[k] = Instruction(ca.OP_SUB, (after, both.inputs[1]))
                order.append(after)
                after += 1
        order.append(k)
    return {k: found[k] for k in order}


def known_at(program: Mapping[int, Instruction], levels: Sequence[int]) -> dict[int, int]:
    """The loop level at which each result is known."""
    found: dict[int, int] = {}
    for k, one in program.items():
        if one.op == ca.OP_INPUT:
            found[k] = levels[one.place[0]]
        else:
            found[k] = max((found[i] for i in one.inputs), default=0)
    return found


def quick(
    program: Mapping[int, Instruction], levels: Sequence[int], tables: bool = False
) -> dict[int, Instruction]:
    """Operations of the loops in forms that a sub-step waits for less long.

    Powers, exponentials and logarithms come from tables, and a division by what is known further
    out is a product. Each differs from the usual form by some units of the last digit.

    Args:
        program: a list of operations.
        levels: loop level at which each input is known, 0 outermost.
        tables: whether a power comes from tables of its own exponent; else it is the exponential of
            a logarithm.
    """
    level = known_at(program, levels)
    uses = Counter(i for one in program.values() for i in one.inputs)
    powers = {k: power for k in program if (power := _power(program, level, k)) is not None}
    served = Counter(logarithm for logarithm, _ in powers.values())
    found: dict[int, Instruction] = {}
    inverses: dict[int, int] = {}
    after = max(program, default=0) + 1
    for k, one in program.items():
        found[k] = one
        if level[k] == 0 or one.op in (ca.OP_OUTPUT, ca.OP_INPUT):
            continue
        if k in powers and tables:
            logarithm, exponent = powers[k]
            found[k] = Instruction(POWER, (program[logarithm].inputs[0], exponent))
        elif one.op == ca.OP_EXP:
            found[k] = Instruction(EXP, one.inputs)
        elif one.op == ca.OP_TANH:
            found[k] = Instruction(TANH, one.inputs)
        elif one.op == ca.OP_LOG and uses[k] == served[k]:
            # A logarithm that is wanted for itself keeps its last digits near 1.
            found[k] = Instruction(LOG, one.inputs)
        elif one.op == ca.OP_LOG1P and program[one.inputs[0]].op == ca.OP_EXP:
            found[k] = Instruction(LOG_ABOVE, one.inputs)
        elif one.op == ca.OP_DIV and level[one.inputs[1]] < level[k]:
            divisor = one.inputs[1]
            if divisor not in inverses:
                del found[k]
                found[after] = Instruction(ca.OP_INV, (divisor,))
                inverses[divisor] = after
                after += 1
            found[k] = Instruction(ca.OP_MUL, (one.inputs[0], inverses[divisor]))
    return found


def _power(
    program: Mapping[int, Instruction], level: Mapping[int, int], k: int
) -> tuple[int, int] | None:
    """Logarithm and exponent of an exponential whose exponent is known before the loops."""
    one = program[k]
    if level[k] == 0 or one.op != ca.OP_EXP or program[one.inputs[0]].op != ca.OP_MUL:
        return None
    factors = program[one.inputs[0]].inputs
    for exponent, logarithm in (factors, factors[::-1]):
        if program[logarithm].op == ca.OP_LOG and level[exponent] == 0:
            return logarithm, exponent
    return None
