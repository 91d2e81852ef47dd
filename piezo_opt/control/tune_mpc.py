"""Horizon, weight and filter of a predictive controller, chosen in its loop."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from piezo_opt.choosing import whole
from piezo_opt.control.calm import calm
from piezo_opt.control.closed_loop import ClosedLoop, Limits, close_loop
from piezo_opt.control.identified import Source
from piezo_opt.control.linearise import linearise
from piezo_opt.control.loop_program import Asked
from piezo_opt.control.mpc import MPC
from piezo_opt.control.plant import ModelPlant
from piezo_opt.control.scenarios import scenarios as drawn
from piezo_opt.control.task import Task, task
from piezo_opt.errors import InputError
from piezo_opt.units import show
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

CHECKS: Final = 40
"""Further actuators on which the design is run: 5 and 95 % are the second ones of each end."""
_APART: Final = 1_000_003
_HORIZONS: Final = (5, 10, 20, 40, 80)
_ENOUGH: Final = 1.02
"""Of the smallest error: the shortest horizon within it is taken."""
_START: Final = np.array([-4.0, -2.5])
"""Decimal logarithms of the weight, and of the drive's noise, to begin with."""
_LOW, _HIGH = np.array([-8.0, -3.0]), np.array([0.0, 0.0])
"""Of these; the drive's noise in units of the drive that the span takes. On the model that it knows
a filter would trust the model alone: a thousandth is left for what the model is not."""
_MOST: Final = 25
"""Loops of Nelder and Mead's search: it knows the weight to a few per cent then, and the error of
the loop is flat there."""


@final
@dataclass(frozen=True, eq=False)
class TunedMPC:
    """A predictive controller, and what it does.

    Attributes:
        controller: for the first reference.
        period: of the sampling [s].
        limits: of the drive.
        horizon: periods; ``horizons`` those tried, with the rms error of each [m].
        weight: of the moves.
        noise, drive_noise: of the filter [m], [V].
        loops: the loop on each reference, with the values of the fit itself.
        seconds: processor's time of a sample, in the middle and at the 99 % quantile [s].
        simulations: loops that were simulated.
        scenarios, seed: draws from the fit's covariance; 0 for the fit's values alone.
        others: (k,) rms error on further draws, which the controller does not know [m].
        calm: whether the loop comes to rest after a step, and after a fault of the sensor that has
            driven it into its limits.
        remarks: sentences on the plant.
        interrupted: whether Ctrl-C or a limit of time ended the work; what was not done by then is
            left out.
    """

    controller: MPC
    period: float
    limits: Limits
    horizon: int
    horizons: tuple[tuple[int, float], ...]
    weight: float
    noise: float
    drive_noise: float
    loops: tuple[ClosedLoop, ...]
    seconds: tuple[float, float]
    simulations: int
    scenarios: int
    seed: int
    others: FloatArray
    calm: bool
    remarks: tuple[str, ...] = ()
    interrupted: bool = False

    def __str__(self) -> str:
        low = min(float(one.drive.min()) for one in self.loops)
        high = max(float(one.drive.max()) for one in self.loops)
        tried = ", ".join(f"{n}: {show(e, 'm')}" for n, e in self.horizons)
        lines = [
            "MPC with the fitted model, min sum ((y - r) / Y)^2 + weight (move / U)^2:",
            f"horizon {self.horizon} periods ({show(self.horizon * self.period, 's')}), weight "
            f"{self.weight:.3g}, filter for {show(self.noise, 'm')} of noise in the reading and "
            f"{show(self.drive_noise, 'V')} in the drive, a reading further off than "
            f"{show(self.gate, 'm')} is none",
            f"sampled every {show(self.period, 's')}; drive within {self.limits.told()}, {low:.4g} "
            f"to {high:.4g} V used",
            f"expected error {show(max(one.rms for one in self.loops), 'm')} rms, "
            f"{show(max(one.largest for one in self.loops), 'm')} at most; rms by horizon: {tried}",
            f"a sample takes {show(self.seconds[0], 's')} in the middle and "
            f"{show(self.seconds[1], 's')} at the 99 % quantile on this machine",
        ]
        if self.others.size:
            least, most = np.quantile(self.others, (0.05, 0.95))
            lines.append(
                f"{self.others.size} other actuators that the record allows (seed {self.seed}): "
                f"{show(float(least), 'm')} to {show(float(most), 'm')} rms (5 to 95 %)"
            )
        if self.seconds[1] > self.period:
            lines.append(
                "A sample takes longer than the period: sample more slowly or take a shorter "
                "horizon."
            )
        if not self.calm:
            lines.append(
                "A step or a fault of the sensor leaves it swinging between the limits of its "
                "drive: sample faster, or take a longer horizon."
            )
        if self.interrupted:
            lines.append("The search was ended early: this is the best so far.")
        return "\n".join([*lines, *self.remarks])

    @property
    def gate(self) -> float:
        """Distance from what the filter expects beyond which a reading is none [m]."""
        return float(self.controller.observer.noises[3])

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        return {
            "schema": "piezo_opt/tune_mpc/1",
            "controller": self.controller.to_dict(),
            "period": self.period,
            "limits": self.limits.to_dict(),
            "horizons": [{"horizon": n, "rms": e} for n, e in self.horizons],
            "rms": [one.rms for one in self.loops],
            "largest": [one.largest for one in self.loops],
            "effort": [one.effort for one in self.loops],
            "seconds": {"median": self.seconds[0], "quantile_99": self.seconds[1]},
            "simulations": self.simulations,
            "scenarios": self.scenarios,
            "seed": self.seed,
            "others": self.others.tolist(),
            "calm": self.calm,
            "interrupted": self.interrupted,
            "remarks": list(self.remarks),
        }  # fmt: skip


