"""The functions of an effect's form as C: one without derivatives, one with the rows of them.

Each is in two halves: what follows from the parameters alone is computed once a run and kept, the
rest at every call. A row of derivatives is the sum of local derivatives times the rows of what the
function reads (Griewank & Walther 2008, Evaluating Derivatives, 2nd ed., ch. 3).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import casadi as ca

from piezo_opt.simulation.emit import emit
from piezo_opt.simulation.forms import Written

_TABLE: Final = 169
"""Numbers in the tables of one power (see powers.py)."""


def c_functions(symbol: str, function: Written) -> tuple[str, tuple[int, int]]:
    """C text of a form's function, and how many numbers its two preparations keep.

    Args:
        symbol: name of the C functions, which get ``_p`` and ``_m`` behind it.
        function: the expressions.

    Raises:
        NotImplementedError: as :func:`piezo_opt.simulation.emit.emit`.
    """
    plain, few = _half(f"{symbol}_p", function.plain, ())
    moved, many = _half(f"{symbol}_m", function.moved, function.places)
    return plain + moved, (few, many)


def _half(symbol: str, function: ca.Function, places: Sequence[tuple[int, int]]) -> tuple[str, int]:
    block = emit(function, ("p", "z"), (0, 1), "a", 2)
    np_, nz = function.numel_in(0), function.numel_in(1)
    count = function.numel_out(0)
    deep = [*block.levels[1], *(text for output in block.outputs for text in output)]
    used = set(re.findall(r"\w+", "\n".join(deep)))
    lines = list(deep[: len(block.levels[1])])
    outputs = [list(texts) for texts in block.outputs]
    before = [f"const double p_{i} = PO_NUMBER(A[{i}]);" for i in range(np_)]
    after = [
        f"const double z_{i} = PO_NUMBER(A[{np_ + i}]);" for i in range(nz) if f"z_{i}" in used
    ]
    after += [f"const double p_{i} = PO_NUMBER(A[{i}]);" for i in range(np_) if f"p_{i}" in used]
    keep: list[str] = []
    kept = 0
    for line in block.levels[0]:
        before.append(line)
        kind, name = line.split()[1:3]
        if name not in used:
            continue
        if kind == "double":
            keep.append(f"K[{kept}] = {name};")
            after.append(f"const double {name} = K[{kept}];")
            kept += 1
        else:
            keep.append(f"memcpy(K + {kept}, &{name}, sizeof({kind}));")
            lines = [text.replace(f"&{name})", f"(const {kind} *)(K + {kept}))") for text in lines]
            kept += _TABLE
    stores = [f"PO_NUMBER(A[{np_ + nz + i}]) = {outputs[0][i]};" for i in range(count)]
    body = [*after, *lines, *stores]
    if len(block.outputs) > 1:
        body += _rows(outputs[1], places, np_ + nz, count)
    first = "\n    ".join([*before, *keep]) if keep else ""
    text = (
        f"static void {symbol}_k(const int *A, const char *B, double *K)\n{{\n    {first}\n}}\n"
        f"static void {symbol}(const int *A, char *B, const double *K, long N)\n"
        "{\n    " + "\n    ".join(body) + "\n}\n"
        f"const po_function {symbol}_f = {{{symbol}_k, {symbol}}};\n"
    )
    return text, kept


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
