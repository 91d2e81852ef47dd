"""A linear controller that another toolkit designed, in the loop with its limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import control
import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class LinearState:
    """What a linear controller remembers: its states (n,), and the last drive [V]."""

    x: FloatArray
    drive: float | None = None


@final
class LinearLaw:
    """A sampled system of python-control's, from the error e = r - y to the drive.

        u = C x + D e,   x' = A x + B e

    Where the drive is limited to v, x' follows the error with which it would have been v, e + (v -
    u) / D, so that nothing winds up. That takes a D, and zeros within the unit circle; without
    them x' goes on as if nothing were limited. A sample that is no number holds the drive.

    Args:
        system: one input [m], one output [V], with the loop's period as its ``dt``.

    Raises:
        InputError: a continuous system, or one of several inputs or outputs.

    Source: Hanus, Kinnaert & Henrotte (1987), Automatica 23(6), 729-739.
    """

    def __init__(self, system: control.TransferFunction | control.StateSpace) -> None:
        whole = control.ss(system)
        if not (isinstance(whole.dt, float | int) and not isinstance(whole.dt, bool) and whole.dt):
            raise InputError(
                "The controller has no sampling period: take control.sample_system(system, "
                "period), or give it one as its dt."
            )
        if (whole.ninputs, whole.noutputs) != (1, 1):
            raise InputError(
                f"The controller has {whole.ninputs} inputs and {whole.noutputs} outputs: the loop "
                "gives it one error and takes one drive."
            )
        self.period = float(whole.dt)
        self._a, self._b, self._c = (
            np.asarray(m, dtype=float) for m in (whole.A, whole.B, whole.C)
        )
        self._d = float(whole.D[0, 0])
        self._bound = self._d != 0.0 and bool(
            np.abs(np.linalg.eigvals(self._a - self._b @ self._c / self._d)).max(initial=0.0) < 1.0
        )

    def begin(self) -> LinearState:
        """Nothing remembered."""
        return LinearState(np.zeros(self._a.shape[0]))

    def act(
        self, state: LinearState, reference: float, reading: float, period: float,
        low: float, high: float,
    ) -> tuple[float, LinearState]:  # fmt: skip
        """The drive [V] within its limits, and what is remembered for the next sample.

        Raises:
            InputError: the loop has another period.
        """
        if abs(period - self.period) > 1e-9 * period:
            raise InputError(
                f"The controller is sampled every {self.period:g} s, the loop every {period:g} s."
            )
        error = reference - reading
        wanted = float(self._c[0] @ state.x) + self._d * error
        if not np.isfinite(wanted):
            kept = min(max(0.0, low), high) if state.drive is None else state.drive
            return min(max(kept, low), high), state
        drive = min(max(wanted, low), high)
        if self._bound:
            error += (drive - wanted) / self._d
        return drive, LinearState(self._a @ state.x + self._b[:, 0] * error, drive)
