"""The resonances of an actuator, and how well the record tells them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import control
import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]

SWINGS: Final = 0.5
"""Damping from which on a mode does not swing: it leaves 16 % of a step's swing after one half."""


@final
@dataclass(frozen=True)
class Mode:
    """A resonance.

    Attributes:
        omega: undamped natural frequency [rad/s].
        zeta: damping.
        share: of the swinging that a step starts, in amplitude; those of an actuator sum up to one.
    """

    omega: float
    zeta: float
    share: float = 1.0


def modes(system: control.StateSpace) -> tuple[Mode, ...]:
    """The modes of a linear system that swing, the largest first.

    A step of the input leaves each pair of poles p with the amplitude 2 |c_p b_p / p| of its
    residue.

    Raises:
        InputError: none does.
    """
    poles, vectors = np.linalg.eig(np.asarray(system.A))
    into = np.linalg.solve(vectors, np.asarray(system.B, dtype=complex)).ravel()
    out = (np.asarray(system.C, dtype=complex) @ vectors).ravel()
    found = []
    for pole, residue in zip(poles, out * into, strict=True):
        zeta = -pole.real / abs(pole) if abs(pole) > 0.0 else 1.0
        if pole.imag > 0.0 and zeta < SWINGS:
            found.append((abs(pole), zeta, 2.0 * abs(residue / pole)))
    if not found:
        raise InputError(
            "Nothing of the model swings (no pair of poles with a damping below "
            f"{SWINGS:g}): a shaper has nothing to still."
        )
    whole = sum(size for *_, size in found)
    made = [Mode(float(w), max(float(z), 0.0), float(s / whole)) for w, z, s in found]
    return tuple(sorted(made, key=lambda mode: -mode.share))


def vibration(amplitudes: FloatArray, times: FloatArray, swinging: Sequence[Mode]) -> float:
    """Share of a bare step's swinging that impulses leave: root of the sum of squares of modes."""
    left = 0.0
    for mode in swinging:
        damped = mode.omega * np.sqrt(1.0 - mode.zeta**2)
        grown = amplitudes * np.exp(mode.zeta * mode.omega * (times - times[-1]))
        left += mode.share**2 * float(np.abs(np.sum(grown * np.exp(1j * damped * times)))) ** 2
    return float(np.sqrt(left / sum(mode.share**2 for mode in swinging)))
