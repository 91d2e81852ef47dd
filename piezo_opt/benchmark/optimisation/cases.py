"""Problems for optimisers: short records, from a thesis' loop to valleys and many minima.

A variant is the same problem perturbed: other true values and noise where the record is made here,
other noise on top where it was measured. So nobody wins by knowing one record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.benchmark.optimisation import drives
from piezo_opt.datasets import load
from piezo_opt.effects import (
    AmplifierLag,
    Asymmetry,
    BoucWen,
    Creep,
    Drift,
    Friction,
    GeneralisedBoucWen,
    HystereticForce,
    Model,
    Offset,
    PiezoGain,
    PrandtlIshlinskii,
    Saturation,
    SecondMode,
    SecondOrder,
)
from piezo_opt.identification import Identification, Loss, Shape, Start, solve
from piezo_opt.measurement import Measurement
from piezo_opt.simulation import Initial, simulate
from piezo_opt.values import Values

FloatArray = NDArray[np.float64]

_NOISE: Final = 1e-3
"""Standard deviation of the noise over the stroke: that of a good capacitive sensor."""
_PERTURBED: Final = 1.2
"""Factor within which true values of a variant lie."""


@final
@dataclass(frozen=True, eq=False)
class Case:
    """One problem.

    Attributes:
        name: in tables.
        says: what it asks, in a line.
        pose: a variant's question, and values near its best.
        reach: factor within which starts lie around the best values.
        hard: whether it has several minima, a long valley, or corners.
        cut: into how many each sub-step is cut. Where a loop crosses zero within a sub-step the
            scheme's error has a corner in the unknowns. These corners are minima of their own,
            which are shallow (1e-4 of the cost and less) and of no account but where somebody asks
            for 1e-6: there the sub-steps are cut until the corners are smaller.
    """

    name: str
    says: str
    pose: Callable[[int], tuple[Identification, Mapping[str, float]]]
    reach: float = 3.0
    hard: bool = False
    cut: int = 1


@final
@dataclass(frozen=True, eq=False)
class _Made:
    """A record that is simulated here."""

    model: Model
    truth: Mapping[str, float]
    drive: Callable[[], tuple[FloatArray, FloatArray]]
    question: Mapping[str, Any] = field(default_factory=dict)
    wrong: float = 0.0
    """Share of the readings that are wrong by a tenth of the stroke."""

    def __call__(self, variant: int) -> tuple[Identification, Mapping[str, float]]:
        generator = np.random.default_rng([17, variant])
        truth = {k: v * self._factor(generator, variant) for k, v in self.truth.items()}
        time, drive = self.drive()
        bare = Measurement(time, drive, np.linspace(0.0, 1e-6, time.size), name="made")
        values = {**Values.nominal(self.model), **truth}
        clean = simulate(self.model, bare, values, initial=Initial.REST, tolerance=1e-7).reading
        stroke = float(np.ptp(clean))
        reading = clean + generator.normal(scale=_NOISE * stroke, size=time.size)
        off = generator.uniform(size=time.size) < self.wrong
        reading[off] += 0.1 * stroke * generator.choice([-1.0, 1.0], size=int(off.sum()))
        record = bare.with_(position=reading, allow_saturated=True)
        asked = Identification(self.model, record, start=Start.REST, **self.question)
        return asked, {k: v for k, v in truth.items() if k not in asked.fixed}

    @staticmethod
    def _factor(generator: np.random.Generator, variant: int) -> float:
        return float(_PERTURBED ** generator.uniform(-1.0, 1.0)) if variant else 1.0


@final
@dataclass(frozen=True, eq=False)
class _Measured:
    """A record that somebody measured."""

    record: Callable[[], Measurement]
    model: Model
    question: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, variant: int) -> tuple[Identification, Mapping[str, float]]:
        record = self.record()
        question = Identification(self.model, record, **self.question)
        fit = solve(question, statistics=False)
        if variant:
            noise = np.random.default_rng([17, variant]).normal(size=len(record))
            record = record.with_(
                position=record.position + 0.5 * fit.rms * noise, allow_saturated=True
            )
            question = question.with_records(record)
            fit = solve(question, start=fit, statistics=False)
        return question, fit.values


def _flexure() -> Measurement:
    """Two seconds of the flexure stage, every second sample."""
    whole = load("flexure-stage").slice(0.5, 3.5)
    return Measurement(whole.time[::2], whole.drive[::2], whole.position[::2], name="flexure stage")


_LOOP: Final = {
    "piezo_gain.d": 1.4e-7, "bouc_wen.alpha": 4e-8, "bouc_wen.beta": 0.05,
    "bouc_wen.gamma": 0.01, "offset.y0": 3e-7,
}  # fmt: skip
_MECHANICS: Final = {"second_order.omega": 1130.0, "second_order.zeta": 0.08}
_STILL: Final = PiezoGain() + BoucWen() + Offset()
_MOVING: Final = PiezoGain() + BoucWen() + SecondOrder() + Offset()


CASES: Final[Mapping[str, Case]] = {
    one.name: one
    for one in (
        Case(
            "thesis_loop", "the thesis' own loop, its mechanics known: 51 readings, 4 unknowns",
            _Measured(
                lambda: load("thesis/hysteresis"), PiezoGain() + BoucWen() + SecondOrder(),
                {
                    "fixed": {"second_order.omega": 8.0321, "second_order.zeta": 0.1992},
                    "start": Start.REST,
                },
            ),
        ),
        Case(
            "thesis_history", "the same loop with offset and history unknown: nearly redundant",
            _Measured(lambda: load("thesis/hysteresis"), _STILL), hard=True, cut=64,
        ),
        Case(
            "flexure_stage", "two seconds of a measured flexure stage",
            _Measured(_flexure, _STILL), cut=16,
        ),
        Case("minor_loops", "Bouc-Wen in triangles of many heights",
             _Made(_STILL, _LOOP, drives.triangles)),
        Case("resonance", "a loop behind a resonance, a chirp",
             _Made(_MOVING, {**_LOOP, **_MECHANICS}, drives.chirp), reach=1.3),
        Case("far_resonance", "the same, started up to three times beside the resonance",
             _Made(_MOVING, {**_LOOP, **_MECHANICS}, drives.chirp), hard=True),
        Case(
            "hysteretic_force", "a mass on a hysteretic spring under a multisine: the public "
            "Bouc-Wen benchmark, cut short",
            _Made(
                PiezoGain() + SecondOrder() + HystereticForce(),
                {
                    "piezo_gain.d": 2e-5, "second_order.omega": 158.1, "second_order.zeta": 0.0158,
                    "hysteretic_force.alpha": 2.5e4, "hysteretic_force.beta": 1e3,
                    "hysteretic_force.gamma": 0.8, "hysteretic_force.delta": -1.1,
                },
                drives.multisine,
                {"fixed": {"hysteretic_force.beta": 1e3}},
            ),
            reach=1.3, hard=True,
        ),
        Case(
            "creep", "a loop that creeps on a staircase",
            _Made(
                PiezoGain() + BoucWen() + Creep() + Offset(),
                {**_LOOP, "creep.c": 0.03, "creep.tau": 0.1}, drives.staircase,
            ),
        ),
        Case(
            "free_exponent", "the exponent of the loop unknown: a long valley",
            _Made(_STILL, {**_LOOP, "bouc_wen.n": 1.4}, drives.triangles,
                  {"free": ("bouc_wen.n",)}),
            reach=2.0, hard=True,
        ),
        Case(
            "friction", "a guide that sticks: corners wherever it turns",
            _Made(
                PiezoGain() + SecondOrder() + Friction() + Offset(),
                {
                    "piezo_gain.d": 1.4e-7, "second_order.omega": 900.0, "second_order.zeta": 0.1,
                    "friction.F": 0.6, "friction.z0": 4e-7, "offset.y0": 3e-7,
                },
                drives.slow_and_fast,
            ),
            reach=1.5, hard=True,
        ),
        Case(
            "two_modes", "two resonances that may take each other's place",
            _Made(
                _MOVING + SecondMode(),
                {
                    **_LOOP, **_MECHANICS, "second_mode.g": 0.08, "second_mode.omega": 1900.0,
                    "second_mode.zeta": 0.04,
                },
                drives.chirp,
            ),
            reach=1.6, hard=True,
        ),
        Case(
            "play_operators", "ten play operators: corners in the unknowns",
            _Made(
                PiezoGain() + PrandtlIshlinskii(10) + Offset(),
                {
                    "piezo_gain.d": 1.4e-7, "prandtl_ishlinskii.rho": 4e-8,
                    "prandtl_ishlinskii.decay": 2.0, "prandtl_ishlinskii.r": 40.0,
                    "offset.y0": 3e-7,
                },
                drives.triangles,
                {"fixed": {"prandtl_ishlinskii.above": 0.0}},
            ),
            hard=True,
        ),
        Case(
            "lag_and_saturation", "an amplifier that lags and saturates",
            _Made(
                AmplifierLag() + Saturation() + PiezoGain() + BoucWen() + Offset(),
                {
                    **_LOOP, "amplifier_lag.share": 1.0, "amplifier_lag.tau": 0.02,
                    "saturation.s": 0.8, "saturation.v_s": 45.0,
                },
                drives.staircase,
                {"fixed": {"amplifier_lag.share": 1.0}},
            ),
            reach=2.0,
        ),
        Case(
            "outliers", "one reading in twenty wrong, a robust loss",
            _Made(_STILL, _LOOP, drives.triangles,
                  {"loss": Loss(Shape.HUBER, 3e-8)}, wrong=0.05),
        ),
        Case(
            "asymmetric_drift", "a lopsided loop that drifts",
            _Made(
                PiezoGain() + BoucWen() + Asymmetry() + Offset() + Drift(),
                {**_LOOP, "asymmetry.delta": 4e-11, "drift.rate": 4e-8}, drives.triangles,
            ),
        ),
        Case(
            "normalised_loop", "the normalised Bouc-Wen law with all its shapes",
            _Made(
                PiezoGain() + GeneralisedBoucWen() + Offset(),
                {
                    "piezo_gain.d": 1.4e-7, "generalised_bouc_wen.kappa": 8e-7,
                    "generalised_bouc_wen.rho": 0.05, "generalised_bouc_wen.sigma": 1.2,
                    "generalised_bouc_wen.n": 1.5, "offset.y0": 3e-7,
                },
                drives.triangles,
            ),
            reach=2.0, hard=True,
        ),
    )
}  # fmt: skip
"""Problems by name."""
