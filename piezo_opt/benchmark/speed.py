"""How fast the simulation runs, compared in one run on one machine.

The measure is a loop written by hand: the same Runge-Kutta scheme for the same model, as somebody
writes it who knows C and this one model, built by the same compiler with the same flags. A program
that is generated and compiled for one sum of effects should not be slower than that by more than a
little; one that is composed of compiled effects is, and needs no compiler.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Final, final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from piezo_opt.effects import BoucWen, Model, Offset, PiezoGain, SecondMode, SecondOrder
from piezo_opt.errors import PiezoOptError
from piezo_opt.measurement import Between, Measurement
from piezo_opt.simulation import INITIAL, Simulator, Substeps
from piezo_opt.simulation.compiler import load
from piezo_opt.simulation.emit import emit
from piezo_opt.simulation.scheme import scheme
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

MODEL: Final[Model] = PiezoGain() + BoucWen() + SecondOrder() + Offset()
RATE: Final = 5e3
"""Samples a second [Hz]."""
SUBSTEPS: Final = 4
"""Runge-Kutta sub-steps a sample."""
_AGREE: Final = 1e-12
_VIRTUAL: Final = 5_000
_ADAPTIVE: Final = 250

_EXPONENT: Final = "bouc_wen.n"
_BENT: Final = 1.3
"""The exponent of the loop where it is free."""
_FREE: Final = ", exponent free"

TWO_MODES: Final[Model] = MODEL + SecondMode()
_MODES: Final = {
    "second_order.omega": 0.5 * RATE, "second_mode.g": 0.1, "second_mode.omega": 1.5 * RATE,
}  # fmt: skip
"""Resonances at a twelfth and a quarter of the sampling rate."""

STRAIGHT: Final = "#define LOOP(h) (a - b * (h) - g * fabs(h))\n"
POWER: Final = "#define LOOP(h) (a - pow(fabs(h) / 1e-6, n - 1.0) * (b * (h) + g * fabs(h)))\n"
"""Rate of the loop, with an exponent of one and with any."""

BY_HAND: Final = """\
#include <math.h>

