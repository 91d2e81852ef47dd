"""The one test of what a fit leaves: is it noise?"""

from __future__ import annotations

from piezo_opt.diagnosis.noise import noise_floor
from piezo_opt.diagnosis.structure import structure
from piezo_opt.identification import Fit

ABOVE = 1.5
"""Residual over the floor above which more than half of its squares are none of the floor's."""


def is_noise(fit: Fit) -> bool:
    """Whether nothing is left but noise, as far as the record can tell."""
    floor = noise_floor(fit)
    return fit.rms <= ABOVE * floor.rms and not structure(fit, floor).left
