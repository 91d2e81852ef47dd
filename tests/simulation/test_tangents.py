"""Tangents written as C are the derivatives that CasADi finds, in every lane of every group."""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np
import pytest

from piezo_opt.simulation.compiler import find_compiler, load
from piezo_opt.simulation.emit import BINARY, UNARY, emit
from piezo_opt.simulation.tangents import _SLOPES, TYPES, Carried, Lanes, Tangents
from tests.simulation.test_emit import _points

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="compiles C: no compiler")

_STEPS = {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_FLOOR, ca.OP_CEIL,
          ca.OP_NOT, ca.OP_SIGN}  # fmt: skip
"""Operations whose derivative is zero wherever they have one."""


def _seeded(lanes: Lanes, along_x: list[float], along_y: list[float]) -> Tangents:
    """Tangents of a function of x and y, each of which moves along every direction so much."""
    groups = lanes.groups

    def seed(amounts: list[float]) -> tuple[Carried | None, ...]:
        parts = [[amounts[k] for k in group] for group in groups]
        return tuple(
            Carried(lanes.literal(g, [repr(a) for a in part]), 0) if any(part) else None
            for g, part in enumerate(parts)
        )

    return Tangents(lanes, {(0, 0): seed(along_x), (1, 0): seed(along_y)}, "v")


@needs_compiler
@pytest.mark.parametrize("directions", [1, 2, 3, 4, 5])
def test_the_tangent_of_every_operation_is_casadis_derivative(directions: int) -> None:
    along_x, along_y = [1.0, 0.0, -0.5, 2.0, 0.3][:directions], [0.0, 1.0, 0.7, -1.0, 0.2]
    lanes = Lanes.of([(False,)] * directions)
    lines = ["#include <math.h>", TYPES]
    slopes: dict[int, ca.Function] = {}
    for op in (*BINARY, *UNARY):
        x, y = ca.SX.sym("x"), ca.SX.sym("y")
        given = ca.SX(2.7) if op == ca.OP_CONSTPOW else y
        said = ca.SX.binary(op, x, given) if op in BINARY else ca.SX.unary(op, x)
        function = ca.Function(f"f{op}", [x, y], [said])
        tangents = _seeded(lanes, along_x, along_y)
        block = emit(function, ["x", "y"], [0, 0], "a", 1, tangents)
        lines.append(f"void po_f{op}(double x_0, double y_0, double *J) {{")
        lines += block.levels[0]
        for g, group in enumerate(lanes.groups):
            text = block.tangents[0][0][g] or lanes.literal(g, ["0.0"])
            lines.append(f"{lanes.kind(g)} J{g} = {text};")
            lines += [f"J[{k}] = {lanes.entry(g, f'J{g}', lane)};" for lane, k in enumerate(group)]
        lines.append("}")
        slopes[op] = ca.Function(f"d{op}", [x, y], [ca.jacobian(said, ca.vertcat(x, y))])
    lines.append("void po_run(void) {}")
    library = load("\n".join(lines))
    assert library is not None
    for op, slope in slopes.items():
        compiled = getattr(library, f"po_f{op}")
        compiled.restype, compiled.argtypes = None, [ctypes.c_double] * 2 + [ctypes.c_void_p]
        for a, b in _points(op):
            found, both = np.full(directions, np.nan), np.array(slope(a, b)).ravel()
            if not np.isfinite(both).all():
                continue
            compiled(a, b, found.ctypes.data)
            expected = [both @ pair for pair in zip(along_x, along_y, strict=False)]
            np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-15, err_msg=f"{op}")


def test_every_operation_has_a_slope_or_is_a_step() -> None:
    assert set(_SLOPES) | _STEPS == set(BINARY) | set(UNARY)
    assert not set(_SLOPES) & _STEPS


def test_directions_that_move_the_same_share_a_register() -> None:
    nothing, all_, last = (False, False), (True, True), (False, True)
    lanes = Lanes.of([last, all_, nothing, last, all_, last, last])
    assert lanes.groups == ((2, 0, 3, 5), (6, 1, 4))
    assert [lanes.kind(0), lanes.kind(1), Lanes.of([last]).kind(0)] == ["po_v4", "po_v4", "double"]


def test_only_what_moves_is_written_and_what_stands_leaves_the_loop() -> None:
    p, x = ca.SX.sym("p"), ca.SX.sym("x")
    function = ca.Function("f", [p, x], [ca.exp(p) * x + ca.sin(x)])
    lanes = Lanes.of([(False,), (False,)])
    unit = Carried(lanes.literal(0, ["1.0", "0.0"]), 0)
    moving = Tangents(lanes, {(0, 0): (unit,)}, "v")
    outer, inner = emit(function, ["p", "x"], [0, 1], "a", 2, moving).levels
    assert sum("po_v2" in line for line in outer) == 1  # exp(p) moves with p alone
    assert sum("po_v2" in line for line in inner) == 1  # and takes x with it; sin(x) stands still
    still = emit(function, ["p", "x"], [0, 1], "a", 2, Tangents(lanes, {}, "v"))
    assert still.tangents == (((None,),),)
    assert not any("po_v2" in line for part in still.levels for line in part)
