"""Whether the drive that is advised for a group resolves it: plants that the record allows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from piezo_opt.diagnosis.advice import advise
from piezo_opt.effects import AmplifierLag, BoucWen, Delay, Offset, PiezoGain
from piezo_opt.identification import Fit, Identification, solve
from piezo_opt.measurement import FloatArray, Measurement
from piezo_opt.signals import best_between
from piezo_opt.signals.answer import Answer, draws
from piezo_opt.simulation import simulate

_NOISE: Final = 50e-9
_RATE: Final = 1000.0
_SLEW: Final = 2000.0
"""[V/s] of the drive that is computed; no edge faster than 2 V a sample."""
_TRUTH: Final = {
    "piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 2e-2,
    "bouc_wen.gamma": -5e-3, "amplifier_lag.share": 1.0, "amplifier_lag.tau": 2e-3,
}  # fmt: skip


@final
@dataclass(frozen=True)
class Resolved:
    """What became of a group on one drive.

    Attributes:
        advice: whose drive: of the diagnosis, or computed between the models.
        drive: in words.
        sigmas: that were promised.
        plants: played.
        right: in which the model that is true fitted best.
    """

    advice: str
    drive: str
    sigmas: float
    plants: int
    right: int


def resolved(
    plants: int = 100, *, progress: Callable[[str], None] | None = None
) -> tuple[Resolved, ...]:
    """A lag and a delay, the same on a slow sine, on the drives advised for the two.

    Half of the plants have the one and half the other, with values that its fit to the sine thinks
    possible. Each is played with noise; both models are fitted to sine and new record together.

    Args:
        plants: in all.
        progress: told where it is.
    """
    base = PiezoGain() + BoucWen() + Offset()
    models = {"amplifier_lag": base + AmplifierLag(), "delay": base + Delay()}
    time = np.arange(1000) / _RATE
    drive = 50.0 - 50.0 * np.cos(2.0 * np.pi * 2.0 * time)
    record = Measurement(time, drive, drive)
    clean = simulate(models["amplifier_lag"], record, _TRUTH).reading
    noise = _NOISE * np.random.default_rng(0).normal(size=time.size)
    record = record.with_(position=clean + noise)
    fits = {name: solve(Identification(model, record)) for name, model in models.items()}
    told = advise(solve(Identification(base, record)), [AmplifierLag(), Delay()], _NOISE)
    made = best_between(fits, evaluations=40, slew=_SLEW)
    found = []
    for advice, volts, said, sigmas in (
        ("diagnosis", told.drive.samples(_RATE)[1], told.drive.description, told.sigmas),
        ("signals.best_between", made.drive.values, made.drive.description, made.sigmas),
    ):
        right = _right(fits, record, volts, plants, advice, progress or (lambda _: None))
        found.append(Resolved(advice, said, sigmas, plants, right))
    return tuple(found)


def _right(
    fits: dict[str, Fit],
    record: Measurement,
    volts: FloatArray,
    plants: int,
    advice: str,
    tell: Callable[[str], None],
) -> int:
    rng = np.random.default_rng(3)
    right = 0
    for number in range(plants):
        true = list(fits)[number % len(fits)]
        answer = Answer(fits[true], _RATE)
        # The first of the draws is the fit itself: the second of each seed is another plant.
        numbers = draws(answer, 2, number)[1]
        clean = answer.sharp(volts, numbers)
        reading = clean + _NOISE * rng.normal(size=volts.size)
        new = answer.record(volts, reading).rename("new")
        left = {
            name: solve(Identification(fit.model, (record, new))).rms for name, fit in fits.items()
        }
        right += min(left, key=lambda name: left[name]) == true
        tell(f"{advice}, plant {number + 1} of {plants}")
    return right
