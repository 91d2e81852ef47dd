"""Which drives are worth judging for a fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from piezo_opt.diagnosis.drives import Excitation, candidate_drives
from piezo_opt.identification import Fit

_LONGEST: Final = 20_000
"""Samples of a candidate drive beyond which the advice would take long; drives are cut there."""


def offered_drives(
    fit: Fit, drives: Sequence[Excitation] | None, duration: float | None
) -> Sequence[Excitation]:
    """Those given, else candidates in the range of the first record and as long [s], or cut."""
    if drives is not None:
        return drives
    record = fit.records[0]
    longest = _LONGEST * record.step
    lasting = record.duration + record.step if duration is None else duration
    return candidate_drives(record, min(lasting, longest), _resonance(fit))


def _resonance(fit: Fit) -> float | None:
    """Lowest natural frequency of the base model [Hz]."""
    found = [
        fit.values[f"{name}.{own}"] / (2.0 * np.pi)
        for name, effect in fit.model
        for own, p in effect.parameters.items()
        if effect.structural and p.unit == "rad/s" and f"{name}.{own}" in fit.values
    ]
    return min(found, default=None)