def tune_mpc(
    plant: Source,
    reference: ArrayLike,
    *,
    period: float | str | None = None,
    values: Mapping[str, float] | None = None,
    limits: Limits | None = None,
    stroke: tuple[float, float] | None = None,
    delay: int = 0,
    noise: float | None = None,
    horizon: int | None = None,
    preview: bool = True,
    scenarios: int = 0,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> TunedMPC:
    """Choose horizon, weight and filter of an :class:`MPC` for given references.

    The horizon is the shortest of 5 to 80 periods whose loop errs by 2 % more than the best one at
    most. Weight of the moves and noise of the drive are searched by Nelder and Mead's simplex for
    the smallest rms error of the loop, in the mean over the fit's own values and the scenarios.
    The filter passes over a reading that is further from what it expects than the whole range that
    the drive reaches: whatever the model lacks, an actuator is never that far off.

    Args:
        plant: a fit, the JSON of one, or a model with ``values``.
        reference: (N,) [m], one value a period, or several of them.
        period: of the sampling [s]; that of the record unless given.
        values: SI values by full name, which go before those of the plant.
        limits: of the drive.
        stroke: lowest and highest reading [m].
        delay: whole periods that computing takes.
        noise: standard deviation of the sensor [m]; what the fit left unless given.
        horizon: in periods, where it is given.
        preview: whether the reference is known before.
        scenarios: draws from the fit's covariance on which the loop is judged as well.
        seed: of the draws, and of the noise.
        progress: told how it goes.

    Ctrl-C gives the best so far.

    Raises:
        InputError: references that are none or that the limits or the stroke do not reach, or a
            delay as long as the horizon.
    """
    what = task(
        plant, reference, period=period, values=values, limits=limits, delay=delay, seed=seed,
        scenarios=scenarios, noise=noise,
    )  # fmt: skip
    if stroke is not None and stroke[0] < stroke[1]:
        _refuse_beyond(what.asked.references, stroke)
    if horizon is not None:
        whole(horizon, "horizon", 1)
    search = _Search(what, stroke, preview, progress)
    given = (horizon,) if horizon is not None else tuple(
        n for n in _HORIZONS if n > what.asked.delay
    )  # fmt: skip
    if not given:
        raise InputError(
            f"The delay of {what.asked.delay} periods is as long as the longest horizon of "
            f"{_HORIZONS[-1]}: give a longer horizon, or sample more slowly."
        )
    return search.run(given)


def _refuse_beyond(references: Sequence[FloatArray], stroke: tuple[float, float]) -> None:
    for one in references:
        if one.min() < stroke[0] or one.max() > stroke[1]:
            raise InputError(
                f"The reference goes from {show(float(one.min()), 'm')} to "
                f"{show(float(one.max()), 'm')}, and the stroke allows {show(stroke[0], 'm')} to "
                f"{show(stroke[1], 'm')}: ask for less, or allow more."
            )


def _shortest(errors: Sequence[tuple[int, float]]) -> int:
    """Of horizons with their errors the shortest one that is nearly as good as the best."""
    best = min(e for _, e in errors)
    return next(n for n, e in errors if e <= _ENOUGH * best)


@final
class _Search:
    """Loops of one task, and the best of them."""

    def __init__(
        self, what: Task, stroke: tuple[float, float] | None, preview: bool,
        progress: Callable[[str], None] | None,
    ) -> None:  # fmt: skip
        self._what, self._stroke, self._preview = what, stroke, preview
        self._progress, self._count = progress, 0
        self._best: tuple[float, FloatArray] = (np.inf, _START)
        plants = self._drawn(what.scenarios, what.asked.seed)
        self._plants = (what.plant.numbers, *plants)
        self._filtered = what.asked.noise or 1e-9
        spans = [float(np.ptp(r)) for r in what.asked.references]
        self._span = max(spans) or float(np.abs(what.asked.references[0]).max())
        if not self._span > 0.0:
            raise InputError("A reference that is zero throughout asks for nothing.")
        gain = np.asarray(linearise(what.plant.model, what.plant.numbers).dcgain()).real
        # A plant without a gain is refused by the controller.
        self._volts = self._span / (abs(float(gain.ravel()[0])) or 1.0)

    def _drawn(self, count: int, seed: int) -> tuple[Values, ...]:
        plant = self._what.plant
        draws = drawn(plant, count, seed) if count else ()
        own = plant.numbers
        return tuple(
            own.with_({k: v for k, v in d.of_record(0).items() if k in own}) for d in draws
        )

    def controller(self, x: FloatArray, horizon: int, reference: FloatArray | None) -> MPC:
        """With these logarithms of weight and noise; a reference that is known before."""
        plant, asked = self._what.plant, self._what.asked
        return MPC(
            plant.model, plant.numbers, period=asked.period, span=self._span, horizon=horizon,
            limits=asked.limits, stroke=self._stroke, weight=float(10.0 ** x[0]),
            noise=self._filtered, drive_noise=self._drive_noise(x), delay=asked.delay,
            gate=self._what.width or float("inf"), reference=reference,
        )  # fmt: skip

    def _ahead(self, reference: FloatArray) -> FloatArray | None:
        return reference if self._preview else None

    def _drive_noise(self, x: FloatArray) -> float:
        """Of the filter [V]."""
        return float(10.0 ** x[1]) * self._volts

    def error(self, x: FloatArray, horizon: int, most: int | None = None) -> float:
        """Mean over references and the fit's values and scenarios of the rms error [m]."""
        asked: Asked = self._what.asked
        each = [
            self._loop(self.controller(x, horizon, self._ahead(r)), values, k).rms
            for k, r in enumerate(asked.references)
            for values in self._plants[:most]
        ]
        found = float(np.mean(each))
        self._count += len(each)
        if most is None and found < self._best[0]:
            self._best = found, np.array(x)
        if self._progress is not None:
            self._progress(f"loop {self._count}, horizon {horizon}, error {show(found, 'm')} rms")
        return found

    def _loop(self, controller: MPC, values: Values, index: int) -> ClosedLoop:
        asked = self._what.asked
        return close_loop(
            ModelPlant(self._what.plant.model, values), controller, asked.references[index],
            period=asked.period, limits=asked.limits, delay=asked.delay, noise=asked.noise,
            seed=asked.seed + index,
        )  # fmt: skip

    def run(self, given: Sequence[int]) -> TunedMPC:
        """The shortest of these horizons that does, and the best weights for it.

        Raises:
            KeyboardInterrupt: it came before the first horizon was judged.
        """
        errors: list[tuple[int, float]] = []
        interrupted = False
        try:
            for n in given:
                errors.append((n, self.error(_START, n, 1)))
            optimize.minimize(
                self.error, _START, (_shortest(errors),), method="Nelder-Mead",
                bounds=optimize.Bounds(_LOW, _HIGH),
                options={"maxfev": _MOST, "xatol": 0.05, "fatol": 1e-12, "initial_simplex": (
                    _START + np.array([[0.0, 0.0], [-1.0, 0.0], [0.0, 0.5]])
                )},
            )  # fmt: skip
        except KeyboardInterrupt:
            if not errors:
                raise
            interrupted = True
        return self.told(_shortest(errors), tuple(errors), interrupted)

    def told(
        self, horizon: int, horizons: tuple[tuple[int, float], ...], interrupted: bool
    ) -> TunedMPC:
        """The best controller, run on the fit's values and on others."""
        what, asked = self._what, self._what.asked
        x = self._best[1]
        controllers = [self.controller(x, horizon, self._ahead(r)) for r in asked.references]
        clocks = [_Clocked(one) for one in controllers]
        numbers = what.plant.numbers
        loops = tuple(self._loop(c, numbers, k) for k, c in enumerate(clocks))  # type: ignore[arg-type]
        spent = np.concatenate([c.spent for c in clocks])
        others: list[float] = []
        try:
            if what.scenarios and not interrupted:
                if self._progress is not None:
                    self._progress(f"checking {CHECKS} other actuators that the record allows")
                for values in self._drawn(CHECKS, asked.seed + _APART):
                    others.append(self._loop(controllers[0], values, 0).rms)
        except KeyboardInterrupt:
            interrupted = True
        middle, late = np.quantile(spent, (0.5, 0.99))
        return TunedMPC(
            controllers[0], asked.period, asked.limits, horizon, horizons, float(10.0 ** x[0]),
            self._filtered, self._drive_noise(x), loops, (float(middle), float(late)),
            self._count + len(loops) + len(others), what.scenarios, asked.seed, np.array(others),
            calm(self.controller(x, horizon, None), what), what.remarks, interrupted,
        )  # fmt: skip


@final
class _Clocked:
    """A controller whose samples are timed."""

    def __init__(self, controller: MPC) -> None:
        self._controller = controller
        self.spent: list[float] = []

    def begin(self) -> Any:
        """As the controller's own."""
        return self._controller.begin()

    def act(
        self, state: Any, reference: float, reading: float, period: float, low: float, high: float
    ) -> tuple[float, Any]:
        """The same, and how long it took."""
        began = time.thread_time()
        answer = self._controller.act(state, reference, reading, period, low, high)
        self.spent.append(time.thread_time() - began)
        return answer
