"""The noise floor, what no model can explain; and what is above it.

One test asks whether what is left of a fit is noise. Noise follows no function of the drive
(:mod:`following`), and after a filter of the first order its power is spread evenly over frequency
and over time (:mod:`colour`). What is left beside all that follows the drive is the floor where it
is noise, and structure is what makes the error larger than that.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.diagnosis.base_point import BasePoint
from piezo_opt.diagnosis.colour import LEVEL, TWICE, Colour, crowded
from piezo_opt.diagnosis.evidence import WORTH
from piezo_opt.diagnosis.following import follows_drive
from piezo_opt.errors import NO_FIT
from piezo_opt.identification import Fit
from piezo_opt.identification.periodic import period
from piezo_opt.measurement import Measurement
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

_REMEMBERED: Final = 8
"""Fits of which the rules that ask in turn are answered once."""
_SLOWEST = 0.92
"""Correlation from sample to sample beyond which noise would be as slow as what it hides: a sample
of 24 carries news."""


@final
@dataclass(frozen=True)
class NoiseFloor:
    """Root mean square of the reading's noise [m], where it comes from, and how sure.

    Attributes:
        rms: estimate [m].
        low, high: 95 % range [m].
        measured: whether it comes from repetitions (else from the residual: a lower bound, unless
            all of it is noise).
        sentence: the same in words.
    """

    rms: float
    low: float
    high: float
    measured: bool
    sentence: str


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


@final
@dataclass(frozen=True)
class _Left:
    """What a fit leaves; if that follows the drive, what is left beside functions of it.

    Attributes:
        p_value: chance of following the drive as much by noise alone.
        followed: the function of the drive that correlates most.
        rms: [m].
        correlation: from sample to sample, of a noise of first order.
        out: share of its power that stands out of that noise's spectrum, or in time; all of it
            where the noise would surely be slower than it may be.
        bursts, burst: the share in time, and the largest burst in words.
        top: mean power at the upper third of the frequencies, beside lines and between bursts, over
            that at all.
        news: samples of white noise whose power is known as well.
    """

    p_value: float
    followed: str
    rms: float
    correlation: float
    out: float
    bursts: float
    burst: str
    top: float
    news: float

    def is_noise(self, least: float) -> bool:
        """Whether less stands out than an effect of the least worth beside noise."""
        return self.out * (1.0 + least**2) < least**2


@lru_cache(maxsize=_REMEMBERED)
def noise_floor(fit: Fit) -> NoiseFloor:
    """Noise of the reading over the records of a fit.

    From the differences between periods where every record has at least two; from those of the
    residual where every drive plays the same again (what the model explains of a reading that still
    settles is no noise; the first repetition is left out where there are three). Otherwise what is
    left beside functions of the drive, if that is noise; if not, white noise at the level of its
    upper third of frequencies, and never less than what rounding alone leaves (step / sqrt(12)).
    The range is that of a chi-squared variance.

    Source: Pintelon & Schoukens (2012), System Identification, 2nd ed., sec. 2.5.
    """
    records = fit.records
    repeated = [_repetitions(fit.residual(index), record) for index, record in enumerate(records)]
    parts = [part for part in repeated if part is not None]
    if len(parts) == len(records):
        freedom = sum((p.shape[0] - 1) * p.shape[1] for p in parts)
        squares = sum(float(np.sum((p - p.mean(axis=0)) ** 2)) for p in parts)
        times = " and ".join(str(p.shape[0]) for p in parts)
        told = f"from what differs between {times} repetitions of the drive"
        return _floor(math.sqrt(squares / freedom), freedom, told, measured=True)
    left, samples = _left(fit), fit.residuals.size
    steps = sum(int(r.counted.sum()) * (r.resolution or 0.0) ** 2 for r in records)
    rounding = math.sqrt(steps / 12.0 / samples)
    if left.is_noise(WORTH) and left.rms > rounding:
        told = "all that is left" if left.p_value >= LEVEL else "what does not follow the drive"
        white = f"noise correlated from sample to sample by {left.correlation:.2f}"
        told += f" looks like {white if left.correlation else 'white noise'}"
        return _floor(left.rms, left.news, told)
    rms = left.rms * math.sqrt(left.top)
    if rms > rounding:
        told = "from the highest frequencies of the record; slower noise would come on top"
    else:
        rms, told = rounding, "what the rounding of the reading alone leaves"
    return _floor(rms, samples / 3.0, told)


def _floor(rms: float, freedom: float, told: str, *, measured: bool = False) -> NoiseFloor:
    low, high = (
        rms * math.sqrt(freedom / scipy.special.chdtri(freedom, tail)) for tail in (0.025, 0.975)
    )
    repeat = "" if measured else " Repeat the drive at least twice to measure it."
    sentence = f"The noise floor is {show(rms, 'm')} rms, {told}.{repeat}"
    return NoiseFloor(rms, low, high, measured, sentence)


def _repetitions(residual: FloatArray, record: Measurement) -> FloatArray | None:
    """(repetitions, samples of one) of a record whose drive plays the same again; else None."""
    if record.periods >= 2:
        return record.repeated_periods()
    samples = record.repetition
    if samples is None or residual.size < 2 * samples:
        return None
    whole = residual.size // samples
    parts = residual[residual.size - whole * samples :].reshape(whole, samples)
    return parts[1:] if whole > 2 else parts


@lru_cache(maxsize=_REMEMBERED)
def _left(fit: Fit) -> _Left:
    lengths = [int(record.counted.sum()) for record in fit.records]
    weight = np.sqrt(np.repeat(fit.question.weights or (1.0,) * len(lengths), lengths))
    r, p_value, followed = weight * fit.residuals, 1.0, ""
    with suppress(*NO_FIT):  # at the edge of stability a fit cannot be simulated again
        point = BasePoint(fit)
        p_value, followed, rest = follows_drive(fit, point)
        r = rest if p_value < LEVEL else point.residual
    colour = Colour.of(r, lengths, 1)
    lines, bursts, burst, top, news = 0.0, 0.0, "", 0.0, 0.0
    ends = np.cumsum(lengths)[:-1]
    for part, white in zip(np.split(r, ends), np.split(colour.whitened(r), ends), strict=True):
        density = colour.density(part.size)
        news += part.size * float(density.mean() ** 2 / np.mean(density**2))
        power = np.square(np.abs(np.fft.rfft(white)[1 : density.size + 1]))
        found = crowded(power, 2)
        coloured, even = power * density, np.ones(part.size)
        own = _beyond(power, even[: power.size], found)
        lines = max(lines, own, _beyond(coloured, density, found))
        # A line that stands out there is no noise either.
        upper = coloured[2 * power.size // 3 :]
        level = float(upper[~crowded(upper, 2)].mean())
        white, power = np.square(white), np.square(part)
        found = crowded(white, 1)
        top += level * float(white[~found].sum() / max(white.sum(), np.finfo(float).tiny))
        share = max(_beyond(white, even, found), _beyond(power, even, found))
        if share > bursts:
            bursts, burst = share, _burst(power, found)
    rho = sum(colour.coefficients)
    slow = rho - 1.96 * math.sqrt(max(0.0, 1.0 - rho**2) / r.size) > _SLOWEST
    return _Left(
        p_value, followed, rms=float(np.sqrt(np.mean((r / weight) ** 2))), correlation=rho,
        out=1.0 if slow else max(lines, bursts), bursts=bursts, burst=burst,
        top=top / max(float(r @ r), np.finfo(float).tiny), news=news,
    )  # fmt: skip


def _beyond(power: FloatArray, shape: FloatArray, found: NDArray[np.bool_]) -> float:
    """Share of all power that, where it was found, is more than is usual elsewhere."""
    if not found.any():
        return 0.0
    usual = shape * float(np.mean((power / shape)[~found]))
    return float(np.sum((power - usual)[found]) / power.sum())


def _burst(power: FloatArray, found: NDArray[np.bool_]) -> str:
    """The stretch that holds most beyond twice the usual power, and how large it is there."""
    usual = float(power[~found].mean())
    total = np.cumsum(power - TWICE * usual)
    end = int(np.argmax(total - np.minimum.accumulate(total)))
    begin = int(np.argmin(total[: end + 1]))
    times = math.sqrt(float(power[begin + 1 : end + 1].mean()) / usual)
    return (
        f"between {100 * begin / power.size:.0f} and {100 * end / power.size:.0f} % of the record "
        f"it is {times:.1f} times its usual size"
    )


@lru_cache(maxsize=_REMEMBERED)
def structure(fit: Fit, noise: NoiseFloor, least: float = WORTH) -> Structure:
    """What noise does not do: exceed the floor, follow the drive, repeat with the position, stand
    out of its spectrum, come in bursts.

    Args:
        fit: the fit.
        noise: the floor.
        least: the least worth of an effect; an error less than that above the floor bears no word.
    """
    if not fit.rms > math.hypot(1.0, least) * noise.rms:
        return Structure(False, ())
    left, clues = _left(fit), []
    size, floor = show(fit.rms, "m"), show(noise.rms, "m")
    if noise.measured and exceeds(fit.rms, noise, least):
        clues.append(f"The residual ({size}) is above the measured noise ({floor}).")
    if left.p_value < LEVEL:
        clues.append(f"The residual follows the drive: it correlates with {left.followed}.")
    length = repetition(fit)
    if length is not None:
        clues.append(
            f"The residual repeats with the position, every {show(length, 'm')}: a periodic "
            "error of the sensor (an interferometer's fringes, an encoder's lines)."
        )
    if left.bursts * (1.0 + least**2) >= least**2:
        clues.append(f"The residual comes in bursts: {left.burst}.")
    if not noise.measured and not left.is_noise(least):
        clues.append(
            f"The residual ({size}) is {fit.rms / noise.rms:.2g} times the floor at the record's "
            f"highest frequencies ({floor}) and has no spectrum of noise: something that was not "
            "recorded, or very slow noise."
        )
    return Structure(bool(clues), tuple(clues))


def repetition(fit: Fit) -> float | None:
    """Period [m] with which a fit's residual repeats along the reading; None where it does not."""
    found = (
        period(fit.readings[index][record.counted], fit.residual(index))
        for index, record in enumerate(fit.records)
    )
    return next((length for length in found if length is not None), None)


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
    return not exceeds(fit.rms, floor, least) and not structure(fit, floor, least).left
