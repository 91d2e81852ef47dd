"""A model as one C program for the compiler, to judge the machine code of a composed model by.

The instructions are those that machine code is made of; here a compiler with all its effort puts
them in order and gives the registers away. It takes a second or two for every model.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import PiezoOptError
from piezo_opt.simulation.compiler import load
from piezo_opt.simulation.composed import ComposedEngine

FloatArray = NDArray[np.float64]

(LOAD, ROW, CONSTANT, ADD, SUB, MUL, DIV, MIN, MAX, AND, CLEAR, FLIP, PAIR, QUAD, ROOT,
 COMPARE, LANE, JOIN, LESS_JOIN, JOIN_LESS, CALL, POWER, CALL_FOUR, STORE,
 STORE_ROW) = range(25)  # fmt: skip
"""Operations of ``assembler.h``, in its order."""
_TEXTS: Final = {
    ADD: "{0} + {1}", SUB: "{0} - {1}", MUL: "{0} * {1}", DIV: "{0} / {1}", FLIP: "-{1}",
    MIN: "{0} < {1} ? {0} : {1}", MAX: "{0} > {1} ? {0} : {1}", AND: "{0} ? {1} : 0.0",
    ROOT: "sqrt({0})", JOIN: "{2} + {0} * {1}", LESS_JOIN: "{2} - {0} * {1}",
    JOIN_LESS: "{0} * {1} - {2}", PAIR: "(four){{{0}, {1}, {0}, {1}}}",
    QUAD: "(four){{{0}[0], {0}[1], {1}[2], {1}[3]}}",
}  # fmt: skip
_WIDE: Final = (PAIR, QUAD, CALL_FOUR)
"""Operations that make four numbers of their own."""
_COMPARED: Final = {0x11: "<", 0x12: "<=", 0x00: "==", 0x04: "!=", 0x1E: ">"}
_BASES: Final = {3: "b", 5: "W", 14: "WR"}
_HEAD: Final = """\
#include <math.h>
#include <stdint.h>
typedef double four __attribute__((vector_size(32)));
typedef double one_of(double), one_of_two(double, double), power(double, const void *);
typedef four four_of(four);
#define NUMBER(at) (*(double *)(at))
#define FOUR(at) (*(four *)(at))
"""


def compiled_whole(engine: ComposedEngine, sensitivities: FloatArray) -> ctypes.CDLL:
    """Compile the sub-step of an engine, and let it run that from now on.

    Args:
        engine: a composed model with its directions.
        sensitivities: (n, k) of the states at the start of the runs.

    Returns:
        the library, which must live as long as the engine.

    Raises:
        PiezoOptError: there is no compiler.
        ModelError: there is no machine code here.
    """
    names = ("po_run", "po_read", "po_several")
    lists = engine.instructions(sensitivities)
    text = _HEAD + "".join(map(_function, names, lists))
    library, code = load(text), engine.code(sensitivities)
    if library is None or code is None:
        raise PiezoOptError("Speed is judged by a compiler's code: install gcc or clang.")
    address = [ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0 for name in names]
    code.replace(*address)
    return library


def _function(name: str, instructions: Sequence[Any] | NDArray[Any]) -> str:
    lines = [f"void {name}(char *b, char *W, char *WR)", "{"]
    rows: set[int] = set()
    zeros = {k for k, one in enumerate(instructions) if one["op"] == CONSTANT and one["by"] == 0.0}
    for k, one in enumerate(instructions):
        op, inputs = int(one["op"]), [int(i) for i in one["inputs"] if i >= 0]
        place = f"{_BASES.get(int(one['detail']), 'b')} + {int(one['place'])}"
        said = [f"v{i}" for i in inputs]
        if op < 0:
            continue
        if op == STORE:
            lines.append(f"NUMBER({place}) = {said[0]};")
        elif op == STORE_ROW:
            value = said[0] if inputs[0] in rows else "(four){0}"
            lines.append(f"FOUR({place}) = {value};")
        elif op == LANE:
            lines.append(f"const double v{k} = {said[0]}[{int(one['detail'])}];")
        elif op in (ROW, *_WIDE) or (op not in (LOAD, CONSTANT, COMPARE, AND) and rows & {*inputs}):
            rows.add(k)
            lines.append(f"const four v{k} = {_four(one, op, place, said)};")
        elif op == COMPARE:
            lines.append(f"const int v{k} = {said[0]} {_COMPARED[int(one['detail'])]} {said[1]};")
        else:
            lines.append(f"const double v{k} = {_number(one, op, place, said, zeros)};")
    return "\n    ".join(lines) + "\n}\n"


def _four(one: Any, op: int, place: str, said: Sequence[str]) -> str:
    if op == CALL_FOUR:
        return f"((four_of *)(uintptr_t){_address(one)}u)({said[0]})"
    return f"FOUR({place})" if op == ROW else _TEXTS[op].format(*said)


def _address(one: Any) -> int:
    return int(np.float64(one["by"]).view(np.uint64))


def _number(one: Any, op: int, place: str, said: Sequence[str], zeros: set[int]) -> str:
    if op == LOAD:
        return f"NUMBER({place})"
    if op == CONSTANT:
        return float(one["by"]).hex() if np.isfinite(one["by"]) else f"({one['by']} * INFINITY)"
    if op == CLEAR:  # of the sign, or where a comparison holds
        size = int(one["inputs"][0]) in zeros
        return f"fabs({said[1]})" if size else f"{said[0]} ? 0.0 : {said[1]}"
    if op in (CALL, POWER):
        if op == POWER:
            return f"((power *)(uintptr_t){_address(one)}u)({said[0]}, b + {int(one['place'])})"
        kind = "one_of" if len(said) == 1 else "one_of_two"
        return f"(({kind} *)(uintptr_t){_address(one)}u)({', '.join(said)})"
    return _TEXTS[op].format(*said)
