"""Controllers in a loop in which everything goes wrong: no drive that is none, no limit passed.

Sensors say what is no number, stick, saturate, lose samples or shout; references jump, lie out of
reach, or are no numbers; limits close so far that the drive is outside of them, or let it hardly
move. What is asked of every controller at every sample: a finite drive within its range, and within
its slew rate unless the range itself has moved; and that it follows again afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from time import thread_time
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.table import table
from piezo_opt.control import (
    InverseCompensation,
    Limits,
    ModelPlant,
    tune_lqr,
    tune_mpc,
    tune_pid,
)
from piezo_opt.effects import BoucWen, Creep, PiezoGain, SecondOrder
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

SCHEMA: Final = "piezo_opt/faults/1"
STAGE: Final = PiezoGain() + BoucWen() + Creep(elements=1) + SecondOrder()
VALUES: Final = {
    "piezo_gain.d": 1.5e-7, "bouc_wen.alpha": 5e-8, "bouc_wen.beta": 0.03,
    "bouc_wen.gamma": -0.005, "creep.c": 0.05, "creep.tau": 1.0,
    "second_order.omega": 2.0 * np.pi * 200.0, "second_order.zeta": 0.03,
}  # fmt: skip
PERIOD: Final = 1e-3
LIMITS: Final = Limits(-10.0, 60.0, 8.5e3)
NOISE: Final = 5e-9
EPISODE: Final = 1000
"""Samples: a fault in the second quarter; the last quarter, when all is well again, is judged."""

FAULTS: Final = (
    "no number", "lost samples", "stuck", "saturated", "spikes", "reference jumps",
    "reference out of reach", "reference no number", "range closes", "slew rate falls", "all",
)  # fmt: skip


@final
@dataclass(frozen=True)
class Endured:
    """What a controller did.

    Attributes:
        controller: its name.
        steps: of the loop; ``faulty`` of them with a fault.
        not_finite: drives that are no number.
        beyond: farthest that a drive was out of its range, or moved beyond its slew rate [V].
        after: rms error in the last quarters of the episodes, when all was well again [m].
        worst: the largest rms of one of these [m]; ``worst_fault`` what had happened there.
        undisturbed: rms error in the last quarters of episodes without a fault [m].
        median, quantile: processor's time of a sample, in the middle and 99.9 % [s].
    """

    controller: str
    steps: int
    faulty: int
    not_finite: int
    beyond: float
    after: float
    worst: float
    worst_fault: str
    undisturbed: float
    median: float
    quantile: float


@final
@dataclass(frozen=True)
class Faults:
    """All controllers."""

    rows: tuple[Endured, ...]

    def __str__(self) -> str:
        header = (
            "controller", "steps", "faulty", "no number", "beyond limits", "error after",
            "worst", "had seen", "undisturbed", "a sample", "99.9 %",
        )  # fmt: skip
        lines = [
            (
                r.controller, str(r.steps), str(r.faulty), str(r.not_finite), f"{r.beyond:.1g} V",
                show(r.after, "m"), show(r.worst, "m"), r.worst_fault, show(r.undisturbed, "m"),
                show(r.median, "s"), show(r.quantile, "s"),
            )
            for r in self.rows
        ]  # fmt: skip
        return table(header, lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data, SI units, with a ``schema`` key."""
        return {"schema": SCHEMA, "rows": [asdict(row) for row in self.rows]}


def controllers() -> Mapping[str, Any]:
    """What is tried: designs for a triangle of 10 Hz on the plant itself."""
    time = PERIOD * np.arange(300)
    saw = 5e-6 * (1.0 - np.abs(2.0 * ((10.0 * time) % 1.0) - 1.0))
    asked: dict[str, Any] = {
        "period": PERIOD, "values": VALUES, "limits": LIMITS, "noise": NOISE,
    }  # fmt: skip
    return {
        "PID": tune_pid(STAGE, saw, **asked).controller,
        "LQR": tune_lqr(STAGE, saw, **asked).controller,
        "inverse": InverseCompensation.of_values(STAGE, VALUES),
        "MPC": tune_mpc(STAGE, saw, horizon=10, preview=False, **asked).controller,
    }  # fmt: skip


