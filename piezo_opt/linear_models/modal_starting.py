"""Where the modes of a response matrix lie: vector fitting with poles common to all elements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import numpy as np

from piezo_opt.linear_models.modal import basis
from piezo_opt.measurement import FloatArray
from piezo_opt.measurement.arrays import ComplexArray

_ITERATIONS: Final = 25
"""Relocations of the poles: with noise they stop to move after about ten."""
_ROUNDING: Final = 1e-13
"""Share of the largest eigenvalue of normal equations below which there is only rounding."""
_NARROW: Final = 0.01
"""Damping of the first poles, of which the iteration does not depend: sections of a hundredth keep
the first equations well conditioned (Gustavsen & Semlyen, sec. 3.2)."""


@final
@dataclass(frozen=True, eq=False)
class Poles:
    """Real poles (r,) -a_k and n pairs, by frequency.

    Attributes:
        rates: (r,) a_k [1/s].
        omega: (n,) [rad/s].
        zeta: (n,).
    """

    rates: FloatArray
    omega: FloatArray
    zeta: FloatArray


def found_modes(
    frequency: FloatArray, response: ComplexArray, sigma: FloatArray, real: int, modes: int
) -> Poles:
    """Real poles and modes that all elements of a matrix share.

    Relaxed vector fitting: with the poles of the last round,

        sigma(s) G_e(s) = sum c_e phi(s),   sigma(s) = d + sum c phi(s)

    is solved in least squares for all elements e together, and the zeros of sigma are the new
    poles, mirrored into the left half plane. Beforehand a constant delay is taken out.

    Args:
        frequency: (K,) [Hz].
        response: (K, E) elements.
        sigma: (K, E) standard deviations.
        real, modes: numbers of real poles and of pairs.

    Source: Gustavsen & Semlyen (1999), IEEE Trans. Power Delivery 14, 1052-1061; Gustavsen (2006),
    IEEE Trans. Power Delivery 21, 1587-1592.
    """
    s = np.asarray(2j * np.pi * frequency)
    low, high = 2.0 * np.pi * float(frequency[0]), 2.0 * np.pi * float(frequency[-1])
    poles = Poles(
        np.geomspace(2.0 * low, 0.5 * high, real),
        _spread(frequency, response, modes),
        np.full(modes, _NARROW),
    )
    for _ in range(_ITERATIONS if real + modes else 0):
        poles = _relocated(s, response, 1.0 / sigma, poles, real, modes)
    return poles


def _spread(frequency: FloatArray, response: ComplexArray, modes: int) -> FloatArray:
    """(n,) first frequencies, as dense as the response is strong: even shares of its area."""
    size = np.sqrt(np.mean(np.abs(response) ** 2, axis=1))
    size = np.sqrt(size / size.max())
    area = np.concatenate([[0.0], np.cumsum(0.5 * (size[1:] + size[:-1]) * np.diff(frequency))])
    shares = (np.arange(modes) + 0.5) / max(modes, 1) * area[-1]
    return np.asarray(2.0 * np.pi * np.interp(shares, area, frequency))


def _relocated(
    s: ComplexArray, response: ComplexArray, weight: FloatArray, poles: Poles, real: int, modes: int
) -> Poles:
    phi = basis(s, poles.rates, poles.omega, poles.zeta)
    scale = np.sqrt(np.sum(np.abs(phi) ** 2, axis=0))
    phi, away = phi / scale, np.conj(phi / scale).T
    # Each element's own numerator is eliminated: what is left of the columns of sigma. Normal
    # equations see half the digits, which is enough for a start.
    normal = np.zeros((phi.shape[1], phi.shape[1]))
    for element in range(response.shape[1]):
        square, seen = weight[:, element, np.newaxis] ** 2, response[:, element, np.newaxis]
        own = np.real(away @ (square * phi))
        across = np.real(away @ (square * seen * phi))
        theirs = np.real(away @ (square * np.abs(seen) ** 2 * phi))
        normal += theirs - across.T @ np.linalg.pinv(own, rcond=_ROUNDING, hermitian=True) @ across
    # The mean of sigma over the lines is one, as heavy as all the rest: nothing is zero then.
    mean = phi.real.mean(axis=0)
    heavy = float(np.trace(normal)) / float(mean @ mean)
    lifted = normal + heavy * np.outer(mean, mean)
    weights = np.linalg.pinv(lifted, rcond=_ROUNDING, hermitian=True) @ (heavy * mean) / scale
    return _sorted(_zeros(poles, weights), real, modes)


def _zeros(poles: Poles, weights: FloatArray) -> ComplexArray:
    """Zeros of weights[-1] + sum weights phi: eigenvalues of A - B C / d."""
    size = weights.size - 1
    a, b, c = np.zeros((size, size)), np.zeros(size), np.zeros(size)
    for k, rate in enumerate(poles.rates):
        a[k, k], b[k], c[k] = -rate, rate, weights[k]
    at = poles.rates.size
    for omega, zeta in zip(poles.omega, poles.zeta, strict=True):
        # x' = omega v, v' = omega (u - x - 2 zeta v): x is H u and v is s H u / omega.
        a[at, at + 1] = omega
        a[at + 1, at], a[at + 1, at + 1] = -omega, -2.0 * zeta * omega
        b[at + 1] = omega
        c[at], c[at + 1] = weights[at], weights[at + 1]
        at += 2
    through = weights[-1] or np.finfo(np.float64).tiny
    return np.linalg.eigvals(a - np.outer(b, c) / through).astype(np.complex128)


def _sorted(roots: ComplexArray, real: int, modes: int) -> Poles:
    """Poles of these numbers: real ones in excess make overdamped pairs, and the other way round.

    A pair of real poles a, b is a section with omega = sqrt(a b), zeta = (a + b) / (2 omega).
    """
    roots = np.where(roots.real > 0.0, -np.conj(roots), roots)
    upper = roots[roots.imag > 0.0]
    rates = np.sort(-roots[roots.imag == 0.0].real)
    omega, zeta = np.abs(upper), -upper.real / np.abs(upper)
    while upper.size and omega.size > modes and rates.size < real:
        # The most damped pair gives two real poles at its frequency.
        k = int(np.argmax(zeta))
        rates = np.sort(np.append(rates, [0.5 * omega[k], 2.0 * omega[k]]))
        omega, zeta = np.delete(omega, k), np.delete(zeta, k)
    while omega.size < modes and rates.size > real + 1:
        # The two fastest real poles become a section.
        a, b = rates[-2:]
        omega = np.append(omega, np.sqrt(a * b))
        zeta = np.append(zeta, (a + b) / (2.0 * np.sqrt(a * b)))
        rates = rates[:-2]
    tiny = np.finfo(np.float64).eps
    order = np.argsort(omega)
    return Poles(
        np.maximum(rates, tiny * omega.max(initial=1.0)),
        omega[order], np.maximum(zeta[order], tiny),
    )  # fmt: skip


_FLAT: Final = 1.5
"""Growth of the response over its lowest lines up to which it counts as flat: at two thirds of a
lightly damped resonance's frequency the gain is 1.8 times that at rest, its phase still nothing."""
_LONGEST_DELAY: Final = 10.0
"""Samples; converters, filters and amplifiers take one or two."""
_FEWEST: Final = 8
"""Flat lines that tell a delay."""


def first_delay(frequency: FloatArray, response: ComplexArray, rate: float) -> float:
    """Delay [s] that leaves least imaginary part at the flat lines below the first resonance.

    Args:
        frequency: (K,) [Hz].
        response: (K, E).
        rate: of sampling [Hz].
    """
    size = np.sqrt(np.mean(np.abs(response) ** 2, axis=1))
    low = float(np.median(size[: max(_FEWEST, size.size // 50)]))
    steep = np.flatnonzero(size > _FLAT * low)
    flat = int(steep[0]) if steep.size else size.size
    if flat < _FEWEST:
        return 0.0
    tried = np.linspace(0.0, _LONGEST_DELAY / rate, 401)
    left = [
        np.sum(
            np.imag(response[:flat] * np.exp(2j * np.pi * frequency[:flat, np.newaxis] * t)) ** 2
        )
        for t in tried
    ]
    return float(tried[int(np.argmin(left))])
