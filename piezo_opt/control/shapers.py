"""Input shapers: the command as several, so that what one sets swinging the next one stills.

A step through a shaper of impulses A_i at t_i leaves a mode of omega and zeta swinging with

    V = exp(-zeta omega t_n) sqrt(C^2 + S^2)
    C, S = sum A_i exp(zeta omega t_i) (cos, sin)(omega_d t_i)

of what a bare step leaves, omega_d = omega sqrt(1 - zeta^2).

Sources: Singer & Seering (1990), J. Dyn. Sys. Meas. Control 112(1), 76-82 (ZV, ZVD); Singhose,
Seering & Singer (1994), J. Mech. Design 116(2), 654-659 (EI); Singhose, Porter, Tuttle & Singer
(1997), J. Dyn. Sys. Meas. Control 119(2), 320-326 (EI with damping).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.choosing import real
from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]


STEP = 1e-5
"""Relative step of a central difference: its error and that of rounding are both below 1e-9."""


@final
@dataclass(frozen=True, eq=False)
class Shaper:
    """Impulses by which a command is spread out.

    Attributes:
        name: its usual abbreviation.
        amplitudes: (n,) A_i, which sum up to one.
        times: (n,) t_i [s], the first one 0.
    """

    name: str
    amplitudes: FloatArray
    times: FloatArray

    @property
    def delay(self) -> float:
        """By how much a command takes longer [s]."""
        return float(self.times[-1])

    def vibration(self, omega: float, zeta: float) -> float:
        """Share of a bare step's swinging that is left of a mode [rad/s]."""
        damped = omega * np.sqrt(1.0 - zeta**2)
        grown = self.amplitudes * np.exp(zeta * omega * (self.times - self.times[-1]))
        return float(np.abs(np.sum(grown * np.exp(1j * damped * self.times))))

    def taps(self, period: float) -> tuple[NDArray[np.int64], FloatArray]:
        """Samples of delay (k,) and weights (k,) of the same at a period [s].

        An impulse between two samples is shared by them, as :meth:`shaped` does.

        Raises:
            InputError: no period, or one in which the shaper is over.
        """
        if not 0.0 < period <= self.delay:
            raise InputError(
                f"period = {period} s: the shaper lasts {self.delay:.3g} s: sample faster"
            )
        weights = np.zeros(int(np.ceil(self.delay / period)) + 2)
        for a, t in zip(self.amplitudes, self.times, strict=True):
            # What is a whole number of periods but for its last digits is that number.
            place = float(t) / period
            place = float(round(place)) if abs(place - round(place)) < 1e-9 else place
            k = int(place)
            weights[k] += a * (1.0 - (place - k))
            weights[k + 1] += a * (place - k)
        later = np.flatnonzero(weights)
        return later, weights[later]

    def shaped(self, time: FloatArray, command: FloatArray) -> FloatArray:
        """A command (N,) on its clock [s], shaped; before the first sample it was constant.

        Between samples the command moves linearly.
        """
        parts = (
            a * np.interp(time - t, time, command, left=command[0])
            for a, t in zip(self.amplitudes, self.times, strict=True)
        )
        return np.asarray(sum(parts))


def _mode(omega: float, zeta: float) -> tuple[float, float]:
    """What is left of a swing after half a period, and that half period [s]."""
    real(omega, "omega")
    real(zeta, "zeta")
    if not omega > 0.0 or not 0.0 <= zeta < 1.0:
        raise InputError(
            f"omega = {omega} rad/s, zeta = {zeta}: a shaper is for a mode that swings, omega > 0 "
            "and 0 <= zeta < 1"
        )
    root = np.sqrt(1.0 - zeta**2)
    return float(np.exp(-zeta * np.pi / root)), float(np.pi / (omega * root))


def zv(omega: float, zeta: float) -> Shaper:
    """Zero vibration: two impulses, half a period apart, (1, K) / (1 + K), K = exp(-zeta pi / ...).

    Raises:
        InputError: a mode that does not swing.
    """
    k, half = _mode(omega, zeta)
    return Shaper("ZV", np.array([1.0, k]) / (1.0 + k), np.array([0.0, half]))