def endure(
    steps: int = 1_000_000,
    seed: int = 0,
    *,
    only: tuple[str, ...] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Faults:
    """Run every controller for its share of the steps.

    Args:
        steps: of all controllers together.
        seed: of faults, references and noise.
        only: names of controllers; all unless given.
        progress: told how far it is.
    """
    chosen = {k: c for k, c in controllers().items() if only is None or k in only}
    rows = []
    for name, controller in chosen.items():
        episodes = max(len(FAULTS) + 1, steps // len(chosen) // EPISODE)
        rows.append(_endured(name, controller, episodes, seed, progress))
    return Faults(tuple(rows))


def _endured(
    name: str, controller: Any, episodes: int, seed: int, progress: Callable[[str], None] | None
) -> Endured:
    generator = np.random.default_rng(seed)
    plant = ModelPlant(STAGE, VALUES)
    position, state, drive = plant.begin(0.0), controller.begin(), 0.0
    spent = np.empty(episodes * EPISODE)
    bad, beyond, faulty = 0, 0.0, 0
    quiet: list[float] = []
    after: list[tuple[float, str]] = []
    for episode in range(episodes):
        if progress is not None:
            progress(f"{name}, episode {episode + 1} of {episodes}")
        fault = ("none", *FAULTS)[episode % (len(FAULTS) + 1)]
        wanted, given, limits, wrong = _episode(fault, generator)
        faulty += int(wrong.sum())
        errors = np.empty(EPISODE)
        stuck = position
        for k in range(EPISODE):
            reading = position + NOISE * float(generator.normal())
            stuck = stuck if wrong[k] else reading
            seen = _seen(fault, reading, stuck, generator) if wrong[k] else reading
            held = limits if wrong[k] else LIMITS
            low, high = held.around(drive, PERIOD)
            began = thread_time()
            asked, state = controller.act(state, float(given[k]), seen, PERIOD, low, high)
            spent[episode * EPISODE + k] = thread_time() - began
            if not np.isfinite(asked):
                bad += 1
                asked = drive
            beyond = max(beyond, low - asked, asked - high)
            drive = min(max(asked, low), high)
            errors[k] = position - wanted[k]
            position = plant.advance(drive, PERIOD)
        rms = float(np.sqrt(np.mean(errors[3 * EPISODE // 4 :] ** 2)))
        if fault == "none":
            quiet.append(rms)
        else:
            after.append((rms, fault))
    worst = max(after)
    middle, late = np.quantile(spent, (0.5, 0.999))
    square = float(np.sqrt(np.mean([r * r for r, _ in after])))
    return Endured(
        name, episodes * EPISODE, faulty, bad, beyond, square, *worst,
        float(np.sqrt(np.mean(np.square(quiet)))), float(middle), float(late),
    )  # fmt: skip


def _episode(
    fault: str, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray, Limits, NDArray[np.bool_]]:
    """What is wanted (N,), what the controller is told of it, limits, and where faults are."""
    time = np.arange(EPISODE)
    every = "all" if fault == "all" else fault
    wanted = 2.5e-6 - 2.0e-6 * np.cos(2.0 * np.pi * 4.0 * PERIOD * time)
    given = wanted.copy()
    wrong = (time >= EPISODE // 4) & (time < EPISODE // 2) & (fault != "none")
    if every in ("reference jumps", "all"):
        given[wrong] = 1e-6 * generator.choice([0.0, 1.0, 4.5], int(wrong.sum()))
    if every in ("reference out of reach", "all"):
        given[wrong] = generator.choice([-1e3, 1e-3, 1e300], int(wrong.sum()))
    if every in ("reference no number", "all"):
        given[wrong & (generator.random(EPISODE) < 0.5)] = np.nan
    middle = float(generator.uniform(LIMITS.low, LIMITS.high - 5.0))
    limits = LIMITS
    if every in ("range closes", "all"):
        limits = Limits(middle, middle + float(generator.uniform(1e-3, 5.0)), LIMITS.slew)
    if every == "slew rate falls":
        limits = Limits(LIMITS.low, LIMITS.high, 10.0 ** float(generator.uniform(-3.0, 2.0)))
    return wanted, given, limits, wrong


def _seen(fault: str, reading: float, stuck: float, generator: np.random.Generator) -> float:
    """What a broken sensor says."""
    kind = fault
    if fault == "all":
        kind = ("no number", "lost samples", "stuck", "saturated", "spikes")[
            int(generator.integers(5))
        ]
    if kind == "no number":
        return (float("nan"), float("inf"), -float("inf"))[int(generator.integers(3))]
    if kind == "lost samples":
        return float("nan") if generator.random() < 0.7 else reading
    if kind == "stuck":
        return stuck
    if kind == "saturated":
        return min(max(reading, 1e-6), 2e-6)
    if kind == "spikes" and generator.random() < 0.2:
        return float(10.0 ** generator.uniform(-9.0, 308.0) * generator.choice([-1.0, 1.0]))
    return reading
