"""The state from the reading: a Kalman filter, because only displacement is measured."""

from __future__ import annotations

import control
import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]


def kalman(system: control.StateSpace, *, drive_noise: float, reading_noise: float) -> FloatArray:
    """(n, 1) gain L of the observer x^' = A x^ + B u + L (y - C x^ - D u).

    Stationary, for white noise of the drive and of the reading:

        A P + P A' - P C'C P / R + B Q B' = 0,   L = P C' / R

    Args:
        system: one input, one output.
        drive_noise, reading_noise: power densities Q and R, in the units of drive and reading
            squared a hertz; only their ratio matters to L.

    Raises:
        InputError: no positive densities, or a state that the reading does not show.

    Source: Kalman & Bucy (1961), J. Basic Engineering 83(1), 95-108.
    """
    if not (drive_noise > 0.0 and reading_noise > 0.0):
        raise InputError(
            f"drive_noise = {drive_noise}, reading_noise = {reading_noise}: both are positive"
        )
    seen = control.obsv(system.A, system.C)
    size = np.linalg.norm(seen, axis=1, keepdims=True)
    if np.linalg.matrix_rank(seen / np.where(size > 0.0, size, 1.0)) < system.nstates:
        raise InputError(
            "The reading does not show every state of the system: leave the others out "
            "(control.minreal(system))."
        )
    gain, _, _ = control.lqe(
        system.A, system.B, system.C, np.array([[drive_noise]]), np.array([[reading_noise]])
    )
    return np.asarray(gain, dtype=float)
