"""Whether what is left is noise: structure that no effect has explained."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.following import follows_drive
from piezo_opt.diagnosis.noise import REMEMBERED, NoiseFloor, correlations, noise_floor
from piezo_opt.diagnosis.slow_noise import LEAST
from piezo_opt.identification import Fit
from piezo_opt.identification.periodic import period
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

_SLOW = 5.0
"""Residual over the high-frequency floor beyond which noise would have to be very slow (a
first-order correlation above 0.92 from sample to sample)."""
_TOLD = 3.0
"""The same where the spectrum tells that it is no such noise."""
_RARE = 1e-5
_MATERIAL = 1.06
"""Residual over the floor below which what is left is less than a third of the noise."""


@final
@dataclass(frozen=True)
class Structure:
    """Signs of structure in a residual.

    Attributes:
        left: whether there is structure beyond noise.
        clues: sentences, one for each sign.
        only_elsewhere: whether all of them are about another record than the fitted one.
    """

    left: bool
    clues: tuple[str, ...]
    only_elsewhere: bool = False


@lru_cache(maxsize=REMEMBERED)
def structure(fit: Fit, noise: NoiseFloor) -> Structure:
    """Look for what noise does not do: follow the drive, repeat with the position, come in bursts,
    exceed the floor."""
    clues: list[str] = []
    if noise.measured and fit.rms > 1.1 * noise.high:
        clues.append(
            f"The residual ({show(fit.rms, 'm')}) is above the measured noise "
            f"({show(noise.rms, 'm')})."
        )
    if not noise.measured and fit.rms > (_TOLD if _tells(fit) else _SLOW) * noise.rms:
        clues.append(
            f"The residual ({show(fit.rms, 'm')}) is {fit.rms / noise.rms:.2g} times the floor "
            f"at the record's highest frequencies ({show(noise.rms, 'm')}): slow noise, or "
            "something that was not recorded."
        )
    point = BasePoint(fit)
    r = point.residual
    if fit.rms > _MATERIAL * noise.rms:
        worst, name = follows_drive(fit, point, noise.rms)
        if worst < _RARE:
            clues.append(f"The residual follows the drive: it correlates with {name}.")
        length = repetition(fit)
        if length is not None:
            clues.append(
                f"The residual repeats with the position, every {show(length, 'm')}: a periodic "
                "error of the sensor (an interferometer's fringes, an encoder's lines)."
            )
    burst = _bursts(r)
    if burst is not None:
        clues.append(burst)
    return Structure(bool(clues), tuple(clues))


def repetition(fit: Fit) -> float | None:
    """Period [m] with which a fit's residual repeats along the reading; None where it does not."""
    found = (
        period(fit.readings[index][record.counted], fit.residual(index))
        for index, record in enumerate(fit.records)
    )
    return next((length for length in found if length is not None), None)


def _tells(fit: Fit) -> bool:
    """Whether the spectrum of a residual tells that it is no first-order noise: a short one or
    uneven samples do not."""
    if not all(record.uniform for record in fit.records):
        return False
    shortest = min(fit.residual(index).size for index in range(len(fit.records)))
    return shortest >= LEAST and correlations(fit) is None


def _bursts(r: FloatArray) -> str | None:
    """Stretches in which the residual is far larger than elsewhere."""
    n = r.size
    if n < 400:
        return None
    windows = np.array_split(r, 40)
    power = np.log([float(np.mean(w**2)) + 1e-300 for w in windows])
    middle = float(np.median(power))
    spread = 1.4826 * float(np.median(np.abs(power - middle)))
    expected = np.sqrt(2.0 / (n / 40.0))
    high = float(power.max() - middle)
    if high > 6.0 * max(spread, expected) and high > np.log(2.0):
        where = int(np.argmax(power))
        return (
            f"The residual comes in bursts: between {100 * where / 40:.0f} and "
            f"{100 * (where + 1) / 40:.0f} % of the record it is {np.exp(0.5 * high):.1f} times "
            "its usual size."
        )
    return None


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
