"""The one test of what a fit leaves: is it noise?"""

from __future__ import annotations

import math

from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.structure import structure
from piezo_opt.identification import Fit

ABOVE = 1.5
"""Residual over the floor above which more than half of its squares are none of the floor's."""


def is_noise(fit: Fit, least: float) -> bool:
    """Whether nothing is left that could bear a name: the floor, and less than an effect of the
    least worth beside it.

    Args:
        fit: the fit.
        least: the least that an effect must explain (see
            :func:`~piezo_opt.diagnosis.evidence.worth`).
    """
    floor = noise_floor(fit)
    return fit.rms <= math.hypot(1.0, least) * floor.high and not structure(fit, floor).left
