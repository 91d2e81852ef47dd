"""LQG controllers as a function of four weights, with exact slopes through Riccati's equation.

With y in metres, v its change in a period, u times the plant's gain in metres:

    cost   y^2 + exp(theta_1) v^2 + exp(theta_0) u^2
    noise  of the drive exp(theta_2), of the disturbance's walk exp(theta_3), of the reading 1
"""

from __future__ import annotations

from typing import Final, final

import numpy as np
import scipy
from numpy.typing import NDArray

from piezo_opt.control import lqg
from piezo_opt.control.loop_program import Linear, Matrices
from piezo_opt.control.lqg import LQG, LQGLaw
from piezo_opt.control.minimal import minimal

FloatArray = NDArray[np.float64]

_LOW: Final = np.array([-9.0, -9.0, -9.0, -9.0])
_HIGH: Final = np.array([14.0, 14.0, 9.0, 5.0])
"""Of theta: a feedback that cancels the plant in a period to one that hardly acts."""


@final
class LQGFamily:
    """Gains of feedback and filter from theta, and their slopes.

    Args:
        plant: what is controlled.

    Raises:
        InputError: the plant runs away by itself.
    """

    def __init__(self, plant: Linear) -> None:
        self.low, self.high = _LOW, _HIGH
        self._plant = plant
        reduced = minimal(plant.sampled)
        a, b, c = reduced.plant
        n = self._n = a.shape[0]
        self.remarks = reduced.remarks
        self.law = LQGLaw(n)
        self._abc = a, b, c
        # With the disturbance of the drive as a further state.
        self._wide = np.block([[a, b], [np.zeros((1, n)), np.ones((1, 1))]])
        self._seen = np.hstack([c, np.zeros((1, 1))])
        # In units of the motion a volt: numbers near one.
        seen = c / plant.gain
        self._output, change = seen.T @ seen, seen @ (a - np.eye(n))
        self._change = change.T @ change
        into = np.vstack([b, np.zeros((1, 1))]) / plant.gain
        self._noise = into @ into.T
        self._walk = np.zeros((n + 1, n + 1))
        self._walk[n, n] = 1.0 / plant.gain**2

    def _feedback(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(1, n) K, and its slopes (2, n) by theta_0 and theta_1."""
        a, b, _ = self._abc
        r, w = np.exp(theta[:2])
        p = _riccati(a, b, self._output + w * self._change, r)
        size = float(r + (b.T @ p @ b)[0, 0])
        k = b.T @ p @ a / size
        closed, slopes = a - b @ k, []
        for dq, dr in ((0.0 * self._change, r), (w * self._change, 0.0)):
            dp = _lyapunov(closed.T, dq + dr * k.T @ k)
            slopes.append((b.T @ dp @ closed - dr * k).ravel() / size)
        return k, np.array(slopes)

    def _filter(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n + 1, 1) L, and its slopes (2, n + 1) by theta_2 and theta_3."""
        a, c = self._wide, self._seen
        parts = np.exp(2.0 * theta[2]) * self._noise, np.exp(2.0 * theta[3]) * self._walk
        p = _riccati(a.T, c.T, parts[0] + parts[1], 1.0)
        size = float(1.0 + (c @ p @ c.T)[0, 0])
        gain = p @ c.T / size
        kept = np.eye(self._n + 1) - gain @ c
        moved = [_lyapunov(a @ kept, 2.0 * part) for part in parts]
        return gain, np.array([(kept @ dp @ c.T).ravel() / size for dp in moved])

    def _ahead(self, k: FloatArray) -> tuple[float, FloatArray]:
        """N = 1 / (C (1 - A + B K)^-1 B), and its slopes (n,) by K."""
        a, b, c = self._abc
        inner = np.eye(self._n) - a + b @ k
        into, out = np.linalg.solve(inner, b), np.linalg.solve(inner.T, c.T)
        ahead = 1.0 / (c @ into)[0, 0]
        return float(ahead), np.asarray(ahead**2 * (out.T @ b)[0, 0] * into.ravel(), dtype=float)

    def gains(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(g,) entries in the order of the law, and their slopes (g, 4)."""
        a, b, c = self._abc
        (k, by_k), (gain, by_gain) = self._feedback(theta), self._filter(theta)
        ahead, by_ahead = self._ahead(k)
        n = self._n
        values = np.concatenate(
            [a.ravel(), b.ravel(), c.ravel(), k.ravel(), [ahead], gain.ravel(), [self._plant.rest]]
        )
        slopes, at = np.zeros((values.size, 4)), n * (n + 2)
        slopes[at : at + n, :2] = by_k.T
        slopes[at + n, :2] = by_k @ by_ahead
        slopes[at + n + 1 : -1, 2:] = by_gain.T
        return values, slopes

    def linear(self, gains: FloatArray) -> Matrices:
        """The controller from the error to the drive."""
        k, _, gain = self._parts(gains)
        return lqg.linear(*self._abc, k[np.newaxis], gain[:, np.newaxis])

    def _parts(self, gains: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """K, N and L of the law's gains."""
        at = self._n * (self._n + 2)
        return gains[at : at + self._n], float(gains[at + self._n]), gains[at + self._n + 1 : -1]

    def guesses(self) -> tuple[FloatArray, ...]:
        """A calm one, and a fast one."""
        return np.array([0.0, 0.0, 0.0, -2.0]), np.array([-4.0, -2.0, 1.0, 0.0])

    def softer(self, theta: FloatArray) -> FloatArray:
        """A dearer drive, a slower filter."""
        return np.asarray(theta + np.array([1.0, 0.0, -0.5, -0.5]))

    def calmer(self, theta: FloatArray, by: float) -> FloatArray:
        """A dearer drive."""
        return np.asarray(theta + by * np.array([1.0, 0.0, 0.0, 0.0]))

    def unknowns(self, given: FloatArray) -> FloatArray:
        """Of the weights themselves: gains do not tell them."""
        return np.asarray(np.clip(given, self.low, self.high), dtype=float)

    def controller(self, theta: FloatArray) -> LQG:
        """The controller of unknowns."""
        a, b, c = self._abc
        k, ahead, gain = self._parts(self.gains(theta)[0])
        return LQG(a, b.ravel(), c.ravel(), k, ahead, gain, self._plant.rest, self._plant.period)


def _riccati(a: FloatArray, b: FloatArray, q: FloatArray, r: float) -> FloatArray:
    """P of a discrete Riccati equation; no numbers where it has no solution that stabilises."""
    try:
        found = scipy.linalg.solve_discrete_are(a, b, q, np.array([[r]]))
    except np.linalg.LinAlgError:
        return np.full(a.shape, np.nan)
    return np.asarray(found, dtype=float)


def _lyapunov(a: FloatArray, q: FloatArray) -> FloatArray:
    """X = A X A' + Q; no numbers where A has none."""
    if not np.isfinite(a).all():
        return np.full(a.shape, np.nan)
    return np.asarray(scipy.linalg.solve_discrete_lyapunov(a, q), dtype=float)
