"""The model for a first fit: what a record can see, and no more."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from piezo_opt.effects.model import Model
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.effects.output.offset import Offset
from piezo_opt.effects.strain.bouc_wen import BoucWen
from piezo_opt.effects.strain.piezo_gain import PiezoGain
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.quick import ENOUGH, quick
from piezo_opt.identification.result import Fit
from piezo_opt.identification.stretch import busiest
from piezo_opt.measurement import Campaign, Measurement
from piezo_opt.measurement.spectra import without_line

_STILL = 3e-10
"""Share of the drive's power near a resonance below which the drive cannot have shown it."""
_SAMPLED = 2.5
"""Fewest samples a cycle."""
_DAMPED = 1.0 / np.sqrt(2.0)
"""Damping ratio from which the response has no peak: a lag would do as well."""


def default_model(
    records: Campaign | Measurement | Iterable[Measurement],
) -> tuple[Model, tuple[str, ...]]:
    """Piezo gain + Bouc-Wen + second order + offset, quasi-static where no resonance is seen.

    The mechanics are kept when, on the first record, they lower the Bayesian information
    criterion by more than 10 and the residual by at least 2 %, with a damping ratio below
    1 / sqrt(2) and a natural frequency that the drive excites and the sampling holds (at least
    2.5 samples a cycle).

    Returns:
        the model, and sentences on what was left out and why.
    """
    record = Campaign.of(records).records[0]
    still = PiezoGain() + BoucWen() + Offset()
    moving = PiezoGain() + BoucWen() + SecondOrder() + Offset()
    short = busiest(record, ENOUGH)
    calm = quick(still, short).squares
    try:
        found = quick(moving, short)
    except ArithmeticError:
        return still, (_sentence(record, "no natural frequency could be fitted"),)
    swinging, values, n = found.squares, found.values, found.residual.size
    gain = n * np.log(calm / swinging) if swinging > 0 else np.inf
    omega, zeta = values["second_order.omega"], values["second_order.zeta"]
    paid = 4.0 * np.log(n) + 20.0
    if gain <= paid or swinging > 0.96 * calm:
        return still, (_sentence(record, "mechanics do not lower the residual"),)
    if zeta >= _DAMPED:
        return still, (
            _sentence(record, f"the best resonance is overdamped (zeta {zeta:.2g}), without peak"),
        )
    if excitation(short, omega) < _STILL:
        return still, (
            _sentence(
                record,
                f"the drive has no power near the best resonance ({omega / 2 / np.pi:.3g} Hz)",
            ),
        )
    if omega * short.step > 2.0 * np.pi / _SAMPLED:
        return still, (
            _sentence(
                record,
                f"the best resonance ({omega / 2 / np.pi:.3g} Hz) has fewer than 2.5 samples a "
                "cycle",
            ),
        )
    return moving, ()


def ringing(question: Identification, foot: Model) -> Identification:
    """The question, with mechanics that are not in the model at the foot held to where they ring.

    Beside what is missing, overdamped mechanics are but another lag.
    """
    joined = [n for n, e in question.model if isinstance(e, SecondOrder) and n not in foot]
    held = {f"{n}.zeta": (SecondOrder.zeta.bounds[0], _DAMPED) for n in joined}
    return replace(question, bounds={**held, **question.bounds}) if held else question


def is_lag(fit: Fit, foot: Model) -> bool:
    """Whether mechanics that are not in the model at the foot ended where they do not ring."""
    joined = [n for n, e in fit.model if isinstance(e, SecondOrder) and n not in foot]
    return any(fit.values[f"{n}.zeta"] >= _DAMPED for n in joined)


def excitation(record: Measurement, omega: float) -> float:
    """Share of the drive's power between 0.7 and 1.4 times an angular frequency [rad/s].

    Of the windowed, detrended drive, on an even grid. A pure sine has less than 1e-10 anywhere
    else; a triangle still has 1e-9 at its two-hundredth harmonic.
    """
    grid = np.linspace(record.time[0], record.time[-1], len(record))
    drive = without_line(np.interp(grid, record.time, record.drive)) * np.hanning(grid.size)
    power = np.abs(np.fft.rfft(drive)) ** 2
    at = 2.0 * np.pi * np.fft.rfftfreq(grid.size, grid[1] - grid[0])
    near = (at > 0.7 * omega) & (at < 1.4 * omega)
    return float(power[near].sum() / power.sum())


def _sentence(record: Measurement, why: str) -> str:
    return (
        f"{record.name}: the model is quasi-static, without mechanics, because the record shows "
        f"no resonance at {record.rate:.4g} samples/s: {why}. To see one, sample at ten times its "
        "frequency and excite it (steps, chirp, multisine)."
    )
