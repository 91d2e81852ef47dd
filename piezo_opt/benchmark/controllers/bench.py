"""All of it in one run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, final

from piezo_opt.benchmark.controllers.draws import Draws, draws
from piezo_opt.benchmark.controllers.iterations import Iterations, iterations
from piezo_opt.benchmark.controllers.starts import Starts, starts
from piezo_opt.errors import InputError

SCHEMA: Final = "piezo_opt/control_bench/1"


@final
@dataclass(frozen=True)
class ControlBench:
    """What controllers cost and find.

    Attributes:
        iterations: predictive control beside solvers.
        starts: gradients beside a simplex.
        draws: robust designs on fresh draws.
    """

    iterations: Iterations
    starts: Starts
    draws: Draws

    def __str__(self) -> str:
        return "\n\n".join(
            (
                f"Predictive control in the loop\n{self.iterations}",
                f"A PID by gradients and by a simplex\n{self.starts}",
                f"Robust PIDs\n{self.draws}",
            )
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        return {
            "schema": SCHEMA, "iterations": self.iterations.to_dict(),
            "starts": self.starts.to_dict(), "draws": self.draws.to_dict(),
        }  # fmt: skip


def control_bench(
    samples: int = 3000,
    count: int = 20,
    fresh: int = 2000,
    *,
    progress: Callable[[str], None] | None = None,
) -> ControlBench:
    """Predictive control beside solvers, a PID beside a simplex, robust PIDs on fresh draws.

    Args:
        samples: of the real-time iteration.
        count: starts of the PID.
        fresh: draws on which robust PIDs are judged.
        progress: told what runs.

    Raises:
        InputError: fewer than 20 samples, a start, or 20 draws.
    """
    if samples < 20 or count < 1 or fresh < 20:
        raise InputError(
            f"samples = {samples}, starts = {count}, draws = {fresh}: give at least 20 samples, "
            "1 start and 20 draws"
        )
    return ControlBench(
        iterations(samples, progress), starts(count, progress), draws(fresh, progress)
    )