def zvd(omega: float, zeta: float) -> Shaper:
    """Zero vibration and derivative: three impulses, (1, 2 K, K^2) / (1 + K)^2.

    Raises:
        InputError: a mode that does not swing.
    """
    k, half = _mode(omega, zeta)
    weights = np.array([1.0, 2.0 * k, k * k]) / (1.0 + k) ** 2
    return Shaper("ZVD", weights, half * np.arange(3.0))


def ei(omega: float, zeta: float, vibration: float = 0.05) -> Shaper:
    """Extra insensitive: V at the mode itself, none on either side of it.

    Without damping (1 + V, 2 - 2 V, 1 + V) / 4, half a period apart. With damping amplitudes and
    times are found from these by the same conditions: V, and a maximum, at the mode, and zero at
    one frequency on either side.

    Args:
        omega, zeta: the mode.
        vibration: V that is allowed.

    Raises:
        InputError: a mode that does not swing, or a share that is none.
    """
    k, half = _mode(omega, zeta)
    if not 0.0 < vibration < 1.0:
        raise InputError(f"vibration = {vibration}: give a share between 0 and 1, 0.05")
    v = vibration
    # What a damped swing has lost when the next impulse comes is left out of that one.
    begin = np.array([1.0 + v, 2.0 - 2.0 * v, 1.0 + v]) / 4.0 * np.array([1.0, k, k * k])
    # Undamped, V is zero where cos(pi omega/omega_0) = -(1 - v) / (1 + v).
    side = float(np.arccos(-(1.0 - v) / (1.0 + v)) / np.pi)
    if zeta == 0.0:
        return Shaper("EI", begin / begin.sum(), half * np.arange(3.0))

    def conditions(x: FloatArray) -> FloatArray:
        shaper = _three(x, half)
        # The mode stands at the top between the two stilled frequencies.
        beside = [shaper.vibration(omega * (1.0 + s * STEP), zeta) for s in (1.0, -1.0)]
        slope = (beside[0] - beside[1]) / (2.0 * STEP)
        return np.concatenate(
            [
                [shaper.vibration(omega, zeta) - v, slope],
                _phasor(shaper, x[4] * omega, zeta), _phasor(shaper, x[5] * omega, zeta),
            ]
        )  # fmt: skip

    start = np.array([*(begin / begin.sum())[:2], 1.0, 2.0, side, 2.0 - side])
    found = scipy.optimize.least_squares(conditions, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return _three(found.x, half)


def _three(x: FloatArray, half: float) -> Shaper:
    weights = np.array([x[0], x[1], 1.0 - x[0] - x[1]])
    return Shaper("EI", weights, half * np.array([0.0, x[2], x[3]]))


def _phasor(shaper: Shaper, omega: float, zeta: float) -> FloatArray:
    damped = omega * np.sqrt(1.0 - zeta**2)
    grown = shaper.amplitudes * np.exp(zeta * omega * (shaper.times - shaper.times[-1]))
    total = np.sum(grown * np.exp(1j * damped * shaper.times))
    return np.array([total.real, total.imag])


def insensitivity(shaper: Shaper, omega: float, zeta: float, vibration: float = 0.05) -> float:
    """Width of the range of frequencies around a mode in which at most V is left, over omega."""

    def above(share: float) -> float:
        return shaper.vibration(share * omega, zeta) - vibration * (1.0 + 1e-9)

    if above(1.0) > 0.0:
        return 0.0
    grid = np.linspace(0.0, 1.0, 2001)[1:]
    edges = []
    for sign in (-1.0, 1.0):
        last = 1.0
        for step in grid:
            here = 1.0 + sign * step
            if here <= 0.0 or above(here) > 0.0:
                break
            last = here
        beyond = last + sign * grid[0]
        edges.append(scipy.optimize.brentq(above, last, beyond) if above(beyond) > 0.0 else last)
    return float(edges[1] - edges[0])
