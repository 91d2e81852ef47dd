"""Gradients beside Nelder and Mead's simplex, on the thesis' PID from seeded starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Final, final

import numpy as np

from piezo_opt.benchmark.table import table
from piezo_opt.control import PID, Limits, tune_pid
from piezo_opt.effects import BoucWen, PiezoGain, SecondOrder

MODEL: Final = PiezoGain() + BoucWen() + SecondOrder()
VALUES: Final = {
    "piezo_gain.d": 0.2057e-6, "bouc_wen.alpha": 0.0805e-6, "bouc_wen.beta": 0.00384,
    "bouc_wen.gamma": -0.00535, "second_order.omega": 8.0321, "second_order.zeta": 0.1992,
}  # fmt: skip
"""The thesis' loop and the mechanics of its Eq. 3.5."""
THESIS: Final = PID(50.137e6, 84.405e6, 3.9926e6, tau=0.02)
PERIOD: Final = 0.01
LIMITS: Final = Limits(-30.0, 150.0)
SPREAD: Final = 1.0
"""Decades to each side of the thesis' gains within which starts are drawn."""
SAME: Final = 1e-4
"""Of a cost: below, both have the same; the tolerance of both searches."""


@final
@dataclass(frozen=True)
class Start:
    """Both searches from one start.

    Attributes:
        seed: number of the start.
        cost, simplex: costs that both ended with [m s].
        simulations, simplex_simulations: that they took.
        price: simulations until the gradient had the simplex' cost; -1 if never.
    """

    seed: int
    cost: float
    simplex: float
    simulations: int
    simplex_simulations: int
    price: int

    @property
    def good(self) -> bool:
        """Whether the simplex' cost was reached with a tenth of its simulations."""
        return 0 < 10 * self.price <= self.simplex_simulations


@final
@dataclass(frozen=True)
class Starts:
    """All starts."""

    rows: tuple[Start, ...]

    def __str__(self) -> str:
        head = (
            "start", "gradient [um s]", "simplex [um s]", "simplex over it", "simulations",
            "until the simplex' cost", "simplex",
        )  # fmt: skip
        rows = [
            (
                str(r.seed), f"{1e6 * r.cost:.5f}", f"{1e6 * r.simplex:.5f}",
                f"{r.simplex / r.cost:.4g}", str(r.simulations),
                str(r.price) if r.price > 0 else "never", str(r.simplex_simulations),
            )
            for r in self.rows
        ]  # fmt: skip
        good = sum(r.good for r in self.rows)
        return (
            f"{table(head, rows)}\nThe simplex' cost or less with a tenth of its simulations: "
            f"{good} of {len(self.rows)} starts."
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units."""
        return {"rows": [asdict(row) for row in self.rows]}


def starts(count: int, progress: Callable[[str], None] | None = None) -> Starts:
    """Both searches from so many starts, the same program and the same cost.

    The reference is the thesis' triangle of 15 um in 50 s; gains are drawn evenly in their
    logarithm, a tenth to ten times the thesis'.

    Args:
        count: how many.
        progress: told which start it is.
    """
    generator, rows = np.random.default_rng(0), []
    time = np.arange(0.0, 50.0, PERIOD)
    reference = 15e-6 * (1.0 - np.abs(time / 25.0 - 1.0))
    for seed in range(count):
        if progress is not None:
            progress(f"PID from start {seed + 1} of {count}")
        k = 10.0 ** generator.uniform(-SPREAD, SPREAD, 4)
        start = PID(THESIS.kp * k[0], THESIS.ki * k[1], THESIS.kd * k[2], THESIS.tau * k[3])
        ours, theirs = (
            tune_pid(
                MODEL, reference, period=PERIOD, values=VALUES, limits=LIMITS, start=start,
                simplex_only=simple,
            )
            for simple in (False, True)
        )  # fmt: skip
        goal = theirs.trace[-1][1] * (1.0 + SAME)
        price = next((n for n, cost in ours.trace if cost <= goal), -1)
        rows.append(
            Start(seed, ours.cost, theirs.cost, ours.simulations, theirs.simulations, price)
        )
    return Starts(tuple(rows))
