"""A model along a horizon, compiled: linearisation, filter and real-time iteration."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.control.motion import LANES, SOURCE, Steps, fastest_pole, needs_compiler, period_text
from piezo_opt.control.plant import system_of
from piezo_opt.control.qp import program_text, typed
from piezo_opt.effects import Model
from piezo_opt.identification import Fit
from piezo_opt.simulation.compiler import load
from piezo_opt.symbolic import one_at_a_time

FloatArray = NDArray[np.float64]

_ENTRY: Final = """
void po_linearise(long n, const double *p, double t, double T, const double *x0, double u0,
                  long rise, long held, const double *w, double *A, double *B, double *C,
                  double *y, double *end) {
  linearise(n, p, t, T, x0, u0, rise, held, w, A, B, C, y, end);
}

void po_filter(const double *p, double t, double T, double before, double after, long rise,
               long held, double seen, const double *noises, double *x, double *P, double *used) {
  used[0] = -1.0;
  if (predict(p, t - T, before, after, T, rise, held, noises, x, P))
    used[0] = (double)correct(p, t, after, seen, noises, x, P);
}

void po_correct(const double *p, double t, double u, double seen, const double *noises, double *x,
                double *P, double *used) {
  used[0] = (double)correct(p, t, u, seen, noises, x, P);
}

double po_move(long n, long most, const double *p, double t, double T, const double *x0, double u0,
               long delay, const double *pending, long rise, long held, const double *r,
               const double *weights, const double *bounds, double *w, double *work,
               double *told) {
  return decide(n, most, p, t, T, x0, u0, delay, pending, rise, held, r, weights, bounds, w, work,
                told);
}

long po_move_size(long n) {
  return n * (NZ * NZ + 2 * NZ + 4 + SIDES + 1) + program_size(n);
}
void po_run(void) {}
"""
"""What Python calls; exported code has none of it."""


@final
@dataclass(frozen=True, eq=False)
class Along:
    """Readings (N,) along moves of the drive, the slopes of each period, the states at the end."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    reading: FloatArray
    end: FloatArray


@final
class Horizon:
    """One model, sampled at one period, as a compiled program.

    Args:
        plant: a fit, or a model with ``values``.
        values: SI values by full name.
        period: [s].
        finer: times as many Runge-Kutta steps as the fastest pole asks for.

    Raises:
        ModelError: the model needs channels, or has a delay.
        InputError: there is no compiler.
    """

    def __init__(
        self, plant: Fit | Model, values: Mapping[str, float] | None, period: float,
        finer: int = 1,
    ) -> None:  # fmt: skip
        self.system, self.p = system_of(plant, values)
        self.period = period
        self.states = len(self.system.state_names)
        least = Steps.of(fastest_pole(self.system, self.p), period)
        self.steps = Steps(finer * least.rise, finer * least.held)
        self.library = _library(self.system)

    def rest(self, drive: float) -> FloatArray:
        """States (n,) at rest at a drive [V]."""
        none = np.zeros(0)
        x = self.system.start(0.0, drive, none, self.p, np.zeros(self.states))
        return np.asarray(x, dtype=float).ravel()

    def reading(self, time: float, x: FloatArray, drive: float) -> float:
        """The reading [m] of states at a drive."""
        none = np.zeros(0)
        return float(self.system.reading(time, x, drive, 0.0, none, none, self.p))

    def along(self, time: float, x: FloatArray, drive: float, w: FloatArray) -> Along:
        """What the moves w (N,) [V] lead to from states and a drive."""
        n, nz = w.size, self.states + 1
        made = Along(
            np.empty((n, nz, nz)), np.empty((n, nz)), np.empty((n, nz)), np.empty(n),
            np.empty(self.states),
        )  # fmt: skip
        x, w = np.ascontiguousarray(x), np.ascontiguousarray(w)
        self.library.po_linearise(
            n, self.p.ctypes.data, time, self.period, x.ctypes.data, drive, self.steps.rise,
            self.steps.held, w.ctypes.data,
            *(v.ctypes.data for v in (made.a, made.b, made.c, made.reading, made.end)),
        )  # fmt: skip
        return made


@lru_cache(maxsize=32)
@one_at_a_time
def _library(system: System) -> ctypes.CDLL:
    nx = len(system.state_names)
    after = resources.files(__package__).joinpath("predictive.c").read_text(encoding="utf-8")
    # States, drive before and after; whole registers of them.
    directions = -(-(nx + 2) // LANES) * LANES
    own = program_text(nx + 1) + f"#define NX {nx}\n#define ND {directions}\n"
    recipe = f"horizon {SOURCE} {own} {after} {_ENTRY} {system.recipe}"
    library = load(
        recipe,
        lambda _: own + period_text(system, directions) + after + _ENTRY,
    )
    if library is None:
        raise needs_compiler("Predictive control")
    typed(library)
    size, number, address = ctypes.c_long, ctypes.c_double, ctypes.c_void_p
    library.po_linearise.argtypes = [
        size, address, number, number, address, number, size, size, *[address] * 6,
    ]  # fmt: skip
    library.po_linearise.restype = None
    library.po_filter.argtypes = [
        address, number, number, number, number, size, size, number, *[address] * 4,
    ]  # fmt: skip
    library.po_filter.restype = None
    library.po_correct.argtypes = [address, number, number, number, *[address] * 4]
    library.po_correct.restype = None
    library.po_move.argtypes = [
        size, size, address, number, number, address, number, size, address, size, size,
        *[address] * 6,
    ]  # fmt: skip
    library.po_move.restype = number
    library.po_move_size.argtypes = [size]
    library.po_move_size.restype = size
    return library
