"""The response to a voltage of one frequency, without reduction to modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.errors import InputError
from piezo_opt.finite_elements.body import Body, FloatArray
from piezo_opt.finite_elements.system import System, factorised


@final
@dataclass(frozen=True, eq=False)
class Harmonic:
    """Undamped steady state under one volt.

    Attributes:
        frequencies: (m,) [Hz].
        tip: (m,) displacement of the top a volt [m/V], negative when against the voltage.
        charge: (m,) charge a volt [F].
    """

    frequencies: FloatArray
    tip: FloatArray
    charge: FloatArray


def harmonic(what: Body | System, frequencies: FloatArray) -> Harmonic:
    """Solve (K - omega^2 M) x = known at every frequency, one factorisation each.

    Exact for the mesh; :func:`reduced` answers thousands of frequencies with a few modes.

    Args:
        what: a body, or its system with driven electrodes.
        frequencies: (m,) [Hz].

    Raises:
        InputError: a frequency is negative, or there is no response at a resonance.
    """
    system = what if isinstance(what, System) else System(what)
    body, volts = system.body, system.matrices.volts
    asked = np.asarray(frequencies, dtype=np.float64)
    if asked.size == 0 or not np.all(asked >= 0.0):
        raise InputError("harmonic analysis takes one frequency or more, none below 0 Hz")
    known = system.drive(1.0)
    tips, charges = [], []
    for frequency in asked:
        omega2 = float((2.0 * np.pi * frequency) ** 2)
        matrix = system.matrices.stiffness - omega2 * system.matrices.mass
        right = -system.reduced(matrix @ known)
        inner = (system.stiffness - omega2 * system.mass).tocsc()
        x = known + system.whole(factorised(inner).solve(right))
        rest = (matrix @ x).reshape(-1, 4)
        tips.append(float(body.over_top @ x.reshape(-1, 4)[:, 2]))
        charges.append(-float(rest[body.driven, 3].sum()) / volts)
    return Harmonic(asked, np.array(tips), np.array(charges))
