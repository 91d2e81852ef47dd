"""What a controller may know of a plant: a first model, the diagnosed one, the best there is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from piezo_opt.benchmark.plants.driven import Rig
from piezo_opt.diagnosis import diagnose
from piezo_opt.effects import BoucWen, Creep, PiezoGain, SecondMode, SecondOrder
from piezo_opt.identification import Ending, Fit, Identification, Start, default_model, solve
from piezo_opt.measurement import Between, FloatArray, Measurement

MODELS: Final = ("undiagnosed", "diagnosed", "truth")
"""What is known: the first model of a record, what a diagnosis makes of it, the best model."""


@final
@dataclass(frozen=True, eq=False)
class Known:
    """Three models of one plant.

    Attributes:
        fits: by the names of :data:`MODELS`.
        verdict: of the diagnosis; ``steps`` the effects that it named.
    """

    fits: Mapping[str, Fit]
    verdict: str
    steps: tuple[str, ...]


def known(rig: Rig, samples: int) -> Known:
    """Fit, diagnose, and fit the right structure to the same record without its noise.

    The sensor is zeroed and the actuator fresh when the record begins, and every fit is told so.
    The plant's creep is a dense spectrum and no model of the catalogue: what stands for the truth
    is the right structure with its details free (the distance and the growth of the creep's
    elements, the phase of the second mode).

    Raises:
        KeyboardInterrupt: while something was fitted.
    """
    drive, reading, clean = rig.record(samples)
    record = _measured(rig, drive, reading)
    model = default_model(record)[0]
    if "offset" in model:
        model = model.without("offset")
    first = _solved(Identification(model, record, start=Start.REST))
    # No budget of wall time: what is found must not depend on how busy the machine is.
    found = diagnose(first, threads=1, advise=False, max_time=math.inf)
    if found.stopped is not None:
        raise KeyboardInterrupt
    best = _solved(_truth(rig, _measured(rig, drive, clean)))
    fits = dict(zip(MODELS, (first, found.final, best), strict=True))
    return Known(fits, found.verdict, tuple(step.name for step in found.steps))


def _measured(rig: Rig, drive: FloatArray, reading: FloatArray) -> Measurement:
    time: FloatArray = np.arange(drive.size) / rig.rate
    return Measurement(
        time, drive, reading, name=f"plant {rig.seed}", between=Between.HELD, allow_saturated=True
    )


def _truth(rig: Rig, record: Measurement) -> Identification:
    """The right structure, begun at the plant's own numbers."""
    base, creep, mode = rig.base, rig.creep, rig.mode
    own = {
        "piezo_gain.d": base.gain, "bouc_wen.alpha": base.alpha, "bouc_wen.beta": base.beta,
        "bouc_wen.gamma": base.gamma, "second_order.omega": base.omega,
        "second_order.zeta": base.zeta, "creep.c": 3.0 * creep.intensity,
        "creep.tau": 0.3 * creep.begin, "second_mode.g": mode.sign * mode.intensity,
        "second_mode.omega": mode.omega, "second_mode.zeta": mode.zeta,
        "second_mode.phase": mode.phase,
    }  # fmt: skip
    return Identification(
        PiezoGain() + BoucWen() + Creep(elements=3) + SecondOrder() + SecondMode(), record,
        values=own, free=("second_mode.phase", "creep.power", "creep.spread"), start=Start.REST,
    )  # fmt: skip


def _solved(question: Identification) -> Fit:
    fit = solve(question)
    if fit.outcome.ending is Ending.INTERRUPTED:
        raise KeyboardInterrupt
    return fit
