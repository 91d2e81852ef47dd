"""Signals of sines: chirps and multisines, for frequency responses and resonances."""

from __future__ import annotations

from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.choosing import chosen, real, whole
from piezo_opt.errors import InputError
from piezo_opt.signals.drive import Drive, check_range, sampled
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

_A_DECADE: Final = 12
"""Logarithmic lines in a decade: neighbours differ by a fifth, less than a resonance is wide at
ten per cent of damping."""


class Lines(Enum):
    """Which harmonics of 1 / period a multisine excites."""

    FULL = "full"
    """All of them."""
    ODD = "odd"
    """Odd ones: even distortion answers on the lines between."""
    ODD_DETECTION = "odd-detection"
    """Odd ones, one of each three left out at random: odd distortion answers there."""
    LOGARITHMIC = "logarithmic"
    """As many in each decade: slow and fast alike get their share of the power."""


class Phases(Enum):
    """Phases of a multisine's lines."""

    RANDOM = "random"
    """Independent and even over a turn: many realisations average distortion out."""
    SCHROEDER = "schroeder"
    """phi_k = -pi k (k - 1) / K: a flat envelope, more power in the same range."""


def sine(
    low: float, high: float, frequency: float, duration: float, *, rate: float, unit: str = "V"
) -> Drive:
    """A sine of one frequency [Hz], from its lowest point, for a time [s].

    Raises:
        InputError: a frequency that is not positive, or above half the rate.
    """
    check_range(low, high, "sine")
    _check_band(frequency, frequency, rate, "sine")
    phase = 2.0 * np.pi * frequency * sampled(duration, rate, "sine")
    return Drive(
        f"sine_{frequency:.3g}_Hz_{low:.3g}_{high:.3g}_{unit}".replace("/", "_per_"),
        f"sine {low:.3g}..{high:.3g} {unit}, {frequency:.3g} Hz, {show(duration, 's')}",
        low + (high - low) * (0.5 - 0.5 * np.cos(phase)),
        rate,
        unit,
    )


def chirp(
    low: float,
    high: float,
    start: float,
    stop: float,
    duration: float,
    *,
    rate: float,
    logarithmic: bool = True,
    unit: str = "V",
) -> Drive:
    """A sine from its lowest point whose frequency goes from start to stop [Hz].

        phase = 2 pi f0 (e^(g t) - 1) / g, g = ln(f1 / f0) / T      logarithmic
        phase = 2 pi (f0 t + (f1 - f0) t^2 / (2 T))                 linear

    Raises:
        InputError: a frequency that is not positive, or above half the rate.
    """
    check_range(low, high, "chirp")
    _check_band(start, stop, rate, "chirp")
    time = sampled(duration, rate, "chirp")
    if logarithmic and start != stop:
        growth = np.log(stop / start) / duration
        phase = 2.0 * np.pi * start * np.expm1(growth * time) / growth
    else:
        phase = 2.0 * np.pi * (start + 0.5 * (stop - start) * time / duration) * time
    return Drive(
        f"chirp_{start:.3g}_{stop:.3g}_Hz",
        f"chirp {low:.4g}..{high:.4g} {unit}, {start:.4g} to {stop:.4g} Hz, "
        f"{'logarithmic' if logarithmic else 'linear'}, {duration:.4g} s",
        low + (high - low) * (0.5 - 0.5 * np.cos(phase)),
        rate,
        unit,
    )


