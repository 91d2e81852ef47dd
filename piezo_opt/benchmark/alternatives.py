"""What a user would take instead, at equal accuracy: error against nanoseconds a sample.

One model (gain, Bouc-Wen, second order, offset) and one drive for all: ours by each scheme, the
exported C, C written by hand, a numba loop of the same scheme, SciPy's ``solve_ivp``, CVODES inside
CasADi, and diffrax. What is not installed is left out and says so. The slow ones run on the first
samples only. Errors are largest differences, over the stroke, from ours with 64 sub-steps a sample.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from importlib.util import find_spec
from time import perf_counter
from typing import Any, Final, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from piezo_opt.assembly import folded, named
from piezo_opt.benchmark.table import table
from piezo_opt.effects import BoucWen, Model, Offset, PiezoGain, SecondOrder
from piezo_opt.errors import PiezoOptError
from piezo_opt.export.c.plan import plan, system_of
from piezo_opt.export.c.printer import DOUBLE
from piezo_opt.export.c.writer import text
from piezo_opt.export.given import given
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Substeps, composed
from piezo_opt.simulation.compiler import load
from piezo_opt.simulation.schedule import corners
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]
Run = Callable[[], FloatArray]

RATE: Final = 1e4
"""Samples a second [Hz]."""
MODEL: Final[Model] = PiezoGain() + BoucWen() + SecondOrder() + Offset()
VALUES: Final = {"second_order.omega": 2.0 * np.pi * 400.0}
EQUAL: Final = 1e-6
"""Error over the stroke at which times are compared."""
_CUTS: Final = (1, 2, 4, 8, 16)
"""Sub-steps a sample."""
_FINE: Final = 64
_SLOW: Final = 400
"""Samples of ways that take microseconds a sample and more."""


@final
@dataclass(frozen=True)
class Point:
    """One way at one setting.

    Attributes:
        way: what simulates.
        setting: its sub-steps or tolerance.
        error: largest error over the stroke.
        nanoseconds: for one sample.
    """

    way: str
    setting: str
    error: float
    nanoseconds: float


@final
@dataclass(frozen=True)
class Alternatives:
    """Points of every way.

    Attributes:
        points: of each way and setting.
        skipped: ways that are not installed, and why.
        exported: nanoseconds of exported C over those of C by hand, the same scheme in turns, one
            sub-step a sample.
        called: the same where a program calls it sample by sample.
    """

    points: tuple[Point, ...]
    skipped: Mapping[str, str]
    exported: float
    called: float

    def at(self, way: str, error: float = EQUAL) -> float:
        """Nanoseconds a sample of a way where it errs by so much at most; infinite where never.

        Between two settings the logarithms go along a straight line; none is made up beyond them.
        """
        own = sorted((p.error, p.nanoseconds) for p in self.points if p.way == way)
        if not own or own[0][0] > error:
            return float("inf")
        errors, times = np.log(np.maximum(np.array(own).T, 1e-17))
        return float(np.exp(np.interp(np.log(error), errors, times)))

    @property
    def ways(self) -> tuple[str, ...]:
        """Their names, in order."""
        return tuple(dict.fromkeys(p.way for p in self.points))

    @property
    def best(self) -> str:
        """Our fastest way at :data:`EQUAL`."""
        return min((w for w in self.ways if w.startswith("ours")), key=self.at)

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "points": [dict(p.__dict__) for p in self.points], "skipped": dict(self.skipped),
            "exported": self.exported, "called": self.called, "best": self.best,
            "at": {w: t if (t := self.at(w)) < np.inf else None for w in self.ways},
        }  # fmt: skip

    def __str__(self) -> str:
        best = self.at(self.best)

        def row(way: str) -> tuple[str, str, str]:
            time = self.at(way)
            if time == np.inf:
                least = min(p.error for p in self.points if p.way == way)
                return way, f"errs by {least:.0e} at least", ""
            return way, f"{time:.1f}", f"{time / best:.1f}"

        rows = [row(w) for w in self.ways] + [(w, why, "") for w, why in self.skipped.items()]
        return (
            f"Exported C takes {self.exported:.2f} times C by hand, the same scheme; called sample "
            f"by sample {self.called:.2f} times.\n\n"
            + table((f"at {EQUAL:g} of the stroke", "ns/sample", "over our best"), rows)
        )


def alternatives(
    samples: int = 8000, repetitions: int = 9, progress: Callable[[str], object] = str
) -> Alternatives:
    """Run every way at several settings, the fast ones in turns.

    Args:
        samples: of the record.
        repetitions: of each fast way; the fastest counts.
        progress: told what runs.

    Raises:
        PiezoOptError: there is no C compiler.
    """
    time = np.arange(samples) / RATE
    drive = 75.0 + 75.0 * np.sin(2 * np.pi * 10.0 * time) * np.sin(2 * np.pi * 1.3 * time)
    record = Measurement(time=time, drive=drive, position=1e-7 * drive, name="speed")
    values = Values.nominal(MODEL).with_(VALUES)
    truth = ours(record, values, Substeps(1.0 / RATE / _FINE, 1e9, exact=True))()
    stroke = float(np.ptp(truth))
    fast: dict[tuple[str, str], Run] = {}
    hand = by_hand(record, values, RATE)
    out, called = (_exported(record, values, f"po_{one}") for one in ("run", "called"))
    loop = _numba(record, values)
    for n in _CUTS:
        cut, told = 1.0 / RATE / n, f"{n} sub-steps"
        fast["ours, linear part exact", told] = ours(record, values, Substeps(cut, 1e9, exact=True))
        fast["ours, Runge-Kutta", told] = ours(record, values, Substeps(cut, 1e9))
        fast["C by hand", told] = hand(n)
        fast["exported C", told] = out(n)
        fast["exported C, sample by sample", told] = called(n)
        if loop is not None:
            fast["numba loop", told] = loop(n)
    progress("alternatives")
    found = {key: run() for key, run in fast.items()}
    least = dict.fromkeys(fast, np.inf)
    for _ in range(repetitions):
        for key, run in fast.items():
            begin = perf_counter()
            run()
            least[key] = min(least[key], (perf_counter() - begin) / samples * 1e9)
    points = [
        Point(*key, float(np.abs(found[key] - truth).max()) / stroke, least[key]) for key in fast
    ]
    brief = record.slice(None, float(record.time[min(_SLOW, samples) - 1]))
    for way, runs in (("solve_ivp", _solve_ivp), ("CVODES in CasADi", _cvodes)):
        progress(way)
        points += _slow(way, runs(brief, values), truth, stroke)
    skipped = {}
    if loop is None:
        skipped["numba loop"] = "numba is not installed"
    if find_spec("diffrax") is None:
        skipped["diffrax"] = "diffrax is not installed"
    else:
        progress("diffrax")
        points += _slow("diffrax", _diffrax(brief, values), truth, stroke)
    one = f"{_CUTS[0]} sub-steps"
    ratios = (
        least[way, one] / least["C by hand", one]
        for way in ("exported C", "exported C, sample by sample")
    )
    return Alternatives(tuple(points), skipped, *ratios)


def _slow(
    way: str, runs: Sequence[tuple[str, Run]], truth: FloatArray, stroke: float
) -> list[Point]:
    points = []
    for setting, run in runs:
        run()  # what is compiled on the way is compiled
        begin = perf_counter()
        y = run()
        spent = (perf_counter() - begin) / y.size * 1e9
        points.append(Point(way, setting, float(np.abs(y - truth[: y.size]).max()) / stroke, spent))
    return points


def ours(record: Measurement, values: Values, cut: Substeps) -> Run:
    """The library's simulation of :data:`MODEL` on given sub-steps."""
    system = named(MODEL, folded(MODEL))
    made = composed.program(system, cut.exact)
    if made is None:
        raise PiezoOptError("The speed of compiled code needs a C compiler: install gcc or clang.")
    runner = composed.ComposedEngine(made, ())
    p = values.vector(system.parameter_names)
    axis = corners(record, system.channel_names).sampled
    counts = cut.of(axis)
    x, s = runner.start(axis, p, np.zeros(len(system.state_names)))
    return lambda: runner.run(axis, counts, p, x, s).reading


