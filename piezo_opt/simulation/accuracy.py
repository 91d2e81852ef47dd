"""How many sub-steps a simulation needs, found by halving until the scheme's error is small.

The error of the scheme is estimated by Richardson's comparison: the same simulation with *every*
sub-step cut in two differs by 15/16 of the error of a scheme of order four. Where the physics has
corners of its own (friction, a loop of forces) the order drops; so the gain of a halving is
measured from one halving to the next.

Source: Hairer, Norsett & Wanner (1993), Solving Ordinary Differential Equations I, II.4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.errors import ModelError
from piezo_opt.simulation.dynamics import Dynamics, dynamics
from piezo_opt.simulation.schedule import Segment

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

_MOST: Final = 20_000_000
"""Sub-steps in one simulation beyond which the model is called too stiff."""
_TRIES: Final = 8
"""Sub-steps over the first choice that are tried until a simulation is finite."""
DIVERGED: Final = 1e100
"""What no reading and no sensitivity reaches: squares of more overflow."""
_FAST: Final = 16.0
"""Rate times a segment's length from which it is looked at where the drive is at rest, too."""
_LITTLE: Final = 0.1
"""Change over the admissible error up to which halving is not worth while."""
_PATIENCE: Final = 3
"""Halvings without a gain before the best is taken: at first one may not reach the steep parts."""


@final
@dataclass(frozen=True)
class Substeps:
    """Longest sub-step [s] and largest change of the drive [V] within one sub-step.

    Where something gives way to the motion, ``farthest`` is also how far the measured motion may go
    within one [m]: it is fast for moments, and cutting all time as finely would take far longer.
    With ``times`` every sub-step is cut into that many, also one that is short already. They hold
    for the scheme that they were chosen for: ``exact`` is the one that moves linear blocks by their
    exponential (:mod:`piezo_opt.simulation.exponential`), else all states go by Runge-Kutta.
    """

    longest: float
    largest_move: float
    times: int = 1
    exact: bool = False
    farthest: float = np.inf

    def of(self, segment: Segment) -> IntArray:
        """Number of sub-steps of each segment, at least one."""
        most_of_all = max(
            segment.longest / self.longest, segment.largest_move / self.largest_move,
            segment.farthest / self.farthest,
        )  # fmt: skip
        if most_of_all <= 1.0:
            count = np.ones(segment.length.size, dtype=np.int32)
            if self.times > 1:
                count[segment.length > 0.0] = self.times
            return count
        most = segment.length / self.longest
        np.maximum(most, segment.moves / self.largest_move, out=most)
        if self.farthest < np.inf:
            np.maximum(most, segment.travel / self.farthest, out=most)
        # The slack keeps rounding of time stamps from adding a sub-step here and there.
        most -= 1e-6
        np.ceil(most, out=most)
        np.maximum(most, 1.0, out=most)
        if self.times > 1:
            most[segment.length > 0.0] *= self.times  # what takes no time cannot be cut
        return np.minimum(most, np.iinfo(np.int32).max, out=most).astype(np.int32)

    def scaled(self, time: float, move: float) -> Substeps:
        """Sub-steps of another length in time, and along the drive."""
        return replace(self, longest=time * self.longest, largest_move=move * self.largest_move)

    def count(self, segment: Segment) -> int:
        """Number of sub-steps of all segments together."""
        return int(self.of(segment).sum(dtype=np.int64))


@final
@dataclass(frozen=True)
class Accuracy:
    """Sub-steps and the error that they leave.

    Attributes:
        substeps: what was chosen.
        error: estimated root mean square of the scheme's error in the reading [m].
        per_sample: mean number of sub-steps between readings.
    """

    substeps: Substeps
    error: float
    per_sample: float


def fastest_rates(
    system: System,
    segment: Segment,
    parameters: FloatArray,
    x: FloatArray,
    exact: bool = False,
) -> tuple[float, float]:
    """How fast the linearised chain moves by itself [1/s], and how fast with the drive [1/V].

    With ``exact`` the chain without what moves by its exponential.

    Largest magnitudes of eigenvalues, first under a drive that stands still, then what the drive's
    slope adds. A held drive is still nearly always and very steep for a moment: one rate for both
    would cut the still part as finely as the step.

    Looked at with the states at the start; where those are fast, also with the states that each
    drive would have at rest, and the slower counts: a lagged drive that is left behind at the start
    rushes as it never does later. Halving finds out what is too few, never what is too many.
    """
    if not system.state_names:
        return 0.0, 0.0
    moving = dynamics(system, exact)
    rates = _rates(moving, segment, parameters, lambda _: x)
    if max(rates[0] * segment.longest, rates[1] * segment.largest_move) <= _FAST:
        return rates

    def at_rest(i: int) -> FloatArray:
        return moving.at_rest(segment.time[i], segment.drive[i], segment.channels[i], parameters)

    departure = x - at_rest(0)
    resting = _rates(moving, segment, parameters, lambda i: at_rest(i) + departure)
    return min(rates[0], resting[0]), min(rates[1], resting[1])


