"""State feedback on the estimate of a Kalman filter, with a disturbance that takes the offset."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, ClassVar, final

import casadi as ca
import control
import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class LQGState:
    """What is expected next: states (n,), disturbance of the drive [V]; and the last drive [V]."""

    states: FloatArray
    disturbance: float = 0.0
    drive: float = 0.0


@final
@dataclass(frozen=True, eq=False)
class LQG:
    """A sampled linear-quadratic regulator on the estimate of a stationary Kalman filter.

        v = y - y_0 - C x,   x+ = x + L v,   d+ = d + l v
        u = N (r - y_0) - K x+ - d+,   x = A x+ + B (u + d+)

    The disturbance d of the drive makes it integral action; as the filter is given the drive that
    the limits left, nothing winds up. A reading that is no number, or leads to none, is passed
    over; without a reference the drive is held.

    Attributes:
        a, b, c: (n, n), (n,), (n,) the plant between drive and reading.
        gain: (n,) K [V/...].
        precompensator: N [V/m].
        filter: (n + 1,) L, and l [V/m].
        rest: y_0, the reading at rest without a drive [m].
        period: of the sampling [s].
        largest: v beyond which it is cut [m]: more is a fault of the sensor.

    Source: Franklin, Powell & Workman (1998), Digital Control of Dynamic Systems, ch. 8.
    """

    kind: ClassVar[str] = "lqr"

    a: FloatArray
    b: FloatArray
    c: FloatArray
    gain: FloatArray
    precompensator: float
    filter: FloatArray
    rest: float
    period: float
    largest: float = float("inf")

    def begin(self) -> LQGState:
        """At rest without a drive."""
        return LQGState(np.zeros(self.gain.size))

    def act(
        self, state: LQGState, reference: float, reading: float, period: float,
        low: float, high: float,
    ) -> tuple[float, LQGState]:  # fmt: skip
        """The drive [V] within its limits, and what is expected next.

        Raises:
            InputError: another period than that of the design.
        """
        if abs(period - self.period) > 1e-9 * self.period:
            raise InputError(
                f"The controller is sampled every {self.period:g} s, the loop every {period:g} s."
            )
        off = reading - self.rest - float(self.c @ state.states)
        off = min(max(off, -self.largest), self.largest) if isfinite(off) else off
        found = self._sample(state, reference, off, low, high) if isfinite(off) else None
        found = found or self._sample(state, reference, 0.0, low, high)
        held = min(max(state.drive, low), high)
        return found or (held, replace(state, drive=held))

    def _sample(
        self, state: LQGState, reference: float, off: float, low: float, high: float
    ) -> tuple[float, LQGState] | None:
        """With a surprise [m] of the reading; None where that leads to what is no number."""
        x = state.states + self.filter[:-1] * off
        d = state.disturbance + float(self.filter[-1]) * off
        asked = self.precompensator * (reference - self.rest) - float(self.gain @ x) - d
        drive = min(max(asked if isfinite(asked) else state.drive, low), high)
        after = self.a @ x + self.b * (drive + d)
        if not isfinite(d) or not np.isfinite(after).all():
            return None
        return drive, LQGState(after, d, drive)

    def told(self) -> str:
        """The law and its gains."""
        n = self.gain.size
        return (
            "LQR on the estimate of a Kalman filter, u = N (r - y_0) - K x - d, with d the "
            f"disturbance of the drive (integral action), {n} state{'s' if n > 1 else ''}:\n"
            f"N {self.precompensator:.5g} V/m, K {_row(self.gain)} V, "
            f"L {_row(self.filter[:-1])} 1/m, l {self.filter[-1]:.5g} V/m, y_0 {self.rest:.5g} m"
        )

    def to_dict(self) -> dict[str, Any]:
        """Matrices and gains, SI units; each state is scaled to the size of its motion a volt."""
        names = ("a", "b", "c", "gain", "filter")
        return {
            "kind": self.kind, "period": self.period, "precompensator": self.precompensator,
            "rest": self.rest, "largest": self.largest,
            **{name: getattr(self, name).tolist() for name in names},
        }  # fmt: skip

    def state_space(self) -> control.StateSpace:
        """From the error to the drive, away from the limits, sampled."""
        matrices = linear(
            self.a, self.b[:, np.newaxis], self.c[np.newaxis], self.gain[np.newaxis],
            self.filter[:, np.newaxis],
        )  # fmt: skip
        return control.ss(*matrices, self.period)


def _row(values: FloatArray) -> str:
    return f"[{', '.join(f'{v:.4g}' for v in values)}]"


def linear(
    a: FloatArray, b: FloatArray, c: FloatArray, k: FloatArray, gain: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A, B, C, D of the controller from the error to the drive; all arguments are matrices."""
    n = a.shape[0]
    moved, late = a - b @ k, np.eye(n) - gain[:n] @ c
    inner = np.block([[moved @ late, np.zeros((n, 1))], [-gain[n:] @ c, np.ones((1, 1))]])
    into = -np.vstack([moved @ gain[:n], gain[n:]])
    out = -np.hstack([k @ late - gain[n:] @ c, np.ones((1, 1))])
    return inner, into, out, k @ gain[:n] + gain[n:]


@final
@dataclass(frozen=True)
class LQGLaw:
    """The same law in the symbols of a program: gains A, B, C, K, N, L, y_0 row after row.

    Attributes:
        states: n.
    """

    states: int

    @property
    def gains(self) -> tuple[str, ...]:
        """Of every entry a name."""
        n = self.states
        sizes = {"a": n * n, "b": n, "c": n, "k": n, "n": 1, "l": n + 1, "y": 1}
        return tuple(f"{name}{i}" for name, size in sizes.items() for i in range(size))

    @property
    def memory(self) -> int:
        """Expected states, and the disturbance."""
        return self.states + 1

    @property
    def recipe(self) -> str:
        """The kind and its size."""
        return f"lqg {self.states}"

    def act(
        self, memory: ca.SX, reference: ca.SX, reading: ca.SX, period: ca.SX, low: ca.SX,
        high: ca.SX, gains: ca.SX,
    ) -> tuple[ca.SX, ca.SX]:  # fmt: skip
        """The drive and the next memory."""
        n = self.states
        a, b, c, k, ahead, gain, rest = ca.vertsplit(
            gains, np.cumsum([0, n * n, n, n, n, 1, n + 1, 1]).tolist()
        )
        off = reading - rest - ca.dot(c, memory[:n])
        x, d = memory[:n] + gain[:n] * off, memory[n] + gain[n] * off
        drive = ca.fmin(ca.fmax(ahead * (reference - rest) - ca.dot(k, x) - d, low), high)
        return drive, ca.vertcat(ca.reshape(a, n, n).T @ x + b * (drive + d), d)