def by_hand(record: Measurement, values: Values, rate: float) -> Callable[[int], Run]:
    """C written by hand for :data:`MODEL`, by the number of sub-steps a sample.

    Args:
        record: gives the drive.
        values: of the parameters.
        rate: samples a second [Hz].
    """
    library = load(resources.files(__package__).joinpath("by_hand.c").read_text())
    if library is None:
        raise PiezoOptError("The speed of compiled code needs a C compiler: install gcc or clang.")
    call = library.po_run
    call.restype = None
    call.argtypes = [ctypes.c_long, ctypes.c_int, ctypes.c_double, *[ctypes.c_void_p] * 3]
    p = values.vector(tuple(n for n, one in MODEL.parameters.items() if not one.fixed))
    drive = np.ascontiguousarray(record.drive)

    def run(n: int) -> FloatArray:
        y = np.empty(drive.size)
        call(drive.size, n, 1.0 / rate, drive.ctypes.data, p.ctypes.data, y.ctypes.data)
        return y

    return lambda n: lambda: run(n)


_LOOPS: Final = """
void po_run(long count, double step, double longest, const double *U, double *Y)
{
    actuator a;
    actuator_init(&a, U[0]);
    a.longest_substep = longest;
    Y[0] = actuator_output(&a);
    actuator_run(&a, step, count - 1, U + 1, Y + 1);
}
void po_called(long count, double step, double longest, const double *U, double *Y)
{
    actuator a;
    actuator_init(&a, U[0]);
    a.longest_substep = longest;
    Y[0] = actuator_output(&a);
    for (long k = 1; k < count; ++k) Y[k] = actuator_step(&a, step, U[k]);
}
"""


