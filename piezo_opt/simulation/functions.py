"""The functions of an effect's form as C: one without derivatives, one with the rows of them.

Each is in two halves: what follows from the parameters alone is computed once a run and kept, the
rest at every call. A row of derivatives is the sum of local derivatives times the rows of what the
function reads (Griewank & Walther 2008, Evaluating Derivatives, 2nd ed., ch. 3).

The second half is written twice, as C and as a list of words, of which machine code is made for
the operations of a whole model together (see ``machine.h``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import casadi as ca

from piezo_opt.simulation.emit import number, pattern
from piezo_opt.simulation.forms import Written
from piezo_opt.simulation.instructions import (
    LOG_ABOVE,
    POWER,
    TANH,
    Instruction,
    fused,
    instructions,
    known_at,
    quick,
)

_TABLE: Final = 169
"""Numbers in the tables of one power (see powers.py)."""
_WORDS: Final[Mapping[int, str]] = {
    ca.OP_ADD: "ADD", ca.OP_SUB: "SUB", ca.OP_MUL: "MUL", ca.OP_DIV: "DIV", ca.OP_FMIN: "MIN",
    ca.OP_FMAX: "MAX", ca.OP_LT: "LESS", ca.OP_LE: "AT_MOST", ca.OP_EQ: "EQUAL",
    ca.OP_NE: "UNEQUAL", ca.OP_AND: "AND", ca.OP_OR: "OR", ca.OP_NOT: "NOT",
    ca.OP_IF_ELSE_ZERO: "WHERE", ca.OP_NEG: "MINUS", ca.OP_SQ: "SQUARE", ca.OP_TWICE: "TWICE",
    ca.OP_INV: "INVERSE", ca.OP_SQRT: "ROOT", ca.OP_FABS: "SIZE", ca.OP_SIGN: "SIGN",
    ca.OP_ASSIGN: "SAME",
}  # fmt: skip
"""Operations that a processor has instructions for; the rest is called."""


def c_functions(
    symbol: str, function: Written, stepped: bool = True
) -> tuple[str, tuple[int, int]]:
    """C text of a form's function, and how many numbers its two preparations keep.

    Args:
        symbol: name of the C functions, which get ``_p`` and ``_m`` behind it.
        function: the expressions.
        stepped: whether they are asked within a sub-step; else the words say only what follows
            what.

    Raises:
        NotImplementedError: an operation that has no C text.
    """
    plain, few = _half(f"{symbol}_p", function.plain, (), stepped)
    moved, many = _half(f"{symbol}_m", function.moved, function.places, stepped)
    return plain + moved, (few, many)


def _half(
    symbol: str, function: ca.Function, places: Sequence[tuple[int, int]], stepped: bool
) -> tuple[str, int]:
    program = quick(fused(instructions(function)), (0, 1), tables=True)
    level = known_at(program, (0, 1))
    np_, nz, count = function.numel_in(0), function.numel_in(1), function.numel_out(0)
    text: dict[int, str] = {}
    ends: list[list[int]] = [[-1] * function.numel_out(i) for i in range(function.n_out())]
    before: list[str] = []
    after: list[tuple[int, str]] = []
    for k, one in program.items():
        if one.op == ca.OP_OUTPUT:
            ends[one.place[0]][one.place[1]] = one.inputs[0]
        elif one.op == ca.OP_INPUT:
            index = one.place[0] * np_ + one.place[1]
            text[k] = f"a{k}"
            line = f"const double a{k} = PO_NUMBER(A[{index}]);"
            after.append((k, line))
            before += [] if one.place[0] else [line]
        elif one.op == ca.OP_CONST:
            text[k] = number(one.constant)
        else:
            text[k] = f"a{k}"
            said = [text[i] for i in one.inputs]
            if one.op == POWER:
                line = f"const double a{k} = po_power({said[0]}, (const po_powers *)(K + @));"
            else:
                line = f"const double a{k} = {pattern(one.op).format(*said)};"
            if level[k]:
                after.append((k, line))
            else:
                before.append(line)
    roots = [k for output in ends for k in output if k >= 0]
    used = _used(program, level, roots)
    kept, tables, room = _kept(program, level, used)
    keep = [f"K[{at}] = a{k};" for k, at in kept.items()]
    body = [f"const double a{k} = K[{at}];" for k, at in kept.items()]
    for exponent, at in tables.items():
        keep.append(
            f"{{ const po_powers t = po_powers_of({text[exponent]}); "
            f"memcpy(K + {at}, &t, sizeof t); }}"
        )
    for k, line in after:
        if k in used:
            power = program[k].op == POWER
            body.append(line.replace("@", str(tables[program[k].inputs[1]])) if power else line)
    said = ["0.0" if k < 0 else text[k] for k in ends[0]]
    body += [f"PO_NUMBER(A[{np_ + nz + i}]) = {one};" for i, one in enumerate(said)]
    if len(ends) > 1:
        body += _rows([text[k] for k in ends[1]], places, np_ + nz, count)
    words = _words(program, used if stepped else set(), kept, tables, ends, places, np_)
    first = "\n    ".join([*before, *keep]) if keep else ""
    return (
        f"static void {symbol}_k(const int *A, const char *B, double *K)\n{{\n    {first}\n}}\n"
        f"static void {symbol}(const int *A, char *B, const double *K, long N)\n"
        "{\n    " + "\n    ".join(body) + "\n}\n"
        f"static const po_word {symbol}_w[] = {{\n    {words}\n}};\n"
        f"const po_function {symbol}_f = {{{symbol}_k, {symbol}, {symbol}_w}};\n"
    ), room


def _used(
    program: Mapping[int, Instruction], level: Mapping[int, int], roots: Sequence[int]
) -> set[int]:
    """What is needed at every call, down to what was known before."""
    found: set[int] = set()
    left = list(roots)
    while left:
        k = left.pop()
        if k not in found:
            found.add(k)
            if program[k].op == POWER:
                left.append(program[k].inputs[0])
            elif level[k]:
                left += program[k].inputs
    return found


def _kept(
    program: Mapping[int, Instruction], level: Mapping[int, int], used: set[int]
) -> tuple[dict[int, int], dict[int, int], int]:
    """Where numbers that the parameters decide are kept, and tables by their exponents."""
    kept: dict[int, int] = {}
    tables: dict[int, int] = {}
    room = 0
    for k, one in program.items():
        if k in used and level[k] == 0 and one.op not in (ca.OP_INPUT, ca.OP_CONST):
            kept[k] = room
            room += 1
        elif k in used and one.op == POWER and one.inputs[1] not in tables:
            tables[one.inputs[1]] = room
            room += _TABLE
    return kept, tables, room


def _words(
    program: Mapping[int, Instruction], used: set[int], kept: Mapping[int, int],
    tables: Mapping[int, int], ends: Sequence[Sequence[int]], places: Sequence[tuple[int, int]],
    parameters: int,
) -> str:  # fmt: skip
    """The same as words, each of which may name earlier ones by their numbers."""
    words: list[str] = []
    at = {-1: 0}

    def say(*parts: object) -> int:
        words.append("{PO_" + ", ".join(map(str, parts)) + "}")
        return len(words) - 1

    say("CONSTANT", 0, 0, 0.0)
    for k, one in program.items():
        if k not in used:
            continue
        inputs = [at[i] for i in one.inputs if i in at] if one.op == POWER or k not in kept else []
        if k in kept:
            at[k] = say("KEPT", kept[k])
        elif one.op == ca.OP_INPUT:
            at[k] = say("READ", one.place[0] * parameters + one.place[1])
        elif one.op == ca.OP_CONST:
            at[k] = say("CONSTANT", 0, 0, number(one.constant))
        elif one.op == POWER:
            at[k] = say("POWER", inputs[0], tables[one.inputs[1]], 0, "(po_any *)po_power")
        elif one.op in _WORDS:
            at[k] = say(_WORDS[one.op], *inputs)
        elif one.op == LOG_ABOVE:
            one_more = say("ADD", inputs[0], say("CONSTANT", 0, 0, 1.0))
            at[k] = say("CALL", one_more, "PO_OTHER", 0, "(po_any *)po_log")
        else:
            name = pattern(one.op).partition("(")[0]
            kind = "CALL" if len(inputs) == 1 else "CALL_TWO"
            other = "PO_TANH" if one.op == TANH else inputs[1] if len(inputs) == 2 else 0
            at[k] = say(kind, inputs[0], other, 0, f"(po_any *){name}")
    for i, k in enumerate(ends[0]):
        say("OUTPUT", at.get(k, 0), i)
    for k, (output, column) in zip(ends[1] if len(ends) > 1 else (), places, strict=True):
        # Number, input and, as a number, the output.
        say("SLOPE", at.get(k, 0), column, float(output))
    say("END")
    return ",\n    ".join(words)


def _rows(
    slopes: Sequence[str], places: Sequence[tuple[int, int]], inputs: int, outputs: int
) -> list[str]:
    """Lines that make the rows of the outputs."""
    read = sorted({column for _, column in places})
    lines = [f"const double j{k} = {text};" for k, text in enumerate(slopes)]
    lines += [f"const po_row *const r{i} = PO_ROWS(A[{i}]);" for i in read]
    lines += [f"po_row *const o{i} = PO_ROWS(A[{inputs + i}]);" for i in range(outputs)]
    lines.append("for (long g = 0; g < N; ++g) {")
    for i in range(outputs):
        terms = [f"j{k} * r{c}[g]" for k, (row, c) in enumerate(places) if row == i]
        lines.append(f"    const po_row s{i} = {' + '.join(terms) or '(po_row){0}'};")
    lines += [f"    o{i}[g] = s{i};" for i in range(outputs)]
    lines.append("}")
    return lines
