"""Spectra of even signals, by the fast Fourier transform alone.

The signal-processing library takes a second to load, longer than most fits; these are all that a
fit asks of it, and their tests compare them with it.
"""

from __future__ import annotations

from functools import lru_cache

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


def densities(
    one: FloatArray, other: FloatArray, *, rate: float, length: int
) -> tuple[FloatArray, ComplexArray, FloatArray]:
    """One-sided densities of two signals (N,) at `frequencies` [product of units / Hz].

        S(f) = 2 / (rate K sum w^2) sum_k conj(X_k) Y_k

    over K stretches of ``length`` samples that overlap by half, each less its mean and under a
    Hann window ``w``; at 0 and at the Nyquist frequency without the factor 2.

    Args:
        one, other: signals of the same length; shorter ones than ``length`` are one stretch.
        rate: samples a second [Hz].
        length: samples of a stretch.

    Returns:
        density of the first one, cross density, density of the other.

    Source: Welch (1967), IEEE Trans. Audio Electroacoust. 15, 70-73.
    """
    x, y = (_stretches(v, length) for v in (one, other))
    share = _share(one.size, rate, length)
    return _power(x) * share, np.sum(np.conj(x) * y, axis=0) * share, _power(y) * share


def density(values: FloatArray, *, rate: float, length: int) -> FloatArray:
    """One-sided density of a signal (N,) [unit^2 / Hz], as `densities` has it."""
    return _power(_stretches(values, length)) * _share(values.size, rate, length)


def running_median(values: FloatArray, wide: int) -> FloatArray:
    """Median of the ``wide`` values (odd) around each of (N,); the ends go on beyond the edges."""
    around = np.pad(values, wide // 2, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(around, wide), axis=-1))


def _power(spectra: ComplexArray) -> FloatArray:
    return np.asarray(np.sum(spectra.real**2 + spectra.imag**2, axis=0))


def _stretches(values: FloatArray, length: int) -> ComplexArray:
    """(K, length // 2 + 1) spectra of the stretches, each less its mean and under its window."""
    length = min(length, values.size)
    every = np.lib.stride_tricks.sliding_window_view(values, length)[:: length - length // 2]
    return np.fft.rfft(hann(length) * (every - every.mean(axis=1, keepdims=True)))


@lru_cache(maxsize=4)
def hann(length: int) -> FloatArray:
    """(length,) Hann window of a stretch that is repeated."""
    window = np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length))
    window.flags.writeable = False
    return window


def _share(size: int, rate: float, length: int) -> FloatArray:
    """(length // 2 + 1,) what sums over the stretches of so many samples are multiplied by."""
    length = min(length, size)
    stretches = 1 + (size - length) // (length - length // 2)
    share = np.full(length // 2 + 1, 1.0 / (stretches * rate * float(hann(length) @ hann(length))))
    share[1 : (length + 1) // 2] *= 2.0
    return share
