"""At which frequencies the error lives, and how much of it follows the drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np
import scipy

from piezo_opt.comparison.misfit import Misfit
from piezo_opt.comparison.over_time import ALARM
from piezo_opt.comparison.words import brief
from piezo_opt.measurement import FloatArray
from piezo_opt.measurement.spectra import densities, density, running_median

_FEWEST: Final = 32
_FEWEST_SEGMENTS: Final = 4.0
_COHERENT: Final = 0.3
"""Share of the error's power that must follow the drive to be worth a sentence."""
_TONE: Final = 0.1
"""Share of the error's power that a tone must have to be worth a sentence."""
_HARMONICS: Final = 7
_NARROW: Final = 0.25
"""Share of the band below which an error is called slow."""


@final
@dataclass(frozen=True, eq=False)
class ByFrequency:
    """Power spectral densities by Welch's method; arrays are empty without even sampling.

    Attributes:
        frequency: (F,) [Hz].
        error: (F,) one-sided density of the error [m^2/Hz].
        reading: (F,) one-sided density of the reading [m^2/Hz].
        coherence: (F,) of the error with the drive, 0..1; NaN where the drive has no power.
        band: coherence that white noise stays under with 99.9 % probability at each frequency.
        resolution: width of one line [Hz].
        coherent_share: share of the error's power that follows the drive linearly; NaN when
            the record is too short to say.
        sentence: what stands out; empty when nothing does.
    """

    frequency: FloatArray
    error: FloatArray
    reading: FloatArray
    coherence: FloatArray
    band: float
    resolution: float
    coherent_share: float
    sentence: str


