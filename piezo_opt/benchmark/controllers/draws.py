"""Whether a robust design says rightly on how many actuators a constraint is violated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, final

import numpy as np

from piezo_opt.benchmark.controllers.starts import MODEL, VALUES
from piezo_opt.benchmark.table import table
from piezo_opt.control import Identified, Limits, scenarios, tune_pid
from piezo_opt.control.loop_program import LoopProgram
from piezo_opt.control.pid_family import PIDFamily
from piezo_opt.control.task import task
from piezo_opt.values import Values

PERIOD: Final = 0.01
LIMITS: Final = Limits(-30.0, 150.0)
WIDTHS: Final = {
    "piezo_gain.d": 0.02, "bouc_wen.alpha": 0.1, "bouc_wen.beta": 0.1, "bouc_wen.gamma": 0.1,
    "second_order.omega": 0.03, "second_order.zeta": 0.15,
}  # fmt: skip
"""Standard deviations over the values: a short, noisy record of the thesis' actuator."""
DESIGNS: Final = ((1.6, 0.02, 4), (1.6, 0.02, 16), (1.6, 0.05, 8), (2.0, 0.02, 8), (1.4, 0.01, 8))
"""Sensitivity peak, overshoot and scenarios of the designs."""
_VIOLATED: Final = 1e-4


@final
@dataclass(frozen=True)
class Draw:
    """One robust design.

    Attributes:
        peak, overshoot, scenarios: what it was asked.
        predicted: share of violating actuators that the design says.
        found: the same on fresh draws.
    """

    peak: float
    overshoot: float
    scenarios: int
    predicted: float
    found: float


@final
@dataclass(frozen=True)
class Draws:
    """All designs, on so many fresh draws each."""

    rows: tuple[Draw, ...]
    fresh: int

    def __str__(self) -> str:
        head = ("peak", "overshoot", "scenarios", "predicted", f"of {self.fresh} fresh draws")
        rows = [
            (
                f"{r.peak:g}", f"{100 * r.overshoot:g} %", str(r.scenarios),
                f"{100 * r.predicted:.1f} %", f"{100 * r.found:.1f} %",
            )
            for r in self.rows
        ]  # fmt: skip
        largest = max(abs(r.predicted - r.found) for r in self.rows)
        return f"{table(head, rows)}\nLargest difference: {100.0 * largest:.1f} points."

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"rows": [asdict(row) for row in self.rows], "fresh": self.fresh}


def draws(
    fresh: int,
    progress: Callable[[str], None] | None = None,
    *,
    designs: Sequence[tuple[float, float, int]] = DESIGNS,
) -> Draws:
    """Robust PIDs for a step of 10 um, judged on draws that no design has seen.

    Args:
        fresh: draws for each design.
        progress: told which design it is.
        designs: sensitivity peak, overshoot and scenarios of each.
    """
    plant = _actuator()
    step = np.concatenate([np.zeros(10), np.full(140, 10e-6)])
    rows = []
    others = scenarios(plant, fresh, seed=10_007)
    for k, (peak, overshoot, count) in enumerate(designs):
        if progress is not None:
            progress(f"robust PID {k + 1} of {len(designs)}")
        asked: dict[str, Any] = {
            "period": PERIOD, "limits": LIMITS, "overshoot": overshoot, "peak": peak,
            "scenarios": count, "seed": k,
        }  # fmt: skip
        design = tune_pid(plant, step, **asked)
        what = task(plant, step, **asked)
        own = what.plant.numbers
        sets = [own.with_({n: v for n, v in d.items() if n in own}) for d in others]
        program = LoopProgram(what.plant.model, own, sets, what.asked, PIDFamily)
        found = program.violated(program.family.unknowns(design.controller)) > _VIOLATED
        rows.append(Draw(peak, overshoot, count, design.violating, float(np.mean(found))))
    return Draws(tuple(rows), fresh)


def _actuator() -> Identified:
    """The thesis' actuator as a record has told it, with doubts that go together."""
    names = tuple(WIDTHS)
    size = np.array([WIDTHS[n] * abs(VALUES[n]) for n in names])
    # What a record cannot tell apart goes together: gain with loop, resonance with damping.
    correlation = np.eye(len(names))
    for i, j, share in ((0, 1, 0.8), (1, 2, 0.6), (2, 3, 0.5), (4, 5, 0.3)):
        correlation[i, j] = correlation[j, i] = share
    known = Identified(MODEL, Values.nominal(MODEL).with_(VALUES))
    return replace(known, names=names, covariance=correlation * np.outer(size, size))
