"""What a whole fit costs, in simulations with sensitivities, beside what one would otherwise do.

The alternative is what a script without the package does: SciPy's adaptive ``solve_ivp`` on the
same equations inside SciPy's ``least_squares`` with finite differences.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import final

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from piezo_opt.identification import Identification, ScipyLeastSquares, solve
from piezo_opt.simulation import Simulator

FloatArray = NDArray[np.float64]

_BRIEF = 400
"""Samples on which the reference runs: the whole record would take minutes an iteration."""


@final
@dataclass(frozen=True)
class Cost:
    """One way: milliseconds, and how many simulations with sensitivities that would pay for."""

    name: str
    milliseconds: float
    ratio: float
    note: str = ""


@final
@dataclass(frozen=True)
class FitCosts:
    """Ways to fit one question, compared; the first row is one simulation with sensitivities."""

    rows: tuple[Cost, ...]
    samples: int
    unknowns: int

    def __getitem__(self, name: str) -> Cost:
        return next(row for row in self.rows if row.name == name)

    def __str__(self) -> str:
        lines = [
            f"{self.samples} samples, {self.unknowns} unknowns, warm, fastest of the repetitions",
            f"  {'':<44} {'ms':>10} {'ratio':>9}",
        ]
        lines += [f"  {r.name:<44} {r.milliseconds:>10.1f} {r.ratio:>9.1f}  {r.note}"
                  for r in self.rows]  # fmt: skip
        return "\n".join(lines)


def measure_fit(
    question: Identification, repetitions: int = 5, *, reference: bool = True
) -> FitCosts:
    """Compare ways to answer a question whose model is the default one with mechanics.

    Args:
        question: piezo gain, Bouc-Wen (n = 1), second order and offset on one record.
        repetitions: of each way but the reference.
        reference: ``solve_ivp`` and finite differences too, for one Gauss-Newton iteration on a
            short stretch, because the whole would take minutes.
    """
    fit = solve(question)
    record = fit.records[0]
    simulator = Simulator(
        question.model, record, fit.values, directions=fit.names,
        substeps=fit.accuracy[0].substeps,
    )  # fmt: skip
    ways: dict[str, Callable[[], object]] = {
        "one simulation with sensitivities": lambda: simulator.with_sensitivities(fit.values),
        "fit, start values included": lambda: solve(question),
        "fit by scipy least_squares, our sensitivities": lambda: solve(
            question, solver=ScipyLeastSquares()
        ),
    }
    times = {name: _fastest(way, repetitions) for name, way in ways.items()}
    unit = times["one simulation with sensitivities"]
    rows = [Cost(name, 1e3 * t, t / unit) for name, t in times.items()]
    if reference:
        names = tuple(n for n in fit.names if not n.startswith("initial."))
        part = record.slice(None, float(record.time[min(_BRIEF, len(record) - 1)]))
        begin = perf_counter()
        _finite_differences(replace(question, records=part), fit.values, names)
        spent = (perf_counter() - begin) * len(record) / len(part)
        rows.append(
            Cost(
                "solve_ivp + finite-difference least_squares",
                1e3 * spent,
                spent / unit,
                f"one iteration on {len(part)} samples, scaled; the fit took {fit.trace.rms.size}",
            )
        )
    return FitCosts(tuple(rows), len(record), len(fit.names))


def _fastest(way: Callable[[], object], repetitions: int) -> float:
    way()
    best = float("inf")
    for _ in range(repetitions):
        begin = perf_counter()
        way()
        best = min(best, perf_counter() - begin)
    return best


def _finite_differences(
    question: Identification, values: Mapping[str, float], names: tuple[str, ...]
) -> None:
    """One iteration of the script that a user would write."""
    record = question.campaign.records[0]
    numbers = dict(values)
    time, drive = record.time, record.drive
    slopes = np.append(np.diff(drive) / np.diff(time), 0.0)

    def reading(theta: FloatArray) -> FloatArray:
        p = {**numbers, **dict(zip(names, theta, strict=True))}
        d, alpha = p["piezo_gain.d"], p["bouc_wen.alpha"]
        beta, gamma = p["bouc_wen.beta"], p["bouc_wen.gamma"]
        omega, zeta = p["second_order.omega"], p["second_order.zeta"]

        def rate(t: float, x: FloatArray) -> list[float]:
            k = min(int(np.searchsorted(time, t, side="right")) - 1, time.size - 1)
            slope = slopes[k]
            v = drive[k] + slope * (t - time[k])
            h, s, w = x
            return [
                alpha * slope - beta * abs(slope) * h - gamma * slope * abs(h),
                w,
                omega**2 * (d * v - h - s) - 2.0 * zeta * omega * w,
            ]

        start = [0.0, d * drive[0], 0.0]
        solution = solve_ivp(
            rate, (time[0], time[-1]), start, t_eval=time, rtol=1e-6, atol=1e-12,
            max_step=2.0 * record.step,
        )  # fmt: skip
        return np.asarray(solution.y[1] + p["offset.y0"] - record.position)

    start = np.array([numbers[n] for n in names])
    least_squares(reading, start, x_scale=np.abs(start) + 1e-12, method="lm", max_nfev=9)
