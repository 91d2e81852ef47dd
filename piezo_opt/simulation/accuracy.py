"""How many sub-steps a simulation needs, found by halving until the scheme's error is small.

The error of the scheme is estimated by Richardson's comparison: the same simulation with sub-steps
half as long differs by 15/16 of the error of a scheme of order four. Where the physics has corners
of its own (friction, a loop of forces) the order drops; so the gain of a halving is measured from
one halving to the next.

Source: Hairer, Norsett & Wanner (1993), Solving Ordinary Differential Equations I, II.4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.errors import ModelError
from piezo_opt.simulation.schedule import Segment

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

_MOST: Final = 20_000_000
"""Sub-steps in one simulation beyond which the model is called too stiff."""


@final
@dataclass(frozen=True)
class Substeps:
    """Longest sub-step [s] and largest change of the drive [V] within one sub-step."""

    longest: float
    largest_move: float

    def of(self, segment: Segment) -> IntArray:
        """Number of sub-steps of each segment, at least one."""
        by_time = segment.length / self.longest
        by_move = np.abs(segment.slope) * segment.length / self.largest_move
        # The slack keeps rounding of time stamps from adding a sub-step here and there.
        wanted = np.ceil(np.maximum(by_time, by_move) - 1e-6)
        return np.clip(wanted, 1, np.iinfo(np.int32).max).astype(np.int32)

    def halved(self) -> Substeps:
        """Sub-steps of half the size."""
        return Substeps(0.5 * self.longest, 0.5 * self.largest_move)


@final
@dataclass(frozen=True)
class Accuracy:
    """Sub-steps and the error that they leave.

    Attributes:
        substeps: what was chosen.
        error: root mean square of the scheme's error in the reading [m].
        per_sample: mean number of sub-steps between readings.
    """

    substeps: Substeps
    error: float
    per_sample: float


def fastest_rate(system: System, segment: Segment, parameters: FloatArray, x: FloatArray) -> float:
    """Largest magnitude of an eigenvalue of the linearised chain over the record's slopes [1/s]."""
    if not system.state_names:
        return 0.0
    jacobian = system.rate.jacobian()
    steep = np.argsort(np.abs(segment.slope))
    picks = {int(steep[0]), int(steep[steep.size // 2]), int(steep[(9 * steep.size) // 10])}
    top = 0.0
    for i in picks:
        given = [
            segment.time[i], x, segment.drive[i], segment.slope[i], segment.channels[i],
            segment.channel_slopes[i], parameters,
        ]  # fmt: skip
        a = np.array(jacobian(*given, np.zeros(x.size))[1])
        if np.isfinite(a).all():
            top = max(top, float(np.abs(np.linalg.eigvals(a)).max()))
    return top


def choose(
    system: System,
    segment: Segment,
    parameters: FloatArray,
    start: FloatArray,
    simulate: Callable[[Substeps], FloatArray],
    tolerance: float,
    most: int = _MOST,
) -> Accuracy:
    """Halve the sub-steps until the scheme's error is below the tolerance, or falls no more.

    Args:
        simulate: the reading (N,) [m] for given sub-steps.
        tolerance: admissible error as a share of the reading's range.
        most: sub-steps in the whole record beyond which the best so far is taken.

    Raises:
        ModelError: no number of sub-steps up to ``most`` makes the simulation finite.
    """
    rate = fastest_rate(system, segment, parameters, start)
    longest = float(segment.length.max())
    swing = float(np.ptp(segment.drive)) or 1.0
    substeps = Substeps(min(longest, 2.0 / rate) if rate > 0 else longest, swing / 4.0)
    coarse = simulate(substeps)
    before, best = np.inf, Accuracy(substeps, np.inf, 0.0)
    while True:
        finer = substeps.halved()
        count = int(finer.of(segment).sum(dtype=np.int64))
        if count > most:
            if np.isfinite(best.error):
                return best
            raise ModelError(
                f"The model is too stiff for this record: {count:.3g} sub-steps would be needed "
                f"(fastest rate {rate:.3g} 1/s); raise the lower bound of its shortest time "
                "constant or drop the mechanics, which the record cannot see."
            )
        fine = simulate(finer)
        if np.isfinite(fine).all() and np.isfinite(coarse).all():
            change = float(np.sqrt(np.mean((fine - coarse) ** 2)))
            allowed = tolerance * (float(np.ptp(fine)) or 1.0)
            # How much a halving helps is measured, not assumed: corners lower the order.
            known = np.isfinite(before) and change > 0.0
            gain = float(np.clip(before / change, 2.0, 16.0)) if known else 2.0
            if change * gain / (gain - 1.0) <= allowed:
                error = change * gain / (gain - 1.0)
                return Accuracy(substeps, error, int(substeps.of(segment).sum()) / coarse.size)
            best = Accuracy(finer, change / (gain - 1.0), count / coarse.size)
            if best.error <= allowed or change > 0.7 * before:
                return best
            before = change
        substeps, coarse = finer, fine
