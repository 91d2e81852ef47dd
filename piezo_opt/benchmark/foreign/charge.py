"""A drive that is loaded by the charge of the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np

from piezo_opt.benchmark.foreign.linear import passed
from piezo_opt.benchmark.foreign.mechanics import Resonance
from piezo_opt.benchmark.foreign.operators import Array

_ROUNDS = 60


@final
@dataclass(frozen=True)
class SourceResistance:
    """An output resistance R and the charge q = C u + n x (Adriaens, de Koning and Banning, 2000).

        u + R q' = v:        rc u' + u = v - load x' / (gain omega),    s = gain u + H(u)

    The linear part is solved exactly; the hysteresis H follows by iteration.

    Attributes:
        rc: R C [s].
        gain: of the linear part of the strain [m/V].
        strength: load, R n gain omega.
    """

    rc: float
    gain: float
    strength: float

    def moved(
        self, strain: Callable[[Array], Array], drive: Array, mechanics: Resonance, step: float
    ) -> Array:
        """Position under a drive, with ``strain`` from the voltage to the free displacement.

        Raises:
            ValueError: the iteration does not settle.
        """
        pace = step * mechanics.omega  # time in units of 1 / omega
        rc = self.rc * mechanics.omega
        motion = np.array([1.0, 2.0 * mechanics.zeta, 1.0])
        whole = np.polymul([rc, 1.0], motion)
        whole[2] += self.strength
        linear = passed([self.gain], whole.tolist(), drive, pace)
        filtered = passed([1.0], [rc, 1.0], drive, pace)
        voltage, position = filtered, linear
        for _ in range(_ROUNDS):
            rest = strain(voltage) - self.gain * voltage
            before, position = position, linear + passed([rc, 1.0], whole.tolist(), rest, pace)
            load = passed([self.strength / self.gain, 0.0], [rc, 1.0], position, pace)
            voltage = filtered - load
            if np.max(np.abs(position - before)) < 1e-7 * np.ptp(position):
                return position
        raise ValueError("The loaded drive does not settle: ask for a smaller load.")