def by_frequency(misfit: Misfit) -> ByFrequency:
    """Welch spectra of error and reading, on the longest evenly sampled counted stretch.

    Hann windows overlapping by half, eight window lengths a stretch (a whole period each where
    the record has one), means removed. Coherence |S_ev|^2 / (S_ee S_vv) of K independent
    windows stays under 1 - 0.001^(1/(K-1)) for an error that has nothing to do with the drive.

    Source: Welch (1967), IEEE Trans. Audio Electroacoust. 15, 70-73; Carter (1987), Proc. IEEE
    75(2), 236-255 (coherence).
    """
    part = _longest_even(misfit.time, misfit.record.step)
    error, drive = misfit.error[part], misfit.drive[part]
    reading = misfit.measured[part]
    count = error.size
    if count < _FEWEST:
        nothing = np.zeros(0)
        nan = float("nan")
        return ByFrequency(nothing, nothing, nothing, nothing, nan, nan, nan, "")
    length = _window(misfit, count)
    segments = 1 + (count - length) // (length - length // 2)
    # Hann windows that overlap by half are not independent: 1 / (1 + 2 / 36 (K-1)/K) of them.
    independent = segments / (1.0 + 2.0 / 36.0 * (segments - 1) / segments)
    rate = misfit.record.rate

    frequency = np.arange(1, length // 2 + 1, dtype=np.float64) * (rate / length)
    both = densities(error, drive, rate=rate, length=length)
    ee, cross, vv = both[0][1:], np.abs(both[1][1:]) ** 2, both[2][1:]
    yy = density(reading, rate=rate, length=length)[1:]
    excited = vv > 1e-9 * vv.max()
    with np.errstate(invalid="ignore", divide="ignore"):
        coherence = np.where(excited & (ee > 0), cross / (ee * vv), np.nan)
    known = segments >= _FEWEST_SEGMENTS
    band = 1.0 - 0.001 ** (1.0 / (independent - 1.0)) if known else float("nan")
    share = float("nan")
    if known and ee.sum() > 0:
        # Chance alone gives a coherence of 1/K.
        beyond = (np.nan_to_num(coherence) - 1.0 / independent) / (1.0 - 1.0 / independent)
        share = float(np.sum(np.where(excited, beyond, 0.0) * ee) / np.sum(ee))
    resolution = 1.5 * rate / length
    answer = ByFrequency(
        frequency, ee, yy, np.asarray(coherence), band, resolution, max(share, 0.0), ""
    )
    sentence = _sentence(misfit, answer, vv, independent) if known and ee.sum() > 0 else ""
    return ByFrequency(
        frequency, ee, yy, np.asarray(coherence), band, resolution, max(share, 0.0), sentence
    )


def _longest_even(time: FloatArray, step: float) -> slice:
    breaks = np.flatnonzero(np.abs(np.diff(time) - step) > 0.05 * step)
    bounds = np.concatenate([[-1], breaks, [time.size - 1]])
    longest = int(np.argmax(np.diff(bounds)))
    return slice(int(bounds[longest]) + 1, int(bounds[longest + 1]) + 1)


def _window(misfit: Misfit, count: int) -> int:
    period = misfit.record.period
    if period is not None:
        samples = round(period / misfit.record.step)
        if _FEWEST <= samples <= count // 2:
            return samples
    return int(np.clip(count // 8, min(_FEWEST, count // 2), 8192))


def _sentence(misfit: Misfit, spectra: ByFrequency, drive: FloatArray, independent: float) -> str:
    pieces = [_tone(misfit, spectra, drive, independent), _band(spectra, independent)]
    if spectra.coherent_share > _COHERENT:
        where = np.nan_to_num(spectra.coherence) * spectra.error
        centre = _line(
            misfit, misfit.drive, float(spectra.frequency[int(np.argmax(where))]), spectra
        )
        pieces.append(
            f"{100 * spectra.coherent_share:.0f} % of the error's power follows the drive "
            f"linearly, most of it near {brief(float(centre), 'Hz')}: gain, lag or "
            "resonance are not right there."
        )
    return " ".join(piece for piece in pieces if piece)


def _tone(misfit: Misfit, spectra: ByFrequency, drive: FloatArray, independent: float) -> str:
    """The strongest line that stands out of its neighbourhood and holds a share of the power."""
    power, frequency = spectra.error, spectra.frequency
    if power.size < 12:
        return ""
    wide = 2 * (min(31, power.size // 2) // 2) + 1
    floor = running_median(power, wide)
    freedom = 2.0 * independent
    rare, usual = (float(scipy.special.chdtri(freedom, p)) for p in (ALARM / power.size, 0.5))
    limit = rare / usual
    with np.errstate(invalid="ignore", divide="ignore"):
        prominence = np.where(floor > 0, power / floor, np.inf)
    prominence[power == 0.0] = 0.0
    peak = int(np.argmax(np.where(prominence > limit, power, 0.0)))
    # A red spectrum's first lines stand out of any median; a tone has flanks on both sides.
    if prominence[peak] <= limit or not 3 <= peak < power.size - 2:
        return ""
    flanks = slice(peak - 2, peak + 3)
    outer = max(power[peak - 3], power[min(peak + 3, power.size - 1)])
    if power[peak] < 2.0 * outer:
        return ""
    spacing = float(frequency[1] - frequency[0])
    excess = float(np.sum(np.maximum(power[flanks] - floor[flanks], 0.0))) * spacing
    if excess < _TONE * float(np.sum(power)) * spacing:
        return ""
    centre = float(np.sum(frequency[flanks] * power[flanks]) / np.sum(power[flanks]))
    centre = _line(misfit, misfit.error, centre, spectra)
    amplitude = float(np.sqrt(2.0 * excess))
    text = (
        f"A tone of {brief(amplitude, misfit.record.position_unit)} amplitude stands out at "
        f"{brief(float(centre), 'Hz')}"
    )
    top = int(np.argmax(drive))
    around = slice(max(top - 2, 0), top + 3)
    main = float(np.sum(frequency[around] * drive[around]) / np.sum(drive[around]))
    main = _line(misfit, misfit.drive, main, spectra)
    order = round(centre / main)
    share = float(drive.max() / drive.sum())
    beside = float(running_median(drive, wide)[peak])
    # Below that a drive's spectrum is rounding.
    if drive[flanks].max() > limit * max(beside, 1e-12 * float(drive.max())):
        text += ", where the drive has a line of its own"
    elif (
        2 <= order <= _HARMONICS and share > 0.2 and abs(centre - order * main) < spectra.resolution
    ):
        text += f", {order} times the drive's {brief(float(main), 'Hz')}"
    elif abs(centre - 50.0) < spectra.resolution < 5.0 or (
        abs(centre - 60.0) < spectra.resolution < 5.0
    ):
        text += ", the mains"
    return text + "."


def _line(misfit: Misfit, signal: FloatArray, near: float, spectra: ByFrequency) -> float:
    """The signal's strongest line near a frequency [Hz], in one spectrum of the whole record.

    The averaged spectra are coarse; this one tells the line itself, by the vertex of a parabola
    through the logarithms of three bins.
    """
    part = _longest_even(misfit.time, misfit.record.step)
    values = signal[part]
    bin_ = misfit.record.rate / values.size
    size = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size)))
    low = max(2, int(np.ceil((near - spectra.resolution) / bin_)))
    high = min(size.size - 1, int((near + spectra.resolution) / bin_) + 1)
    if high <= low:
        return near
    k = low + int(np.argmax(size[low:high]))
    left, middle, right = np.log(size[k - 1 : k + 2] + 1e-300)
    bend = left - 2.0 * middle + right
    return float((k + (0.5 * (left - right) / bend if bend < 0.0 else 0.0)) * bin_)


def _band(spectra: ByFrequency, independent: float) -> str:
    """Whether nine tenths of the error's power lie in a quarter of the band."""
    power, frequency = spectra.error, spectra.frequency
    below = np.cumsum(power) / np.sum(power)
    upper = int(np.searchsorted(below, 0.9))
    if frequency[upper] > _NARROW * frequency[-1] or independent * power.size < 50:
        return ""
    return (
        f"{100 * below[upper]:.0f} % of the error's power lies below "
        f"{brief(float(frequency[upper]), 'Hz')}."
    )
