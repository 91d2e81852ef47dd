"""What a model does over one sampling period, as C, with exact tangents along with it.

A held drive goes to its new value within the first :data:`RISE` of a period and stays there. Both
stretches are taken by classical Runge-Kutta steps; every step carries the derivatives of the state
by whatever the caller seeds, exactly (the steps' own derivatives, not those of the equation).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.errors import InputError
from piezo_opt.keeping import digest
from piezo_opt.simulation.compiler import load
from piezo_opt.simulation.emit import LANE, emit
from piezo_opt.symbolic import one_at_a_time

FloatArray = NDArray[np.float64]

SOURCE: Final = digest(Path(__file__).read_bytes())
"""By which a compiled program knows whether these lines are still the ones it was written with."""

RISE = 0.02
"""Share of a period in which the held drive goes to its next value. A hysteresis law moves with the
drive's rate, which a jump does not have; a loop without rate dependence ends at the same place
whatever the share."""

TURN = 0.5
"""Most that the fastest pole turns in one Runge-Kutta step [rad]: its error is then below
0.5^5 / 120, 3e-4 of what moves."""

FEWEST = 2
"""Steps of the held stretch at least."""

SHORTEST_RISE = 4
"""Steps of the rise at least: where the loop's displacement changes its sign on the way its law has
a corner, and two steps leave 1e-4 of the stroke there."""


@final
@dataclass(frozen=True)
class Steps:
    """How many Runge-Kutta steps the rise and the held stretch of a period take."""

    rise: int
    held: int

    @staticmethod
    def of(fastest: float, period: float) -> Steps:
        """For a fastest pole [rad/s]: none of them turns by more than :data:`TURN` in a step."""
        turned = fastest * period
        return Steps(
            max(SHORTEST_RISE, int(np.ceil(RISE * turned / TURN))),
            max(FEWEST, int(np.ceil(turned / TURN))),
        )


def fastest_pole(system: System, p: FloatArray, drive: float = 0.0) -> float:
    """Largest modulus [rad/s] of the poles at rest at a drive, the drive still."""
    n = len(system.state_names)
    if n == 0:
        return 0.0
    x, u = ca.SX.sym("x", n), ca.SX.sym("u")
    none = ca.SX(0, 1)
    rate = system.rate(0.0, x, u, 0.0, none, none, p)
    slope = ca.Function("slope", [x, u], [ca.jacobian(rate, x)])
    rest = system.start(0.0, drive, np.zeros(0), p, np.zeros(n))
    return float(np.abs(np.linalg.eigvals(np.asarray(slope(rest, drive), dtype=float))).max())


LANES: Final = 4
"""Derivatives side by side in a register."""

LANE_TEXT: Final = f"""
typedef double lane __attribute__((vector_size({8 * LANES})));
static const lane none = {{0.0}};
static inline lane taken_up(const double *from) {{
  lane one;
  memcpy(&one, from, sizeof one);
  return one;
}}
static inline void put_down(double *to, lane one) {{ memcpy(to, &one, sizeof one); }}
"""


def c_function(
    name: str, function: ca.Function, wide: Sequence[int] = (), made_wide: Sequence[int] = (),
    lanes: int = 0,
) -> str:  # fmt: skip
    """An SX function of dense columns as straight-line C: arrays in, then arrays out.

    Args:
        name: of the function.
        function: the function.
        wide, made_wide: inputs and outputs of which each element is a row of derivatives.
        lanes: registers that such a row takes.
    """
    names = [f"i{k}" for k in range(function.n_in())]
    block = emit(function, names, [0] * function.n_in(), "w", 1, wide)
    given = [f"const double *{n}_" for n in names]
    made = [f"double *o{k}_" for k in range(function.n_out())]
    lines, row = [], LANES * lanes
    for k, n in enumerate(names):
        for i in range(function.numel_in(k)):
            if k in wide:
                lines.append(f"const lane {n}_{i}{LANE} = taken_up({n}_ + {row * i} + {LANE});")
            else:
                lines.append(f"const double {n}_{i} = {n}_[{i}];")
    lines += block.levels[0]
    # Whatever is read has been read: an output may take the place of an input.
    after = []
    for k, outputs in enumerate(block.outputs):
        for i, text in enumerate(outputs):
            if k in made_wide:
                kept = text if LANE in text else f"none + {text}"
                lines.append(f"const lane o{k}_{i}{LANE} = {kept};")
                after.append(f"put_down(o{k}_ + {row * i} + {LANE}, o{k}_{i}{LANE});")
            else:
                lines.append(f"const double o{k}_{i} = {text};")
                after.append(f"o{k}_[{i}] = o{k}_{i};")
    whole = [f"static void {name}({', '.join(given + made)}) {{"]
    for line in (*lines, *after):
        many = range(lanes) if LANE in line else range(1)
        whole += [line.replace(f"+ {LANE}", f"+ {LANES * c}").replace(LANE, f"_{c}") for c in many]
    return "\n".join([*whole, "}", ""])


def along(value: ca.SX, by: ca.SX, seeds: ca.SX) -> ca.SX:
    """Derivatives (rows of ``value``, columns of seeds) as one column, row after row."""
    moved = ca.jtimes(value, by, seeds) if by.numel() else ca.SX(value.numel(), seeds.size2())
    return ca.densify(ca.vec(moved.T))


def _rows(name: str, rows: int, columns: int) -> tuple[ca.SX, ca.SX]:
    """A column of symbols, and the same as a matrix, row after row."""
    flat = ca.SX.sym(name, rows * columns)
    return flat, ca.reshape(flat, columns, rows).T


def period_text(system: System, directions: int) -> str:
    """C text of one period and of the reading, with tangents along so many directions, or without.

    ``period(p, t, before, BEFORE, after, AFTER, T, rise, held, x, X)`` moves ``x`` and ``X`` (row
    after row) on; ``reading(p, t, x, X, u, U, y, Y)`` reads them. Where X is null there are no
    tangents. Directions whose number is a
    multiple of :data:`LANES` are carried so many at a time.
    """
    nx, np_, lanes = len(system.state_names), len(system.parameter_names), directions // LANES
    if directions % LANES:
        lanes = 0
    nd = 1 if lanes else directions
    t, u, du, h = (ca.SX.sym(k) for k in ("t", "u", "du", "h"))
    x, p, none = ca.SX.sym("x", nx), ca.SX.sym("p", np_), ca.SX(0, 1)
    flat_x, seed_x = _rows("X", nx, nd)
    flat_u, seed_u = _rows("U", 1, nd)
    flat_du, seed_du = _rows("DU", 1, nd)
    parts = [LANE_TEXT] if lanes else []

    def written(function: ca.Function, wide: tuple[int, ...]) -> str:
        """The function, and the same without tangents."""
        name, given = function.name(), function.sx_in()
        alone = [one for k, one in enumerate(given) if k not in wide]
        value = function.call(given, True, False)[0]
        return c_function(name, function, *((wide, (1,), lanes) if lanes else ())) + c_function(
            f"{name}alone", ca.Function(f"{name}alone", alone, [value])
        )

    for name, slope in (("rising_", du), ("holding_", ca.SX(0.0))):
        moved = _step(system, x, t, u, slope, h, p)
        by, seeds = ca.vertcat(x, u, du), ca.vertcat(seed_x, seed_u, seed_du)
        inputs = [t, x, flat_x, u, flat_u, du, flat_du, h, p]
        outputs = [ca.densify(moved), along(moved, by, seeds)]
        parts.append(written(ca.Function(name, inputs, outputs), (2, 4, 6)))
    by, seeds = ca.vertcat(x, u), ca.vertcat(seed_x, seed_u)
    inputs = [t, x, flat_x, u, flat_u, p]
    if system.becomes is not None:
        moved = system.becomes(t, x, u, du, none, p)
        ends = [*inputs[:-1], du, p]
        settle = ca.Function("settling_", ends, [ca.densify(moved), along(moved, by, seeds)])
        parts.append(written(settle, (2, 4)))
    y = system.reading(t, x, u, 0.0, none, none, p)
    read = ca.Function("reading_", inputs, [ca.densify(y), along(y, by, seeds)])
    parts.append(written(read, (2, 4)))
    settled = (
        "if (X) settling_(&t, x, X, &after, AFTER, &du, p, x, X);\n"
        "  else settling_alone(&t, x, &after, &du, p, x);"
        if system.becomes is not None
        else ""
    )
    whole = "\n".join(["#include <math.h>\n#include <string.h>", *parts, _PERIOD])
    return whole.replace("@ND", str(max(directions, 1))).replace("@SETTLED", settled)


def _step(
    system: System, x: ca.SX, t: ca.SX, u: ca.SX, du: ca.SX, h: ca.SX, p: ca.SX
) -> ca.SX:  # fmt: skip
    """One classical Runge-Kutta step of the state."""
    none = ca.SX(0, 1)

    def rate(at: ca.SX, since: ca.SX | float) -> ca.SX:
        return system.rate(t + since, at, u + du * since, du, none, none, p)

    k1 = rate(x, 0.0)
    k2 = rate(x + h / 2.0 * k1, h / 2.0)
    k3 = rate(x + h / 2.0 * k2, h / 2.0)
    k4 = rate(x + h * k3, h)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


_PERIOD = f"""
static void period(const double *p, double t, double before, const double *BEFORE, double after,
                   const double *AFTER, double T, long rise, long held, double *x, double *X) {{
  const double up = {RISE!r} * T;
  double du = (after - before) / up, DU[@ND], U[@ND], h = up / rise;
  for (int d = 0; X && d < @ND; ++d) DU[d] = (AFTER[d] - BEFORE[d]) / up;
  for (long k = 0; k < rise; ++k) {{
    const double s = k * h, at = t + s, u = before + du * s;
    if (!X) {{
      rising_alone(&at, x, &u, &du, &h, p, x);
      continue;
    }}
    for (int d = 0; d < @ND; ++d) U[d] = BEFORE[d] + DU[d] * s;
    rising_(&at, x, X, &u, U, &du, DU, &h, p, x, X);
  }}
  t += up;
  @SETTLED
  h = (T - up) / held;
  du = 0.0;
  for (int d = 0; d < @ND; ++d) DU[d] = 0.0;
  for (long k = 0; k < held; ++k) {{
    const double at = t + k * h;
    if (X) holding_(&at, x, X, &after, AFTER, &du, DU, &h, p, x, X);
    else holding_alone(&at, x, &after, &du, &h, p, x);
  }}
  t += T - up;
  @SETTLED
}}
static void reading(const double *p, double t, const double *x, const double *X, double u,
                    const double *U, double *y, double *Y) {{
  if (X) reading_(&t, x, X, &u, U, p, y, Y);
  else reading_alone(&t, x, &u, p, y);
}}
"""

_ADVANCE = """
double po_run(const double *p, double t, double before, double after, double T, long rise,
              long held, double *x) {
  double y;
  period(p, t, before, 0, after, 0, T, rise, held, x, 0);
  reading(p, t + T, x, 0, after, 0, &y, 0);
  return y;
}
"""


@lru_cache(maxsize=64)
@one_at_a_time
def advance_library(system: System) -> ctypes.CDLL | None:
    """A library whose ``po_run`` moves a plant on by one period; None without a compiler."""
    library = load(
        f"advance {SOURCE} {system.recipe}",
        lambda _: period_text(system, 0) + _ADVANCE,
    )
    if library is not None:
        number = ctypes.c_double
        library.po_run.argtypes = [
            ctypes.c_void_p, number, number, number, number, ctypes.c_long, ctypes.c_long,
            ctypes.c_void_p,
        ]  # fmt: skip
        library.po_run.restype = number
    return library


@lru_cache(maxsize=64)
@one_at_a_time
def advance_function(system: System, rise: int, held: int) -> ca.Function:
    """The same period on CasADi's virtual machine: ``(x, t, before, after, T, p) -> (x, y)``."""
    n, none = len(system.state_names), ca.SX(0, 1)
    x, p = ca.SX.sym("x", n), ca.SX.sym("p", len(system.parameter_names))
    t, before, after, period = (ca.SX.sym(k) for k in ("t", "before", "after", "period"))
    up = RISE * period
    slope, now, clock = (after - before) / up, x, t
    for count, length, base, du in ((rise, up, before, slope), (held, period - up, after, 0.0)):
        h = length / count
        for k in range(count):
            now = _step(system, now, clock + k * h, base + du * k * h, ca.SX(du), h, p)
        clock = clock + length
        if system.becomes is not None:
            now = system.becomes(clock, now, after, du, none, p)
    y = system.reading(t + period, now, after, 0.0, none, none, p)
    return ca.Function("period", [x, t, before, after, period, p], [now, y])


def needs_compiler(what: str) -> InputError:
    """The sentence for what takes compiled code where there is no compiler."""
    return InputError(
        f"{what} runs compiled code, and no C compiler was found: install gcc or clang, or set "
        "PIEZO_OPT_CC to one."
    )