def multisine(
    low: float,
    high: float,
    lowest: float,
    highest: float,
    period: float,
    *,
    rate: float,
    lines: Lines = Lines.FULL,
    phases: Phases = Phases.RANDOM,
    seed: int = 0,
    periods: int = 1,
    unit: str = "V",
) -> Drive:
    """Equal sines on harmonics of 1 / period between two frequencies, scaled to the range.

        u(t) = m + a sum_k cos(2 pi f_k t + phi_k)

    Args:
        low, high: range that it fills [unit].
        lowest, highest: [Hz].
        period: [s]; a whole number of samples.
        rate: samples a second [Hz].
        lines: which harmonics.
        phases: random or Schroeder's.
        seed: of random phases and of the lines left out.
        periods: how many are played.
        unit: SI unit of the drive.

    Raises:
        InputError: no harmonic lies in the band, or the period is no whole number of samples.

    Sources: Pintelon & Schoukens (2012), System Identification: A Frequency Domain Approach, 2nd
    ed., sec. 4.3 (random odd multisines with detection lines); Schroeder (1970), IEEE Trans.
    Information Theory 16(1), 85-89.
    """
    check_range(low, high, "multisine")
    lines, phases = chosen(Lines, lines, "lines"), chosen(Phases, phases, "phases")
    whole(seed, "seed", 0)
    real(period, "multisine: period")
    _check_band(lowest, highest, rate, "multisine")
    samples = period * rate
    if not period > 0.0 or abs(samples - round(samples)) > 1e-6 * samples:
        raise InputError(
            f"multisine: a period of {period:g} s is {samples:g} samples at {rate:g} Hz; choose a "
            "whole number of them"
        )
    count = round(samples)
    rng = np.random.default_rng(seed)
    first, last = int(np.ceil(lowest * period - 1e-9)), int(np.floor(highest * period + 1e-9))
    band = np.arange(max(1, first), last + 1)
    # Half the rate carries no sine.
    band = band[2 * band < count]
    if lines is Lines.LOGARITHMIC and band.size:
        number = 1 + round(_A_DECADE * float(np.log10(band[-1] / band[0])))
        excited = np.unique(np.round(np.geomspace(band[0], band[-1], number)).astype(np.int64))
    else:
        excited = band if lines is Lines.FULL else band[band % 2 == 1]
    if lines is Lines.ODD_DETECTION:
        kept = np.ones(excited.size, dtype=bool)
        for begin in range(0, excited.size - excited.size % 3, 3):
            kept[begin + int(rng.integers(3))] = False
        excited = excited[kept]
    if excited.size == 0:
        raise InputError(
            f"multisine: no {lines.value} harmonic of {1.0 / period:g} Hz lies between {lowest:g} "
            f"and {highest:g} Hz; play a longer period"
        )
    order = np.arange(1, excited.size + 1)
    angle = (
        rng.uniform(0.0, 2.0 * np.pi, excited.size)
        if phases is Phases.RANDOM
        else -np.pi * order * (order - 1.0) / excited.size
    )
    spectrum = np.zeros(count // 2 + 1, dtype=np.complex128)
    spectrum[excited] = np.exp(1j * angle)
    wave = np.fft.irfft(spectrum, count)
    values = low + (high - low) * (wave - wave.min()) / np.ptp(wave)
    silent = np.setdiff1d(band, excited)
    drive = Drive(
        f"multisine_{lowest:.3g}_{highest:.3g}_Hz",
        f"multisine {low:.4g}..{high:.4g} {unit}, {excited.size} {lines.value} lines from "
        f"{lowest:.4g} to {highest:.4g} Hz, {phases.value} phases"
        + (f", seed {seed}" if phases is Phases.RANDOM or lines is Lines.ODD_DETECTION else ""),
        values,
        rate,
        unit,
        period=period,
        excited=tuple((excited / period).tolist()),
        silent=tuple((silent / period).tolist()),
    )
    return drive.repeated(periods)


def _check_band(low: float, high: float, rate: float, name: str) -> None:
    for what in (low, high, rate):
        real(what, f"{name}: a frequency")
    if not (low > 0.0 and high > 0.0 and np.isfinite([low, high]).all()):
        raise InputError(f"{name}: from {low:g} to {high:g} Hz; give positive frequencies")
    if max(low, high) > 0.5 * rate:
        raise InputError(
            f"{name}: {max(low, high):g} Hz is above half of {rate:g} Hz, where samples lie about "
            "it; raise the rate"
        )
