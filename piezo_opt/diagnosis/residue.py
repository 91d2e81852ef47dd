"""The one test of what a fit leaves: is it noise?"""

from __future__ import annotations

import math

from piezo_opt.diagnosis.noise import NoiseFloor, noise_floor
from piezo_opt.diagnosis.structure import structure
from piezo_opt.identification import Fit


def exceeds(rms: float, floor: NoiseFloor, least: float) -> bool:
    """Whether an error is larger than the floor and an effect of the least worth beside it.

    Args:
        rms: the error [m].
        floor: of the noise; its upper 97.5 % limit is asked.
        least: the least that an effect must explain (see
            :func:`~piezo_opt.diagnosis.evidence.worth`): with squares S of the noise, an effect
            just worth a name leaves (1 + least^2) S.
    """
    return rms > math.hypot(1.0, least) * floor.high


def is_noise(fit: Fit, least: float) -> bool:
    """Whether nothing is left that could bear a name: no more than noise, and no structure."""
    floor = noise_floor(fit)
    return not exceeds(fit.rms, floor, least) and not structure(fit, floor).left