void po_run(const long count, const int m, const double step, const double *restrict U,
            const double *restrict P, double *restrict Y)
{
    const double d = P[0], alpha = P[1], beta = P[2], gamma = P[3];
    const double w2 = P[4] * P[4], c = 2.0 * P[5] * P[4], y0 = P[6], n = P[7];
    const double dt = step / m, half = 0.5 * dt, sixth = dt / 6.0;
    double h = 0.0, x = d * U[0], v = 0.0;
    Y[0] = x + y0;
    for (long k = 1; k < count; ++k) {
        const double du = (U[k] - U[k - 1]) / step;
        const double a = alpha * du, b = beta * fabs(du), g = gamma * du;
        double u = U[k - 1];
        for (int i = 0; i < m; ++i) {
            const double um = u + half * du, ue = u + dt * du;
            const double h1 = LOOP(h);
            const double x1 = v, v1 = w2 * (d * u - h - x) - c * v;
            const double ha = h + half * h1, xa = x + half * x1, va = v + half * v1;
            const double h2 = LOOP(ha);
            const double x2 = va, v2 = w2 * (d * um - ha - xa) - c * va;
            const double hb = h + half * h2, xb = x + half * x2, vb = v + half * v2;
            const double h3 = LOOP(hb);
            const double x3 = vb, v3 = w2 * (d * um - hb - xb) - c * vb;
            const double hc = h + dt * h3, xc = x + dt * x3, vc = v + dt * v3;
            const double h4 = LOOP(hc);
            const double x4 = vc, v4 = w2 * (d * ue - hc - xc) - c * vc;
            h += sixth * (h1 + 2.0 * (h2 + h3) + h4);
            x += sixth * (x1 + 2.0 * (x2 + x3) + x4);
            v += sixth * (v1 + 2.0 * (v2 + v3) + v4);
            u = ue;
        }
        Y[k] = x + y0;
    }
}
"""


@final
@dataclass(frozen=True)
class Speed:
    """One way to simulate.

    Attributes:
        name: what ran.
        per_sample: [ns] a sample, the fastest of the repetitions.
        per_substep: [ns] a sub-step; None for an integrator of another kind.
        ratio: time over that of the loop written by hand.
        note: what was measured, where it is not the whole record.
    """

    name: str
    per_sample: float
    per_substep: float | None
    ratio: float
    note: str = ""


@final
@dataclass(frozen=True)
class SpeedTable:
    """Ways to simulate one record, compared.

    Attributes:
        rows: the loop written by hand first.
        samples: length of the record.
        repetitions: runs of each, taken in turns; the fastest counts.
        operations: floating-point operations of the generated sub-step.
        chain: how many of them wait for one another.
        disagreement: largest difference of generated and hand-written, as a share of the range.
    """

    rows: tuple[Speed, ...]
    samples: int
    repetitions: int
    operations: int
    chain: int
    disagreement: float

    def __getitem__(self, name: str) -> Speed:
        return next(row for row in self.rows if row.name == name)

    @property
    def why(self) -> str:
        """Where the time goes, in a sentence."""
        by_hand, ours = self["by hand"], self["compiled"]
        return (
            f"A generated sub-step is {self.operations} operations, {self.chain} of them one after "
            f"the other (the compiler joins most products with the sum that follows): "
            f"{ours.per_substep:.1f} ns, written by hand {by_hand.per_substep:.1f} ns."
        )

    def __str__(self) -> str:
        lines = [
            f"{self.samples} samples, {SUBSTEPS} Runge-Kutta sub-steps a sample, fastest of "
            f"{self.repetitions}; results agree to {self.disagreement:.0e} of the range",
            f"  {'':<28} {'ns/sample':>10} {'ns/sub-step':>12} {'ratio':>9}",
        ]
        for row in self.rows:
            part = "" if row.per_substep is None else f"{row.per_substep:.1f}"
            lines.append(
                f"  {row.name:<28} {row.per_sample:>10.0f} {part:>12} {row.ratio:>9.2f}  {row.note}"
            )
        return "\n".join([*lines, self.why])


def measure(samples: int = 100_000, repetitions: int = 7, *, references: bool = True) -> SpeedTable:
    """Compare simulations of one record in one run.

    Args:
        samples: length of the record.
        repetitions: runs of each way, in turns.
        references: CasADi's virtual machine and SciPy's ``solve_ivp`` too, on the record's
            beginning, because the whole would take minutes.

    Raises:
        PiezoOptError: there is no C compiler, or the results do not agree.
    """
    record, values = _record(samples), Values.nominal(MODEL)
    bent = values.with_({_EXPONENT: _BENT})
    directions = (*_free(), INITIAL + "bouc_wen.h")
    cut = Substeps(1.0 / (RATE * SUBSTEPS), 1e9)
    ours = Simulator(MODEL, record, values, directions=directions, substeps=cut, whole=True)
    parts = Simulator(MODEL, record, values, directions=directions, substeps=cut, whole=False)
    free = Simulator(
        MODEL, record, bent, directions=(*directions, _EXPONENT), substeps=cut, whole=True
    )
    libraries = [load(law + BY_HAND) for law in (STRAIGHT, POWER)]
    if libraries[0] is None or libraries[1] is None or not ours.compiled:
        raise PiezoOptError("The speed of compiled code needs a C compiler: install gcc or clang.")
    by_hand = _by_hand(libraries[0], record, values)
    by_power = _by_hand(libraries[1], record, bent)
    swinging = Values.nominal(TWO_MODES).with_(_MODES)
    struck = _struck(samples)
    stepped, exact = (
        Simulator(TWO_MODES, struck, swinging, exact=linear, whole=True) for linear in (False, True)
    )
    ways: dict[str, tuple[Callable[[], object], int, float | None, str]] = {
        "by hand": (by_hand, samples, SUBSTEPS, ""),
        "compiled": (lambda: ours.reading(values), samples, SUBSTEPS, ""),
        f"with {len(directions)} sensitivities": (
            lambda: ours.with_sensitivities(values), samples, SUBSTEPS, "",
        ),
        "composed": (lambda: parts.reading(values), samples, SUBSTEPS, ""),
        f"composed, {len(directions)} sensitivities": (
            lambda: parts.with_sensitivities(values), samples, SUBSTEPS, "",
        ),
        f"by hand{_FREE}": (by_power, samples, SUBSTEPS, "pow of the C library"),
        f"compiled{_FREE}": (lambda: free.reading(bent), samples, SUBSTEPS, ""),
        f"with {len(free.directions)} sensitivities": (
            lambda: free.with_sensitivities(bent), samples, SUBSTEPS, "",
        ),
        "two modes, steps": (
            lambda: stepped.reading(swinging), samples, stepped.accuracy.per_sample, _cut(stepped),
        ),
        "the linear part exact": (
            lambda: exact.reading(swinging), samples, exact.accuracy.per_sample, _cut(exact),
        ),
    }  # fmt: skip
    if references:
        short = _record(min(samples, _VIRTUAL))
        virtual = Simulator(MODEL, short, values, substeps=cut, prefer_compiled=False)
        brief = _record(min(samples, _ADAPTIVE))
        ways["CasADi's virtual machine"] = (
            lambda: virtual.reading(values), len(short), SUBSTEPS, f"first {len(short)} samples",
        )  # fmt: skip
        ways["scipy solve_ivp"] = (
            lambda: _solve_ivp(brief, values), len(brief), None,
            f"first {len(brief)} samples, RK45, rtol 1e-6",
        )  # fmt: skip
    disagreement = max(
        *(_difference(one.reading(values), by_hand()) for one in (ours, parts)),
        _difference(free.reading(bent), by_power()),
    )
    if not disagreement <= _AGREE:
        raise PiezoOptError(
            f"Generated and hand-written code differ by {disagreement:.1e} of the range: report it."
        )
    fastest = dict.fromkeys(ways, float("inf"))
    for run, *_ in ways.values():
        run()  # compiles, fills caches
    for turn in range(repetitions):
        for name, (run, length, _, _) in ways.items():
            if length < samples and turn >= 2:
                continue
            begin = perf_counter()
            run()
            fastest[name] = min(fastest[name], (perf_counter() - begin) / length * 1e9)
    operations, chain = _size(ours)
    return SpeedTable(
        rows=tuple(
            Speed(
                name, fastest[name], None if steps is None else fastest[name] / steps,
                fastest[name] / fastest["by hand"], note,
            )
            for name, (_, _, steps, note) in ways.items()
        ),
        samples=samples,
        repetitions=repetitions,
        operations=operations,
        chain=chain,
        disagreement=disagreement,
    )  # fmt: skip


def _cut(simulator: Simulator) -> str:
    return f"{simulator.accuracy.per_sample:.1f} sub-steps a sample, as chosen"


def _difference(found: FloatArray, expected: FloatArray) -> float:
    """Largest difference of two readings, as a share of the range."""
    return float(np.abs(found - expected).max() / np.ptp(expected))


def _size(simulator: Simulator) -> tuple[int, int]:
    """Operations of the generated sub-step, and how many of them wait for one another."""
    step = scheme(simulator.system).step
    names = [step.name_in(i) for i in range(step.n_in())]
    moving = [2 if n in ("t", "x", "u", "c") else 1 for n in names]
    block = emit(step, names, moving, "a", 3)
    return len(block.levels[2]), block.chain


def _free() -> tuple[str, ...]:
    return tuple(n for n, p in MODEL.parameters.items() if not p.fixed)


def _record(samples: int) -> Measurement:
    time = np.arange(samples) / RATE
    drive = 50.0 + 40.0 * np.sin(2 * np.pi * 5.0 * time) * np.cos(2 * np.pi * 0.3 * time)
    return Measurement(time=time, drive=drive, position=1e-7 * drive, name="speed")


def _struck(samples: int) -> Measurement:
    """Steps of a held drive, after which a resonance swings."""
    time = np.arange(samples) / RATE
    drive = 50.0 + 20.0 * np.sign(np.sin(2 * np.pi * 50.0 * time + 0.1))
    return Measurement(time, drive, 1e-7 * drive, between=Between.HELD)


def _by_hand(library: ctypes.CDLL, record: Measurement, values: Values) -> Callable[[], FloatArray]:
    function = library.po_run
    function.restype = None
    address = ctypes.c_void_p
    function.argtypes = [ctypes.c_long, ctypes.c_int, ctypes.c_double, address, address, address]
    drive = np.ascontiguousarray(record.drive)
    p = values.vector((
        "piezo_gain.d", "bouc_wen.alpha", "bouc_wen.beta", "bouc_wen.gamma", "second_order.omega",
        "second_order.zeta", "offset.y0", _EXPONENT,
    ))  # fmt: skip

    def run() -> FloatArray:
        reading = np.empty(drive.size)
        function(
            drive.size, SUBSTEPS, 1.0 / RATE, drive.ctypes.data, p.ctypes.data,
            reading.ctypes.data,
        )  # fmt: skip
        return reading

    return run


def _solve_ivp(record: Measurement, values: Values) -> FloatArray:
    """The same model as a Python function, integrated by SciPy with its own choice of steps."""
    d, alpha, beta, gamma, omega, zeta, y0 = values.vector((
        "piezo_gain.d", "bouc_wen.alpha", "bouc_wen.beta", "bouc_wen.gamma", "second_order.omega",
        "second_order.zeta", "offset.y0",
    ))  # fmt: skip
    time, drive = record.time, record.drive
    slopes = np.diff(drive) * RATE

    def rate(t: float, state: FloatArray) -> list[float]:
        k = min(int(t * RATE), slopes.size - 1)
        dv = slopes[k]
        v = drive[k] + dv * (t - time[k])
        h, x, w = state
        return [
            alpha * dv - beta * abs(dv) * h - gamma * dv * abs(h),
            w,
            omega * omega * (d * v - h - x) - 2.0 * zeta * omega * w,
        ]

    solution = solve_ivp(
        rate, (time[0], time[-1]), [0.0, d * drive[0], 0.0], t_eval=time, rtol=1e-6,
        atol=[1e-13, 1e-12, 1e-9], max_step=1.0 / RATE,
    )  # fmt: skip
    return np.asarray(solution.y[1] + y0)