def _exported(record: Measurement, values: Values, function: str) -> Callable[[int], Run]:
    """The exported code, given the whole drive at once, or called sample by sample."""
    what = given(MODEL, values)
    ready = plan(what, system_of(what), "actuator", Substeps(1.0 / RATE, 1e9), 1.0 / RATE)
    header, source = text(ready, DOUBLE)
    own = source.replace('#include "actuator.h"', "")
    library = load(f"{header}\n{own}\n{_LOOPS}")
    if library is None:
        raise PiezoOptError("The speed of compiled code needs a C compiler: install gcc or clang.")
    call = getattr(library, function)
    call.restype = None
    number = ctypes.c_double
    call.argtypes = [ctypes.c_long, number, number, ctypes.c_void_p, ctypes.c_void_p]
    drive = np.ascontiguousarray(record.drive)

    def run(n: int) -> FloatArray:
        y = np.empty(drive.size)
        call(drive.size, 1.0 / RATE, 1.0 / RATE / n, drive.ctypes.data, y.ctypes.data)
        return y

    return lambda n: lambda: run(n)


def _numba(record: Measurement, values: Values) -> Callable[[int], Run] | None:
    """The loop of ``by_hand.c`` in Python, compiled by numba."""
    if find_spec("numba") is None:
        return None
    numba: Any = __import__("numba")
    d, alpha, beta, gamma, omega, zeta, y0 = _numbers(values)
    drive = np.ascontiguousarray(record.drive)

    def loop(u_all: Any, m: int, step: float) -> Any:
        w2, c, dt = omega * omega, 2.0 * zeta * omega, step / m
        y = np.empty(u_all.size)
        h, x, v = 0.0, d * u_all[0], 0.0
        y[0] = x + y0
        for k in range(1, u_all.size):
            du = (u_all[k] - u_all[k - 1]) / step
            a, b, g = alpha * du, beta * abs(du), gamma * du
            u = u_all[k - 1]
            for _ in range(m):
                um, ue = u + 0.5 * dt * du, u + dt * du
                h1 = a - b * h - g * abs(h)
                x1, v1 = v, w2 * (d * u - h - x) - c * v
                ha, xa, va = h + 0.5 * dt * h1, x + 0.5 * dt * x1, v + 0.5 * dt * v1
                h2 = a - b * ha - g * abs(ha)
                x2, v2 = va, w2 * (d * um - ha - xa) - c * va
                hb, xb, vb = h + 0.5 * dt * h2, x + 0.5 * dt * x2, v + 0.5 * dt * v2
                h3 = a - b * hb - g * abs(hb)
                x3, v3 = vb, w2 * (d * um - hb - xb) - c * vb
                hc, xc, vc = h + dt * h3, x + dt * x3, v + dt * v3
                h4 = a - b * hc - g * abs(hc)
                x4, v4 = vc, w2 * (d * ue - hc - xc) - c * vc
                h += dt / 6.0 * (h1 + 2.0 * (h2 + h3) + h4)
                x += dt / 6.0 * (x1 + 2.0 * (x2 + x3) + x4)
                v += dt / 6.0 * (v1 + 2.0 * (v2 + v3) + v4)
                u = ue
            y[k] = x + y0
        return y

    compiled: Any = numba.njit(loop)
    return lambda n: lambda: np.asarray(compiled(drive, n, 1.0 / RATE), dtype=float)


def _numbers(values: Values) -> tuple[float, ...]:
    """d, alpha, beta, gamma, omega, zeta, y0."""
    return tuple(values[n] for n, one in MODEL.parameters.items() if not one.fixed)


