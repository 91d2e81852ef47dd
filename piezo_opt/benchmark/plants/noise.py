"""What the sensor adds: white or coloured noise, and the resolution of the reading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.signal import lfilter

from piezo_opt.benchmark.plants.physics import Array


@final
@dataclass(frozen=True)
class Noise:
    """Noise of the reading.

    Attributes:
        rms: of everything the sensor adds, the rounding included [m].
        colour: coefficient of the first-order autoregression, 0 for white noise.
        resolution: step of the reading over ``rms``, 0 for none; at most 3.
    """

    rms: float
    colour: float
    resolution: float


def read(random: np.random.Generator, clean: Array, noise: Noise) -> Array:
    """The reading of a clean signal [m].

        e_k = colour e_(k-1) + white_k,    reading = round((clean + e) / step) step

    The random part is scaled so that, with the rounding's step^2 / 12, the whole has the stated
    rms (over a record it does to within its own sampling error).
    """
    white = random.standard_normal(clean.size + 200)
    coloured = lfilter([1.0], [1.0, -noise.colour], white)[200:]
    coloured *= np.sqrt(1.0 - noise.colour**2)
    step = noise.resolution * noise.rms
    level = np.sqrt(max(noise.rms**2 - step**2 / 12.0, 0.0))
    value: Array = clean + level * coloured
    if step > 0.0:
        value = np.round(value / step) * step
    return value
