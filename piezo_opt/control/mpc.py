"""Predictive control with the hysteretic model, as a real-time iteration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.control.closed_loop import Limits
from piezo_opt.control.observe import Estimate, Observer
from piezo_opt.control.plant import without_delay
from piezo_opt.control.qp import FAR, MOST
from piezo_opt.effects import Model
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.simulation.composed import address

FloatArray = NDArray[np.float64]

PRICE: Final = 1e3
"""Of passing a limit of the reading by the whole span, in units of tracking off by it."""


@final
@dataclass(frozen=True, eq=False)
class MPCState:
    """What a predictive controller remembers from sample to sample.

    Attributes:
        sample: how many there were.
        estimate: of the states; None before the first sample.
        moves: (N,) of the drive, of the last program [V].
        pending: drives that were asked and wait for their period.
        iterations, status: of the last program; status 1: it failed and the drive was held.
    """

    sample: int = 0
    estimate: Estimate | None = None
    moves: FloatArray | None = None
    pending: tuple[float, ...] = ()
    iterations: int = 0
    status: int = 0


@final
class MPC:
    """Tracks a reference over a horizon with the fitted model, its loop included.

        min  sum ((y_k + d - r_k) / Y)^2 + weight (w_k / U)^2,   u_k = u_(k-1) + w_k
        with  u and w within the drive's range and slew rate, y within the stroke (softly)

    The unknowns are the drive's moves w: the loop follows |w|, by the exact law that the plant
    follows as well. At every sample the model is linearised along the moves of last time, shifted,
    and one quadratic program gives their change (Gauss-Newton, one real-time iteration). Where that
    makes the plan cost more, by the law itself, and half of it makes it cost less, half is made:
    behind a corner of the law, where the drive turns, the linearisation is another one. The states
    come from an :class:`~piezo_opt.control.observe.Observer`, whose disturbance d takes the offset.
    A sample that is no number is passed over; where the program fails the drive is held.

    Args:
        plant: a fit, or a model with ``values``; a delay in it is rounded up to whole periods.
        values: SI values by full name.
        period: of the sampling [s].
        span: Y, what the reference spans [m].
        horizon: N periods.
        limits: of the drive.
        stroke: lowest and highest reading [m].
        weight: of the moves.
        noise, drive_noise, drift, gate: of the observer.
        delay: whole periods that computing takes.
        reference: (M,) what will be asked, one value a period, known before; without it what is
            asked at each sample is taken to last.
        iterations: of the program at most.
        rounds: linearisations and programs a sample; 1 is the real-time iteration, some ten give
            the converged solution.

    Attributes:
        gain: of the reading at rest [m/V], in size.
        weights: of error, moves, the last error, and the price of a reading out of its limits.

    Raises:
        InputError: no horizon, or a delay that is not shorter; weights that are not positive.

    Sources: Rawlings, Mayne & Diehl (2017), Model Predictive Control, 2nd ed., chs. 1, 8;
    Pannocchia & Rawlings (2003), AIChE J. 49(2), 426-437 (offset).
    """

    def __init__(
        self, plant: Fit | Model, values: Mapping[str, float] | None = None, *, period: float,
        span: float, horizon: int = 30, limits: Limits | None = None,
        stroke: tuple[float, float] | None = None, weight: float = 1e-3, noise: float = 1e-9,
        drive_noise: float = 0.1, drift: float | None = None, gate: float = float("inf"),
        delay: int = 0, reference: ArrayLike | None = None, iterations: int = MOST, rounds: int = 1,
    ) -> None:  # fmt: skip
        model, behind = without_delay(plant, values, period)
        known = plant.values.of_record(0) if isinstance(plant, Fit) else {}
        own = {k: v for k, v in {**known, **(values or {})}.items() if k in model.parameters}
        self.delay = delay + behind
        if min(horizon, iterations, rounds) < 1 or not (weight > 0.0 and span > 0.0):
            raise InputError(
                f"horizon = {horizon}, iterations = {iterations}, rounds = {rounds}, weight = "
                f"{weight}, span = {span} m: all are positive"
            )
        if self.delay >= horizon:
            raise InputError(
                f"The delay of {self.delay} periods is as long as the horizon of {horizon}: take a "
                "longer horizon, or sample more slowly."
            )
        self.observer = Observer(
            model, own, period=period, noise=noise, drive_noise=drive_noise, drift=drift, gate=gate
        )
        self.horizon, self.period = horizon, period
        self.iterations, self.rounds = iterations, rounds
        self.limits, self.stroke = limits or Limits(), stroke
        self.span, self.weight = span, weight
        self._model = self.observer.horizon
        self.gain = self._gain()
        # Cost in units of the span and of the drive that takes it.
        volts = span / self.gain
        self.weights = np.array([1.0 / span**2, weight / volts**2, 1.0, PRICE / span])
        low, high = stroke or (-FAR, FAR)
        if not low < high:
            raise InputError(f"stroke = {stroke} m: the lower limit is below the upper one")
        self._bounds = np.clip(
            [self.limits.low, self.limits.high, self.limits.slew, low, high, 0.0, 0.0], -FAR, FAR
        )
        self._reference = None if reference is None else np.asarray(reference, dtype=float)
        self._work = np.zeros(self._model.library.po_move_size(horizon))

    @property
    def knows_ahead(self) -> bool:
        """Whether the reference is known before."""
        return self._reference is not None

    def _gain(self) -> float:
        """How far the reading at rest moves a volt [m/V], in size."""
        h = self._model
        gain = h.reading(0.0, h.rest(1.0), 1.0) - h.reading(0.0, h.rest(0.0), 0.0)
        if not np.isfinite(gain) or gain == 0.0:
            raise InputError("The position does not follow the drive: there is nothing to control.")
        return abs(gain)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, the model apart; infinite numbers are None."""
        drive_noise, drift, noise, gate = (float(v) for v in self.observer.noises)
        return {
            "kind": "mpc", "horizon": self.horizon, "weight": self.weight, "span": self.span,
            "stroke": None if self.stroke is None else list(self.stroke), "noise": noise,
            "drive_noise": drive_noise, "drift": drift, "gate": gate if gate < 1e300 else None,
            "delay": self.delay, "iterations": self.iterations, "rounds": self.rounds,
        }  # fmt: skip

    def following(self, sample: int, reference: float) -> FloatArray:
        """(N,) references at the ends of the periods that a decision at a sample is about."""
        if self._reference is None:
            return np.full(self.horizon, reference)
        ahead = sample + self.delay + 1 + np.arange(self.horizon)
        return np.ascontiguousarray(
            self._reference[np.minimum(ahead, self._reference.size - 1)]
        )  # fmt: skip

    def begin(self) -> MPCState:
        """Nothing remembered; the first sample is taken at rest at the drive nearest to 0."""
        return MPCState()

    @property
    def rest(self) -> float:
        """The drive nearest to 0 that the limits allow [V]."""
        return min(max(0.0, self.limits.low), self.limits.high)

    def estimated(self, state: MPCState, reading: float) -> Estimate:
        """What the observer knows after a reading [m]; before the first one the loop rests."""
        if state.estimate is None:
            return self.observer.first(self.observer.begin(self.rest), reading)
        return self.observer.after(state.estimate, state.pending[0], reading)

    def act(
        self, state: MPCState, reference: float, reading: float, period: float,
        low: float, high: float,
    ) -> tuple[float, MPCState]:  # fmt: skip
        """The drive [V] within its limits, and what is remembered for the next sample."""
        estimate = self.estimated(state, reading)
        if state.moves is None:
            state = MPCState(0, estimate, None, (self.rest,) * self.delay)
            moves = np.zeros(self.horizon)
        else:
            # Behind the plan's end the drive goes on; where a resonance is stilled moves alternate.
            moves = np.append(state.moves[1:], np.mean(state.moves[-2:]))
            state = MPCState(state.sample, estimate, None, state.pending[1:])
        # Without a reference the drive is held.
        wanted = self.following(state.sample, reference) if np.isfinite(reference) else None
        return self._decided(state, estimate, moves, wanted, low, high)

    def _decided(
        self, state: MPCState, estimate: Estimate, moves: FloatArray, wanted: FloatArray | None,
        low: float, high: float,
    ) -> tuple[float, MPCState]:  # fmt: skip
        moves, told = np.ascontiguousarray(moves), np.array([0.0, 0.0, 1.0])
        before = state.pending[-1] if state.pending else estimate.drive
        drive = min(max(before, low), high)
        if wanted is not None:
            bounds = self._bounds.copy()
            bounds[5], bounds[6] = low, high
            pending = np.array(state.pending or (0.0,))
            m = self._model
            given = (wanted, self.weights, bounds, moves, self._work, told)
            for _ in range(self.rounds):
                drive = m.library.po_move(
                    self.horizon, self.iterations, address(m.p), estimate.time, self.period,
                    address(estimate.states), estimate.drive, len(state.pending),
                    address(pending), m.steps.rise, m.steps.held, *map(address, given),
                )  # fmt: skip
        return float(drive), MPCState(
            state.sample + 1, estimate, moves, (*state.pending, float(drive)), int(told[0]),
            int(told[2]),
        )  # fmt: skip
