"""Every operation that can be written as C computes in C what it computes in CasADi."""

from __future__ import annotations

import ctypes
import math

import casadi as ca
import numpy as np
import pytest

from piezo_opt.simulation.compiler import find_compiler, load
from piezo_opt.simulation.emit import BINARY, UNARY, emit

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="compiles C: no compiler")

# Points inside the domain of the operation; a comparison needs both orders and equality.
_PAIRS = [(0.3, 0.7), (0.7, 0.3), (0.5, 0.5), (1.0, 0.0), (0.0, 0.0), (2.5, 1.2)]
_SIGNED = [(-0.3, 0.7), (0.7, -0.3), (-2.5, -1.2)]
_POWERS = {ca.OP_POW, ca.OP_CONSTPOW}
_INSIDE = {ca.OP_ASIN, ca.OP_ACOS, ca.OP_ATANH, ca.OP_LOG1P}
_POSITIVE = {ca.OP_LOG, ca.OP_SQRT}
_ABOVE_ONE = {ca.OP_ACOSH}


def _points(op: int) -> list[tuple[float, float]]:
    if op in _POSITIVE:
        return [(0.3, 0.0), (2.0, 0.0), (700.0, 0.0)]
    if op in _ABOVE_ONE:
        return [(1.1, 0.0), (3.0, 0.0)]
    if op in _INSIDE:
        return [(-0.9, 0.0), (0.0, 0.0), (1e-12, 0.0), (0.4, 0.0)]
    if op in UNARY:
        return [(x, 0.0) for x in (-2.5, -0.3, 0.3, 1.0, 2.5)]
    # a/0 and fmod(a, 0) are not numbers; powers of negative numbers neither.
    pairs = [p for p in _PAIRS if p[1] != 0.0 or op not in (ca.OP_DIV, ca.OP_FMOD)]
    pairs = [p for p in pairs if p[1] != 0.0 or op != ca.OP_REMAINDER]
    return pairs if op in _POWERS else [*pairs, *_SIGNED]


@needs_compiler
def test_every_operation_equals_casadis() -> None:
    lines = ["#include <math.h>"]
    functions: dict[int, ca.Function] = {}
    for op in sorted(op for op in (*BINARY, *UNARY) if op >= 0):
        x, y = ca.SX.sym("x"), ca.SX.sym("y")
        # The power with a constant exponent arises where the exponent is a number.
        given = ca.SX(2.7) if op == ca.OP_CONSTPOW else y
        said = ca.SX.binary(op, x, given) if op in BINARY else ca.SX.unary(op, x)
        function = ca.Function(f"f{op}", [x, y], [said])
        present = {function.instruction_id(k) for k in range(function.n_instructions())}
        # Assignment is the one that CasADi never keeps.
        assert op in present or op == ca.OP_ASSIGN, f"operation {op} was simplified away"
        block = emit(function, ["x", "y"], [0, 0], "a", 1)
        lines.append(f"double po_f{op}(double x_0, double y_0) {{ {''.join(block.levels[0])}")
        lines.append(f"  return {block.outputs[0][0]}; }}")
        functions[op] = function
    lines.append("void po_run(void) {}")
    library = load("\n".join(lines))
    assert library is not None
    for op, function in functions.items():
        compiled = getattr(library, f"po_f{op}")
        compiled.restype, compiled.argtypes = ctypes.c_double, [ctypes.c_double] * 2
        for a, b in _points(op):
            expected = float(function(a, b))
            assert math.isfinite(expected), f"operation {op} at {a}, {b}: choose another point"
            assert compiled(a, b) == pytest.approx(expected, rel=1e-14, abs=1e-300), (op, a, b)


@needs_compiler
def test_constants_keep_every_digit_and_their_sign() -> None:
    x = ca.SX.sym("x")
    numbers = [0.1, -0.1, 1e-300, -1e300, 2.0**-1074, math.pi, math.inf, -math.inf, 0.0, 12345678.9]
    function = ca.Function("f", [x], [ca.vertcat(*(n + 0 * x * x for n in numbers), *numbers)])
    block = emit(function, ["x"], [0], "a", 1)
    lines = [f"Y[{i}] = {said};" for i, said in enumerate(block.outputs[0])]
    library = load(
        "#include <math.h>\nvoid po_run(double x_0, double *Y) {\n"
        + "\n".join([*block.levels[0], *lines])
        + "}"
    )
    assert library is not None
    out = np.empty(2 * len(numbers))
    library.po_run.argtypes = [ctypes.c_double, ctypes.c_void_p]
    library.po_run(0.0, out.ctypes.data)
    np.testing.assert_array_equal(out, [*numbers, *numbers])


def test_an_operation_without_c_text_is_refused() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(NotImplementedError, match="no C text"):
        emit(ca.Function("f", [x], [ca.erfinv(x)]), ["x"], [0], "a", 1)


def test_what_does_not_change_leaves_the_loop() -> None:
    p, x = ca.SX.sym("p"), ca.SX.sym("x")
    function = ca.Function("f", [p, x], [ca.exp(p) * x + ca.sin(p) * p])
    block = emit(function, ["p", "x"], [0, 1], "a", 2)
    outer, inner = block.levels
    assert sum("exp(" in line or "sin(" in line for line in outer) == 2
    assert len(inner) == 2


def test_a_balance_is_written_as_fused_operations_without_changing_it() -> None:
    a, b, c, d, e = (ca.SX.sym(n) for n in "abcde")
    function = ca.Function("f", [a, b, c, d, e], [a - (b * c + d * e)])
    block = emit(function, list("abcde"), [0] * 5, "v", 1)
    assert not any("+" in line for line in block.levels[0])
    both = b * c + d * e  # needed elsewhere, so it stays
    kept = ca.Function("f", [a, b, c, d, e], [a - both, both])
    assert any("+" in line for line in emit(kept, list("abcde"), [0] * 5, "v", 1).levels[0])
    names = {f"{n}_0": v for n, v in zip("abcde", (1.7, 0.3, -2.0, 5.0, 0.11), strict=True)}
    for line in block.levels[0]:
        name, said = line.removeprefix("const double ").rstrip(";").split(" = ")
        names[name] = eval(said, {}, dict(names))
    expected = 1.7 - (0.3 * -2.0 + 5.0 * 0.11)
    assert names[block.outputs[0][0]] == pytest.approx(expected, rel=1e-15)