def _solve_ivp(record: Measurement, values: Values) -> list[tuple[str, Run]]:
    d, alpha, beta, gamma, omega, zeta, y0 = _numbers(values)
    time, drive = record.time - record.time[0], record.drive
    slopes = np.append(np.diff(drive) / np.diff(time), 0.0)

    def rate(t: float, x: FloatArray) -> list[float]:
        k = min(int(np.searchsorted(time, t, side="right")) - 1, time.size - 1)
        slope = slopes[k]
        u = drive[k] + slope * (t - time[k])
        h, s, w = x
        return [
            alpha * slope - beta * abs(slope) * h - gamma * slope * abs(h), w,
            omega**2 * (d * u - h - s) - 2.0 * zeta * omega * w,
        ]  # fmt: skip

    def run(tolerance: float) -> FloatArray:
        found = solve_ivp(
            rate, (0.0, time[-1]), [0.0, d * drive[0], 0.0], t_eval=time, rtol=tolerance,
            atol=1e-9 * tolerance,
        )  # fmt: skip
        return np.asarray(found.y[1] + y0, dtype=float)

    return [(f"rtol {t:g}", partial(run, t)) for t in (1e-3, 1e-5, 1e-7, 1e-9)]


def _cvodes(record: Measurement, values: Values) -> list[tuple[str, Run]]:
    """Sample by sample, because the drive has a corner at each."""
    d, alpha, beta, gamma, omega, zeta, y0 = _numbers(values)
    x, t, p = ca.SX.sym("x", 3), ca.SX.sym("t"), ca.SX.sym("p", 2)
    h, s, w = x[0], x[1], x[2]
    u, slope = p[0] + p[1] * t, p[1]
    rate = ca.vertcat(
        alpha * slope - beta * ca.fabs(slope) * h - gamma * slope * ca.fabs(h), w,
        omega**2 * (d * u - h - s) - 2.0 * zeta * omega * w,
    )  # fmt: skip
    drive = np.asarray(record.drive)
    start = np.array([0.0, d * drive[0], 0.0])
    lines = np.vstack([drive[:-1], np.diff(drive) * RATE])
    made: list[tuple[str, Run]] = []
    for tolerance in (1e-4, 1e-6, 1e-8):
        one = ca.integrator(
            "one", "cvodes", {"x": x, "t": t, "p": p, "ode": rate}, 0.0, 1.0 / RATE,
            {"reltol": tolerance, "abstol": 1e-9 * tolerance},
        )  # fmt: skip
        whole = one.mapaccum(drive.size - 1)

        def run(whole: Any) -> FloatArray:
            ends = np.asarray(whole(x0=start, p=lines)["xf"], dtype=float)
            return np.append(start[1], ends[1]) + y0

        made.append((f"reltol {tolerance:g}", partial(run, whole)))
    return made


def _diffrax(record: Measurement, values: Values) -> list[tuple[str, Run]]:
    jax, diffrax = __import__("jax"), __import__("diffrax")
    jax.config.update("jax_enable_x64", True)
    jnp: Any = jax.numpy
    d, alpha, beta, gamma, omega, zeta, y0 = _numbers(values)
    time, drive = jnp.asarray(record.time - record.time[0]), jnp.asarray(record.drive)
    line = diffrax.LinearInterpolation(time, drive)

    def rate(t: Any, x: Any, args: Any) -> Any:  # noqa: ARG001
        u, slope = line.evaluate(t), line.derivative(t)
        h, s, w = x[0], x[1], x[2]
        return jnp.stack([
            alpha * slope - beta * jnp.abs(slope) * h - gamma * slope * jnp.abs(h), w,
            omega**2 * (d * u - h - s) - 2.0 * zeta * omega * w,
        ])  # fmt: skip

    def made(tolerance: float) -> Run:
        start = jnp.array([0.0, d * drive[0], 0.0])

        def whole(first: Any) -> Any:
            return diffrax.diffeqsolve(
                diffrax.ODETerm(rate), diffrax.Tsit5(), 0.0, time[-1], 1.0 / RATE, first,
                saveat=diffrax.SaveAt(ts=time), max_steps=200_000,
                stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=1e-9 * tolerance),
            ).ys  # fmt: skip

        compiled = jax.jit(whole)
        return lambda: np.asarray(compiled(start)[:, 1], dtype=float) + y0

    return [(f"rtol {t:g}", made(t)) for t in (1e-3, 1e-5, 1e-7)]
