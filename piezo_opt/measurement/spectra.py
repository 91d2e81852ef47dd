"""Spectra of even signals, by the fast Fourier transform alone.

The signal-processing library takes a second to load, longer than most fits; these three are all
that a fit asks of it, and its tests compare them with it.
"""

from __future__ import annotations

import numpy as np

from piezo_opt.measurement.arrays import ComplexArray, FloatArray


def without_line(values: FloatArray) -> FloatArray:
    """A signal (N,) less its least-squares straight line, in its own unit."""
    centred = values - values.mean()
    along = np.arange(values.size) - 0.5 * (values.size - 1)
    square = float(along @ along)
    slope = float(along @ centred) / square if square > 0.0 else 0.0
    return np.asarray(centred - along * slope, dtype=np.float64)


def frequencies(length: int, rate: float) -> FloatArray:
    """(length // 2 + 1,) frequencies of a density [Hz]."""
    return np.asarray(np.fft.rfftfreq(length, 1.0 / rate), dtype=np.float64)


def cross_density(one: FloatArray, other: FloatArray, *, rate: float, length: int) -> ComplexArray:
    """One-sided cross density of two signals (N,) at `frequencies` [product of units / Hz].

        S(f) = 2 / (rate K sum w^2) sum_k conj(X_k) Y_k

    over K stretches of ``length`` samples that overlap by half, each less its mean and under a
    Hann window ``w``; at 0 and at the Nyquist frequency without the factor 2.

    Args:
        one, other: signals of the same length; shorter ones than ``length`` are one stretch.
        rate: samples a second [Hz].
        length: samples of a stretch.

    Source: Welch (1967), IEEE Trans. Audio Electroacoust. 15, 70-73.
    """
    length = min(length, one.size)
    apart = length - length // 2
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    total = np.zeros(length // 2 + 1, dtype=np.complex128)
    starts = range(0, one.size - length + 1, apart)
    for start in starts:
        x, y = (v[start : start + length] for v in (one, other))
        first = np.fft.rfft(window * (x - x.mean()))
        second = first if one is other else np.fft.rfft(window * (y - y.mean()))
        total += np.conj(first) * second
    total /= len(starts) * rate * float(window @ window)
    total[1 : (length + 1) // 2] *= 2.0
    return total


def density(values: FloatArray, *, rate: float, length: int) -> FloatArray:
    """One-sided density of a signal (N,) [unit^2 / Hz], as `cross_density` with itself."""
    return np.real(cross_density(values, values, rate=rate, length=length))
