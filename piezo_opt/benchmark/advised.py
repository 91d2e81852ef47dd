"""Whether the drive that a diagnosis advises for a group resolves it, on plants it thinks possible.

Each group is one that the diagnosis itself names: a record with a hidden effect, whose drive lets
another effect imitate it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np

from piezo_opt.diagnosis import Stopped, diagnose
from piezo_opt.diagnosis.advice import Advice, converged
from piezo_opt.effects import (
    AmplifierLag,
    BoucWen,
    Creep,
    CubicStiffness,
    Effect,
    Model,
    NonlinearGain,
    Offset,
    PiezoGain,
    SecondOrder,
)
from piezo_opt.errors import InputError
from piezo_opt.identification import Ending, Fit, Identification, solve
from piezo_opt.measurement import FloatArray, Measurement
from piezo_opt.signals.answer import Answer, draws
from piezo_opt.simulation import simulate

_STILL: Final = PiezoGain() + BoucWen() + Offset()
_MOVING: Final = PiezoGain() + BoucWen() + SecondOrder() + Offset()
_TRUTH: Final = {
    "piezo_gain.d": 1.2e-7, "bouc_wen.alpha": 3e-8, "bouc_wen.beta": 2e-2,
    "bouc_wen.gamma": -5e-3, "offset.y0": 1e-7, "second_order.omega": 2.0 * np.pi * 60.0,
    "second_order.zeta": 0.1,
}  # fmt: skip


@final
@dataclass(frozen=True)
class Ambiguous:
    """A record on which an effect is hidden that others imitate.

    Attributes:
        hidden: the effect, and its own values.
        moving: whether the plant has a resonance (60 Hz).
        drive: "sine" or "triangle", 0..100 V.
        frequency: of it [Hz].
        rate, samples: samples a second [Hz], and how many.
        noise: of the reading [m].
    """

    hidden: tuple[Effect, Mapping[str, float]]
    moving: bool
    drive: str
    frequency: float
    rate: float
    samples: int
    noise: float

    def record(self) -> Measurement:
        """What was measured."""
        time = np.arange(self.samples) / self.rate
        turns = self.frequency * time
        wave = (
            0.5 - 0.5 * np.cos(2.0 * np.pi * turns)
            if self.drive == "sine"
            else np.abs((2.0 * turns + 1.0) % 2.0 - 1.0)
        )
        blank = Measurement(time, 100.0 * wave, 100.0 * wave)
        effect, own = self.hidden
        values = {k: v for k, v in _TRUTH.items() if k in self.base.parameters}
        values |= {f"{effect.name}.{k}": v for k, v in own.items()}
        clean = simulate(self.base + effect, blank, values).reading
        white = np.random.default_rng(0).normal(size=time.size)
        return blank.with_(position=clean + self.noise * white)

    @property
    def base(self) -> Model:
        """The model without what is hidden."""
        return _MOVING if self.moving else _STILL


CASES: Final[Mapping[str, Ambiguous]] = {
    "lag": Ambiguous(
        (AmplifierLag(), {"share": 1.0, "tau": 2e-3}), True, "sine", 5.0, 1e3, 2000, 5e-9
    ),
    "creep": Ambiguous(
        (Creep(elements=1), {"c": 0.05, "tau": 6.0}), False, "triangle", 0.4, 200.0, 2000, 20e-9
    ),
    "stiffening": Ambiguous((CubicStiffness(), {"k3": 2e14}), True, "sine", 5.0, 1e3, 1000, 20e-9),
    "bent gain": Ambiguous((NonlinearGain(), {"k2": 6e-11}), False, "sine", 2.0, 1e3, 1000, 20e-9),
}
"""By what is hidden."""


@final
@dataclass(frozen=True)
class Resolved:
    """What became of a group on the drive that was advised for it.

    Attributes:
        case: of :data:`CASES`.
        group: names that the diagnosis could not tell apart.
        drive: in words.
        sigmas: that were promised.
        here: sigmas between the two most alike on the record itself.
        plants: played.
        right: in which the misfit of the model that is true grew least by the new record.
    """

    case: str
    group: tuple[str, ...]
    drive: str
    sigmas: float
    here: float
    plants: int
    right: int

    def __str__(self) -> str:
        return (
            f"{self.case}: {', '.join(self.group)}: {self.right} of {self.plants} plants resolved, "
            f"{self.sigmas:.1f} sigmas promised ({self.here:.1f} on the record), by {self.drive}"
        )


def resolved(
    plants: int = 100,
    *,
    cases: Sequence[str] = tuple(CASES),
    progress: Callable[[str], None] | None = None,
) -> Iterator[Resolved]:
    """Groups that a diagnosis names, on the drives that it advises for them, one after the other.

    In each plant one member of the group is true, each in turn, with values that its fit to the
    record thinks possible. The advised drive is played on it with noise; the model of every member
    is fitted to old and new record together. What the new record tells is by how much the misfit
    grows: the old one was made with one member, and may speak for that already.

    Args:
        plants: of each case.
        cases: names of :data:`CASES`.
        progress: told where it is.

    Yields:
        each case, as soon as all of its plants are played.

    Raises:
        InputError: there is no such case.
        KeyboardInterrupt: Ctrl-C or a limit of time, within a diagnosis or a fit too.
    """
    for name in cases:
        if name not in CASES:
            raise InputError(f"There is no case {name!r}: choose from {', '.join(CASES)}.")
    for name in cases:
        yield _resolved(name, plants, progress or (lambda _: None))


def _resolved(name: str, plants: int, tell: Callable[[str], None]) -> Resolved:
    case = CASES[name]
    record = case.record()
    tell(f"{name}, diagnosis")
    found = diagnose(_whole(solve(Identification(case.base, record))))
    if found.stopped is Stopped.USER:
        raise KeyboardInterrupt
    step = next(s for s in found.steps if len(s.group) > 1)
    advice = next(a for a in found.experiments if a.group == step.group)
    fits = {n: converged(fit) for n, fit in step.alternatives.items()}
    right = 0
    rng = np.random.default_rng(3)
    for number in range(plants):
        tell(f"{name}, plant {number + 1} of {plants}")
        true = step.group[number % len(fits)]
        noise = case.noise * rng.normal(size=advice.drive.values.size)
        grown = _grown(fits, true, advice, noise, number)
        right += min(grown, key=lambda member: grown[member]) == true
    return Resolved(
        name, step.group, advice.drive.description, advice.sigmas, advice.here, plants, right
    )


def _whole(fit: Fit) -> Fit:
    """The fit: one that was interrupted holds its best so far, which proves nothing here."""
    if fit.outcome.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    return fit


def _grown(
    fits: Mapping[str, Fit], true: str, advice: Advice, noise: FloatArray, seed: int
) -> dict[str, float]:
    """Growth of each member's misfit by the new record [m^2], where one of them is true."""
    answer = Answer(fits[true], advice.drive.rate)
    # The first of the draws is the fit itself: the second of each seed is another plant.
    clean = answer.sharp(advice.drive.values, draws(answer, 2, seed)[1])
    new = answer.record(advice.drive.values, clean + noise).rename("new")
    grown = {}
    for name, fit in fits.items():
        both = replace(fit.question, records=(*fit.records, new), start=None)
        again = _whole(solve(both, start=fit))
        grown[name] = float(np.sum(np.square(again.residuals)) - np.sum(np.square(fit.residuals)))
    return grown
