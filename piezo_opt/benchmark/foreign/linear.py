"""Linear systems of signals that are linear between their nodes, exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import cont2discrete, fftconvolve, lfilter

from piezo_opt.benchmark.foreign.operators import Array


def passed(
    numerator: Sequence[float], denominator: Sequence[float], signal: Array, step: float
) -> Array:
    """A transfer function in s, highest power first, that begins at rest at the first value."""
    up, down, _ = cont2discrete((np.array(numerator), np.array(denominator)), step, method="foh")
    rest = numerator[-1] / denominator[-1] * signal[0]
    found: Array = rest + lfilter(np.ravel(up), down, signal - signal[0])
    return found


def first_order(signal: Array, tau: float, step: float) -> Array:
    """Low pass 1 / (tau s + 1)."""
    return passed([1.0], [tau, 1.0], signal, step)


def second_order(signal: Array, omega: float, zeta: float, step: float) -> Array:
    """Low pass omega^2 / (s^2 + 2 zeta omega s + omega^2)."""
    # In units of 1 / omega: the coefficients stay near 1.
    return passed([1.0], [1.0, 2.0 * zeta, 1.0], signal, step * omega)


def low_pass(signal: Array, tau: float, damping: float | None, step: float) -> Array:
    """Of order 1 without a damping ratio, of order 2 with one."""
    if damping is None:
        return first_order(signal, tau, step)
    return second_order(signal, 1.0 / tau, damping, step)


def superposed(signal: Array, answer: Array, step: float) -> Array:
    """Boltzmann's superposition of the answer to a unit step, which begins at 0.

        y(t) = int J(t - t') ds(t')

    Args:
        signal: at the nodes; linear between them.
        answer: the integral of J from 0 to each node.
    """
    slope = np.diff(signal) / step
    found: Array = fftconvolve(slope, np.diff(answer))[: slope.size]
    return np.concatenate([[0.0], found])
