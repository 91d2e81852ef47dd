"""The horizon's quadratic program on its own: what a linear predictive controller solves."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.motion import needs_compiler
from piezo_opt.errors import InputError
from piezo_opt.simulation.compiler import load

FloatArray = NDArray[np.float64]

MOST: Final = 40
"""Iterations at most: Mehrotra's method takes 6 to 16 on the programs of the tests."""
TOLERANCE: Final = 1e-8
"""Sum of those products at the end, as a share of the cost at the start."""
NARROW: Final = 1e-9
"""Limits that are closer together, as a share of their size, are moved apart by it."""
FAR: Final = 1e30
"""A limit that is none."""

ENTRY: Final = """
static long program_size(long n) {
  return n * (long)(SIDES * (sizeof(Side) / sizeof(double)) + (NZ + 2) + 3 + 2 * NZ);
}

long po_program_size(long n) { return program_size(n); }

void po_program(long n, long most, double R, double rho, const double *A, const double *B,
                const double *C, const double *e, const double *q, const double *g,
                const double *limits, double *w, double *work, double *told) {
  const Program m = {n, most, A, B, C, e, q, g, limits, R, rho};
  told[0] = (double)solve_program(&m, w, work, told + 1);
}
"""
"""What Python calls; exported code has none of it."""


@final
@dataclass(frozen=True, eq=False)
class HorizonProgram:
    """A linear system over N stages, followed by one input, with its costs and limits.

        z_k+1 = A_k z_k + B_k w_k,   z_0 = 0,   y_k = C_k z_k
        min  sum q_k/2 (y_k - e_k)^2 + R/2 w_k^2 + g_k w_k

    The last state is the drive. Index k of C, e, q and the limits of drive and output stands for
    the end of period k.

    Attributes:
        a, b, c: (N, n, n), (N, n), (N, n).
        e, q, g: (N,).
        r: R.
        limits: (N, 6) lower and upper of w, drive and output; +-:data:`FAR` for none.
        price: of passing a limit of the output, a unit; above every multiplier it is hard wherever
            it can be kept.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    e: FloatArray
    q: FloatArray
    g: FloatArray
    r: float
    limits: FloatArray
    price: float = 1e3


@final
@dataclass(frozen=True, eq=False)
class Moves:
    """The answer: w (N,), iterations (0 where no limit matters), what the last one left open."""

    w: FloatArray
    iterations: int
    gap: float


def solve_program(program: HorizonProgram, start: FloatArray | None = None) -> Moves:
    """Solve a horizon's program by an interior-point method with Riccati's recursion.

    Args:
        program: the program.
        start: (N,) w to begin with; zeros unless given.

    Raises:
        InputError: shapes that do not match, crossed limits, or numbers that are not finite.
    """
    n, nz = program.b.shape
    shapes = {
        "a": (program.a, (n, nz, nz)), "c": (program.c, (n, nz)), "e": (program.e, (n,)),
        "q": (program.q, (n,)), "g": (program.g, (n,)), "limits": (program.limits, (n, 6)),
    }  # fmt: skip
    for name, (value, shape) in shapes.items():
        if value.shape != shape or not np.isfinite(value).all():
            raise InputError(f"{name}: give finite numbers of the shape {shape}")
    if not program.r > 0.0 or (program.q < 0.0).any() or not program.price > 0.0:
        raise InputError("r and price are positive, q is not negative")
    if (program.limits[:, ::2] >= program.limits[:, 1::2]).any():
        raise InputError("a lower limit is not below its upper one")
    library = program_library(nz)
    w = np.zeros(n) if start is None else np.array(start, dtype=float)
    work, told = np.zeros(library.po_program_size(n)), np.zeros(2)
    given = [
        np.ascontiguousarray(x, dtype=float)
        for x in (program.a, program.b, program.c, program.e, program.q, program.g, program.limits)
    ]
    library.po_program(
        n, MOST, program.r, program.price, *(x.ctypes.data for x in (*given, w, work, told))
    )
    if told[0] < 0:
        raise InputError("The program's numbers left the range of floating point: scale it.")
    return Moves(w, int(told[0]), float(told[1]))


def program_text(states: int) -> str:
    """C text of the program for so many states, the drive among them."""
    source = resources.files(__package__).joinpath("horizon.c").read_text(encoding="utf-8")
    numbers = f"#define TOLERANCE {TOLERANCE!r}\n#define NARROW {NARROW!r}\n"
    return f"#include <math.h>\n#define NZ {states}\n{numbers}{source}{ENTRY}"


@cache
def program_library(states: int) -> ctypes.CDLL:
    """The compiled program."""
    library = load(program_text(states) + "\nvoid po_run(void) {}\n")
    if library is None:
        raise needs_compiler("Predictive control")
    typed(library)
    return library


def typed(library: ctypes.CDLL) -> None:
    """Argument types of the program's functions."""
    library.po_program.argtypes = [
        ctypes.c_long, ctypes.c_long, ctypes.c_double, ctypes.c_double, *[ctypes.c_void_p] * 10,
    ]  # fmt: skip
    library.po_program.restype = None
    library.po_program_size.argtypes = [ctypes.c_long]
    library.po_program_size.restype = ctypes.c_long
