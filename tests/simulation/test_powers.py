"""Powers, exponentials and logarithms from tables are right to their last digits."""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np
import pytest

from piezo_opt.simulation.compiler import find_compiler, load
from piezo_opt.simulation.forms import with_slopes
from piezo_opt.simulation.functions import c_functions
from piezo_opt.simulation.library import declarations
from piezo_opt.simulation.powers import POWERS

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="compiles C: no compiler")

_EACH = "(long n, double c, const double *x, double *y) {"
_TEXT = f"""#include <math.h>
{POWERS}
void po_run(void) {{}}
void po_all_power{_EACH} const po_powers t = po_powers_of(c);
  for (long i = 0; i < n; ++i) y[i] = po_power(x[i], &t); }}
void po_all_exp{_EACH} for (long i = 0; i < n; ++i) y[i] = po_exp(x[i]); }}
void po_all_log{_EACH} for (long i = 0; i < n; ++i) y[i] = po_log(x[i]); }}
"""


def computed(name: str, at: np.ndarray, exponent: float = 0.0) -> np.ndarray:
    library = load(_TEXT)
    assert library is not None
    function = getattr(library, f"po_all_{name}")
    function.restype = None
    function.argtypes = [ctypes.c_long, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p]
    x, y = np.ascontiguousarray(at, dtype=float), np.empty(at.size)
    function(x.size, exponent, x.ctypes.data, y.ctypes.data)
    return y


@needs_compiler
@pytest.mark.parametrize(
    ("exponent", "error"),
    [(0.0, 0.0), (1e-3, 1e-15), (0.37, 2e-15), (1.0, 1e-15), (2.6, 6e-15), (8.0, 2e-15),
     (-0.5, 2e-15), (-8.0, 2e-13)],
)  # fmt: skip
def test_a_power_is_exact_to_its_last_digits(exponent: float, error: float) -> None:
    random = np.random.default_rng(1)
    near = 1.0 + np.array([-1e-16, -1e-9, 0.0, 1e-15, 1e-9])
    cells = 2.0 ** (np.arange(-70, 70) / 7.0)
    at = np.concatenate([np.exp(random.uniform(-30.0, 30.0, 20_000)), near, cells])
    # Extended precision, and the same argument with more digits than the answer has.
    true = np.power(at.astype(np.longdouble), np.longdouble(exponent))
    assert float(np.abs(computed("power", at, exponent) / true - 1.0).max()) <= error


@needs_compiler
def test_an_exponential_and_a_logarithm_are_exact_to_their_last_digits() -> None:
    random = np.random.default_rng(2)
    at = np.concatenate([random.uniform(-700.0, 708.0, 20_000), random.uniform(-1.0, 1.0, 20_000)])
    true = np.exp(at.astype(np.longdouble))
    assert float(np.abs(computed("exp", at) / true - 1.0).max()) < 4e-16
    sizes = np.exp(random.uniform(-600.0, 600.0, 20_000))
    logs = np.log(sizes.astype(np.longdouble))
    assert float(np.abs((computed("log", sizes) - logs) / logs).max()) < 1e-15
    near = 1.0 + 10.0 ** random.uniform(-17.0, 0.0, 20_000)
    assert np.abs(computed("log", near) - np.log(near)).max() < 2.5e-16


@needs_compiler
def test_what_is_not_finite_is_not_lost() -> None:
    strange = np.array([np.nan, np.inf])
    assert not np.isfinite(computed("power", strange, 0.4)).any()
    assert not np.isfinite(computed("log", strange)).any()
    assert not np.isfinite(computed("exp", np.array([np.nan, np.inf, 710.0]))).any()
    assert (computed("exp", np.array([-np.inf, -1e4])) < 1e-300).all()


def said(expression: ca.SX, before: list[ca.SX], after: list[ca.SX]) -> list[str]:
    """What is computed once a run, and at every call."""
    none = ca.SX(0, 1)
    written = with_slopes(expression, ca.vertcat(*before, none), ca.vertcat(*after, none))
    text = c_functions("f", written)[0].partition("static void f_m_k")[0]
    return text.partition("static const po_word")[0].split("static void f_p(")


def test_only_an_exponent_that_a_run_does_not_change_has_tables() -> None:
    x, n = ca.SX.sym("x"), ca.SX.sym("n")
    power = ca.exp(n * ca.log(x))
    outer, inner = said(power + ca.exp((n + 1.0) * ca.log(x)), [n], [x])
    assert outer.count("po_powers_of") == 2  # one for each exponent
    assert inner.count("po_power(") == 2
    assert " log(" not in inner
    outer, inner = said(power * x + power, [n], [x])
    assert outer.count("po_powers_of") == 1
    outer, inner = said(power, [], [x, n])
    assert "po_power" not in outer + inner
    # A logarithm that is wanted for itself keeps all its digits.
    logarithm = ca.log(x)
    _, inner = said(ca.exp(n * logarithm) + logarithm, [n], [x])
    assert " log(" in inner
    assert "po_log" not in inner


def test_a_division_by_what_is_known_before_the_loop_is_a_product_in_it() -> None:
    x, y, p = (ca.SX.sym(name) for name in "xyp")
    outer, inner = said(ca.vertcat(x / p, (x + 1.0) / p, x / 3.0), [p], [x])
    assert outer.count("1.0 / ") == 2  # of p, and of 3
    assert "/" not in inner
    _, inner = said(x / y, [], [x, y])
    assert "/" in inner


@needs_compiler
@pytest.mark.parametrize("kind", ["power", "softplus"])
def test_derivatives_go_through_what_comes_from_tables(kind: str) -> None:
    """A power by its base and its exponent; the logarithm of one and an exponential."""
    x, n = ca.SX.sym("x"), ca.SX.sym("n")
    forms = {
        "power": ca.exp(n * ca.log(x / 3.0 + 1e-300)),
        "softplus": n * ca.log1p(ca.exp(-x / 3.0)),
    }
    text, _ = c_functions("f", with_slopes(forms[kind], n, x))
    assert "po_p" in text or "po_log" in text
    # Numbers n, x and the result, each with its row behind it.
    library = load(
        f"{declarations()}{text}void po_run(double x, double n, double *Y) {{\n"
        "  static char B[3 * 128] __attribute__((aligned(64))); static double K[400];\n"
        "  static const int A[] = {0, 128, 256};\n"
        "  PO_NUMBER(0) = n, PO_NUMBER(128) = x;\n"
        "  PO_ROWS(0)[0] = (po_row){0.0, 1.0}, PO_ROWS(128)[0] = (po_row){1.0};\n"
        "  f_m_f.prepare(A, B, K); f_m_f.evaluate(A, B, K, 1);\n"
        "  Y[0] = PO_NUMBER(256), Y[1] = PO_ROWS(256)[0][0], Y[2] = PO_ROWS(256)[0][1]; }\n"
    )
    assert library is not None
    library.po_run.restype = None
    library.po_run.argtypes = [ctypes.c_double, ctypes.c_double, ctypes.c_void_p]
    slopes = ca.jacobian(forms[kind], ca.vertcat(x, n))
    exact = ca.Function("g", [x, n], [forms[kind], *ca.horzsplit(slopes)])
    for at, exponent in ((0.02, 0.4), (1.0, 1.0), (2.999, 0.7), (40.0, 2.3)):
        found = np.empty(3)
        library.po_run(at, exponent, found.ctypes.data)
        np.testing.assert_allclose(
            found, [float(one) for one in exact(at, exponent)], rtol=2e-14, atol=4e-16
        )
