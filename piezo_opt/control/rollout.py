"""A closed loop as one compiled program, with its exact derivatives by the controller's gains.

What :func:`~piezo_opt.control.close_loop` does sample by sample for any plant and controller is
written once as C for a model and a law: sampling, computing delay, limits of drive and slew rate,
filter and anti-windup included. Derivatives are carried along (single shooting, forward mode).
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, Protocol, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.control.closed_loop import Limits
from piezo_opt.control.motion import (
    SOURCE,
    Steps,
    along,
    c_function,
    fastest_pole,
    needs_compiler,
    period_text,
)
from piezo_opt.keeping import digest
from piezo_opt.simulation.compiler import load
from piezo_opt.symbolic import one_at_a_time

FloatArray = NDArray[np.float64]

_OWN: Final = digest(Path(__file__).read_bytes())
_NO_LIMIT: Final = 1e30
"""Stands for infinity where a derivative multiplies it by zero [V]."""


class Law(Protocol):
    """A controller in the symbols of a program."""

    def __hash__(self) -> int: ...

    @property
    def gains(self) -> tuple[str, ...]:
        """Names of what is to be chosen."""
        ...

    @property
    def memory(self) -> int:
        """How many numbers it remembers; all are 0 before the first sample."""
        ...

    @property
    def recipe(self) -> str:
        """All that the law follows from, as a text."""
        ...

    def act(
        self, memory: ca.SX, reference: ca.SX, reading: ca.SX, period: ca.SX, low: ca.SX,
        high: ca.SX, gains: ca.SX,
    ) -> tuple[ca.SX, ca.SX]:  # fmt: skip
        """The drive and the next memory."""
        ...


@final
@dataclass(frozen=True, eq=False)
class Setting:
    """What a loop is asked to do: reference (N,) [m], disturbance and noise of the reading, limits.

    Attributes:
        reference: (N,) [m].
        period: [s].
        limits: of the drive.
        delay: whole periods that computing takes.
        disturbance, noise: (N,) [m], added to the position, and to what is read of it.
        drive: at which the plant rests before [V].
    """

    reference: FloatArray
    period: float
    limits: Limits
    delay: int
    disturbance: FloatArray
    noise: FloatArray
    drive: float = 0.0


@final
@dataclass(frozen=True, eq=False)
class Run:
    """A loop and its derivatives along d directions: position, drive (N,); their slopes (N, d)."""

    position: FloatArray
    drive: FloatArray
    position_by: FloatArray
    drive_by: FloatArray


@final
class Rollout:
    """Loops of one model under one law.

    Args:
        system: the model's equations.
        law: the controller.
        directions: of the gains, along which there are derivatives.
    """

    def __init__(self, system: System, law: Law, directions: int) -> None:
        self.system, self.law, self.directions = system, law, directions
        self._bare = _library(system, law, law.recipe, 0)
        self._whole = _library(system, law, law.recipe, directions)
        self._fastest: dict[bytes, float] = {}

    def run(
        self, p: FloatArray, gains: FloatArray, setting: Setting, seeds: FloatArray | None = None
    ) -> Run:
        """One loop; not finite where it diverges.

        Args:
            p: the model's parameters.
            gains: (g,) of the law.
            setting: what it is asked to do.
            seeds: (g, d) how the gains move along each direction; without them no derivatives.
        """
        n, nx = setting.reference.size, len(self.system.state_names)
        library, nd = (self._bare, 1) if seeds is None else (self._whole, self.directions)
        known = p.tobytes()
        if known not in self._fastest:
            self._fastest[known] = fastest_pole(self.system, p, setting.drive)
        steps = Steps.of(self._fastest[known], setting.period)
        none = np.zeros(0)
        rest = self.system.start(0.0, setting.drive, none, p, np.zeros(nx))
        x = np.ascontiguousarray(np.asarray(rest, dtype=float).ravel())
        limits = np.clip(
            [setting.limits.low, setting.limits.high, setting.limits.slew], -_NO_LIMIT, _NO_LIMIT
        )
        outputs = [np.zeros(n), np.zeros(n), np.zeros((n, nd)), np.zeros((n, nd))]
        waiting = np.zeros((setting.delay + 2) * (1 + nd))
        given = [
            np.ascontiguousarray(a, dtype=float)
            for a in (
                setting.reference, setting.disturbance, setting.noise, limits, p, gains,
                np.zeros(1) if seeds is None else seeds,
            )
        ]  # fmt: skip
        library.po_run(
            n, setting.delay, setting.period, setting.drive, steps.rise, steps.held,
            *(a.ctypes.data for a in (*given, x, waiting, *outputs)),
        )  # fmt: skip
        if seeds is None:
            outputs[2:] = [np.zeros((n, self.directions))] * 2
        return Run(*outputs)


@lru_cache(maxsize=64)
@one_at_a_time
def _library(system: System, law: Law, recipe: str, directions: int) -> ctypes.CDLL:
    library = load(
        f"rollout {SOURCE} {_OWN} {recipe} {directions} {system.recipe}",
        lambda _: _text(system, law, directions),
    )
    if library is None:
        raise needs_compiler("Tuning a controller")
    library.po_run.argtypes = [
        ctypes.c_long, ctypes.c_long, ctypes.c_double, ctypes.c_double, ctypes.c_long,
        ctypes.c_long, *[ctypes.c_void_p] * 13,
    ]  # fmt: skip
    library.po_run.restype = None
    return library


def _text(system: System, law: Law, nd: int) -> str:
    """C text of the loop with derivatives along so many directions."""
    ng, nm = len(law.gains), law.memory
    memory, gains = ca.SX.sym("m", nm), ca.SX.sym("g", ng)
    before, y, r, period, low, high, slew = (
        ca.SX.sym(k) for k in ("before", "y", "r", "T", "low", "high", "slew")
    )
    seed_m = ca.SX.sym("M", nm * nd)
    seed_b, seed_y, seed_g = ca.SX.sym("B", nd), ca.SX.sym("Y", nd), ca.SX.sym("G", ng * nd)
    least = ca.fmin(ca.fmax(low, before - slew * period), high)
    most = ca.fmax(ca.fmin(high, before + slew * period), least)
    asked, after = law.act(memory, r, y, period, least, most, gains)
    drive = ca.fmin(ca.fmax(asked, least), most)
    by = ca.vertcat(memory, before, y, gains)
    seeds = ca.vertcat(
        ca.reshape(seed_m, nd, nm).T, seed_b.T, seed_y.T, ca.reshape(seed_g, nd, ng).T
    )  # fmt: skip
    act = ca.Function(
        "act",
        [
            memory,
            seed_m,
            before,
            seed_b,
            y,
            seed_y,
            r,
            period,
            ca.vertcat(low, high, slew),
            gains,
            seed_g,
        ],
        [drive, along(drive, by, seeds), ca.densify(after), along(after, by, seeds)],
    )
    sizes: Mapping[str, int] = {
        "@ND": max(nd, 1), "@NX": max(len(system.state_names), 1), "@NM": max(nm, 1),
    }  # fmt: skip
    text = _LOOP
    for key, size in sizes.items():
        text = text.replace(key, str(size))
    return period_text(system, nd) + c_function("act", act) + text


_LOOP: Final = """
void po_run(long n, long delay, double T, double rest, long rise, long held, const double *r,
            const double *added, const double *noise, const double *limits, const double *p,
            const double *g, const double *G, double *x, double *waiting, double *position,
            double *drive, double *position_by, double *drive_by) {
  const long wide = 1 + @ND;
  double X[@NX * @ND] = {0.0}, memory[@NM] = {0.0}, MEMORY[@NM * @ND] = {0.0};
  double before[1 + @ND] = {0.0}, acting[1 + @ND] = {0.0}, y[1 + @ND] = {0.0};
  before[0] = acting[0] = rest;
  for (long k = 0; k < (delay + 1) * wide; ++k) waiting[k] = k % wide ? 0.0 : rest;
  reading(p, 0.0, x, X, rest, acting + 1, y, y + 1);
  for (long k = 0; k < n; ++k) {
    position[k] = y[0] + added[k];
    for (int d = 0; d < @ND; ++d) position_by[k * @ND + d] = y[1 + d];
    const double seen = position[k] + noise[k];
    double *slot = waiting + (k % (delay + 1)) * wide, next[1 + @ND];
    act(memory, MEMORY, before, before + 1, &seen, y + 1, r + k, &T, limits, g, G, next, next + 1,
        memory, MEMORY);
    /* With a delay of d periods, what is asked now acts d samples later. */
    const double was = acting[0];
    double WAS[@ND];
    for (int d = 0; d < @ND; ++d) WAS[d] = acting[1 + d];
    for (int d = 0; d <= @ND; ++d) {
      before[d] = next[d];
      slot[d] = next[d];
    }
    const double *due = waiting + ((k + 1) % (delay + 1)) * wide;
    for (int d = 0; d <= @ND; ++d) acting[d] = due[d];
    drive[k] = acting[0];
    for (int d = 0; d < @ND; ++d) drive_by[k * @ND + d] = acting[1 + d];
    period(p, k * T, was, WAS, acting[0], acting + 1, T, rise, held, x, X);
    reading(p, (k + 1) * T, x, X, acting[0], acting + 1, y, y + 1);
  }
}
"""