def _rates(
    moving: Dynamics,
    segment: Segment,
    parameters: FloatArray,
    states: Callable[[int], FloatArray],
) -> tuple[float, float]:
    """Both rates where the states at the beginning of segment i are ``states(i)``."""

    chosen = list(segment.by_slope)
    slope = segment.slope[chosen]
    instants = np.array([
        [
            segment.time[i], segment.drive[i], driven, *segment.channels[i],
            *segment.channel_slopes[i], *states(i),
        ]
        for i in chosen for driven in (0.0, segment.slope[i])
    ])  # fmt: skip
    by_slope = moving.slopes(instants, parameters)
    finite = np.asarray(np.isfinite(by_slope).all(axis=(1, 2)))
    fastest = np.abs(np.linalg.eigvals(np.where(finite[:, None, None], by_slope, 0.0))).max(axis=1)
    still, moved = fastest.reshape(-1, 2).T
    steep = np.where(slope != 0.0, np.abs(slope), np.inf)
    return float(still.max()), float(((moved - still) / steep).max(initial=0.0))


def choose(
    system: System,
    segment: Segment,
    parameters: FloatArray,
    start: FloatArray,
    simulate: Callable[[Substeps, IntArray], FloatArray],
    tolerance: float,
    most: int = _MOST,
    exact: bool = False,
) -> Accuracy:
    """Halve the sub-steps until the scheme's error is below the tolerance, or falls no more.

    Args:
        simulate: the reading (N,) [m] for given sub-steps, and their number in each segment.
        tolerance: admissible error as a share of the reading's range.
        most: sub-steps in the whole record beyond which the best so far is taken.
        exact: whether linear blocks are moved by their exponential.

    Raises:
        ModelError: no number of sub-steps up to ``most`` makes the simulation finite.
    """
    rate, by_drive = fastest_rates(system, segment, parameters, start, exact)
    within = dynamics(system, exact).longest(parameters)
    swing = float(np.ptp(segment.drive)) or 1.0
    substeps = Substeps(
        min(segment.longest, within, 2.0 / rate if rate > 0 else np.inf),
        min(segment.largest_move or swing, swing / 4.0, 2.0 / by_drive if by_drive > 0 else np.inf),
        exact=exact,
    )
    known: dict[bytes, FloatArray] = {}
    last: dict[bytes, FloatArray] = {}

    def reading(substeps: Substeps, cut: IntArray) -> FloatArray:
        # Other lengths often come to the same numbers.
        key = cut.tobytes()
        if key not in known:
            known[key] = last[key] if key in last else simulate(substeps, cut)
        return known[key]

    cut = substeps.of(segment)
    fewest, before, stalled = int(cut.sum(dtype=np.int64)), np.inf, 0
    best: Accuracy | None = None
    fine: FloatArray = np.zeros(1)
    while True:
        count = int(cut.sum(dtype=np.int64))
        if count > most and best is not None:
            return best
        if count > _MOST or (count > most and count > _TRIES * fewest):
            if 2 * count > _TRIES * fewest and not _bounded(fine):
                raise ModelError(
                    "The simulation is not finite at these values, however small the sub-steps: "
                    "the model is unstable there; give other start values or tighter bounds."
                )
            raise ModelError(
                f"The model is too stiff for this record: {count:.3g} sub-steps would be needed "
                f"(fastest rate {rate:.3g} 1/s); raise the lower bound of its shortest time "
                "constant or drop the mechanics, which the record cannot see."
            )
        last, known = known, {}  # a long record's readings of every round would fill memory
        coarse = reading(substeps, cut)
        # What takes no time cannot be cut.
        fine = reading(replace(substeps, times=2), np.where(segment.length > 0.0, 2 * cut, cut))
        shorter = substeps.scaled(0.5, 0.5)
        if _bounded(fine) and _bounded(coarse):
            change = _rms(fine - coarse)
            # How much a halving helps is measured, not assumed: corners lower the order.
            seen = np.isfinite(before) and change > 0.0
            gain = float(np.clip(before / change, 2.0, 16.0)) if seen else 2.0
            error = change * gain / (gain - 1.0)
            if best is None or error < best.error:
                best = Accuracy(substeps, error, count / coarse.size)
            allowed = tolerance * (float(np.ptp(fine)) or 1.0)
            stalled = stalled + 1 if change > 0.7 * before else 0
            if error <= allowed or stalled == _PATIENCE:
                return best
            before = change
            if exact:
                # What is not linear has corners that the drive crosses as it moves; between its
                # moves there may be nothing left that asks for short sub-steps, or the reverse.
                in_time = substeps.scaled(0.5, 1.0)
                between = reading(in_time, in_time.of(segment))
                if _bounded(between) and _rms(between - coarse) <= _LITTLE * allowed:
                    shorter = substeps.scaled(1.0, 0.5)
                elif _bounded(between) and _rms(fine - between) <= _LITTLE * allowed:
                    shorter = in_time
        substeps = shorter
        cut = substeps.of(segment)


def _rms(a: FloatArray) -> float:
    return float(np.sqrt(np.mean(a**2)))


def _bounded(reading: FloatArray) -> bool:
    """Whether a simulation has neither ended in NaN nor is on its way there."""
    return bool(np.abs(reading).max(initial=0.0) < DIVERGED)
