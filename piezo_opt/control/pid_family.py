"""PID controllers as a function of the logarithms of kp, ki, kd, tau in units of the plant's."""

from __future__ import annotations

from typing import Final, final

import control
import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.loop_program import Linear, Matrices
from piezo_opt.control.pid import PID, PIDLaw

FloatArray = NDArray[np.float64]

_WIDE: Final = np.log(1e5)
"""Half width of the search in the logarithm of each gain around its scale."""


@final
class PIDFamily:
    """kp, ki, kd, tau = scale exp(theta).

    Args:
        plant: what is controlled.
    """

    def __init__(self, plant: Linear) -> None:
        t, gain = plant.period, plant.gain
        self.law = PIDLaw()
        self.scale = np.array([1.0 / gain, 1.0 / (gain * t), t / gain, t])
        self.low = np.array([-_WIDE, -_WIDE, -_WIDE, np.log(0.1)])
        self.high = np.array([_WIDE, _WIDE, _WIDE, np.log(1e3)])
        self._plant = plant
        self.remarks: tuple[str, ...] = ()

    def gains(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(4,) and their slopes."""
        gains = self.scale * np.exp(theta)
        return gains, np.diag(gains)

    def linear(self, gains: FloatArray) -> Matrices:
        """Memory: integral, slope, last error."""
        kp, ki, kd, tau = gains
        t = self._plant.period
        half, hold = ki * t / 2.0, tau + t
        return (
            np.array([[1.0, 0.0, half], [0.0, tau / hold, -1.0 / hold], [0.0, 0.0, 0.0]]),
            np.array([[half], [1.0 / hold], [1.0]]),
            np.array([[1.0, kd * tau / hold, half - kd / hold]]),
            np.array([[kp + half + kd / hold]]),
        )

    def guesses(self) -> tuple[FloatArray, ...]:
        """Two: a slow integral, and zeros on the plant's slowest two poles.

        u = k int (e + 2 zeta e' / omega + e'' / omega^2),  k = 1 / (4 (1 + delay) T d)
        """
        reach, t = 4.0 * (1.0 + self._plant.delay), self._plant.period
        twice, square = _slowest(self._plant.continuous)
        slow = np.array([0.1, 1.0, 0.01, reach]) / reach
        lead = np.array([max(twice / t, 0.1), 1.0, max(square / t**2, 0.01), reach]) / reach
        return tuple(np.clip(np.log(one), self.low, self.high) for one in (slow, lead))

    def softer(self, theta: FloatArray) -> FloatArray:
        """Half the gains, the same filter."""
        return np.asarray(theta - np.array([1.0, 1.0, 1.0, 0.0]) * np.log(2.0))

    def calmer(self, theta: FloatArray, by: float) -> FloatArray:
        """Smaller gains, the same filter."""
        return np.asarray(theta - by * np.array([1.0, 1.0, 1.0, 0.0]))

    def unknowns(self, given: PID) -> FloatArray:
        """Of given gains; what is zero there begins at the bound."""
        gains = np.array([given.kp, given.ki, given.kd, given.tau])
        with np.errstate(divide="ignore"):
            return np.asarray(np.clip(np.log(gains / self.scale), self.low, self.high))

    def controller(self, theta: FloatArray) -> PID:
        """The PID of unknowns."""
        return PID(*(self.scale * np.exp(theta)).tolist())


def _slowest(system: control.StateSpace) -> tuple[float, float]:
    """(2 zeta / omega, 1 / omega^2) of (1 + ...) with the two slowest poles of a plant.

    One pole gives (1 / |p|, 0), none (0, 0); poles at the origin are left out.
    """
    poles = np.asarray(system.poles())
    poles = poles[np.abs(poles) > 0.0]
    poles = poles[np.argsort(np.abs(poles))][:2]
    slow = -1.0 / poles
    return float(slow.sum().real), float(np.prod(slow).real) if slow.size == 2 else 0.0
