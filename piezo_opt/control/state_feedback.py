"""State feedback u = N r - K x: by Riccati's equation, as a program, and by placing poles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast, final

import casadi as ca
import control
import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True, eq=False)
class StateFeedback:
    """The law u = N r - K x of a system with one input and one output.

    Attributes:
        system: the plant.
        gain: (1, n) K.
        precompensator: N, with which the output follows a constant reference.
    """

    system: control.StateSpace
    gain: FloatArray
    precompensator: float

    @property
    def closed(self) -> control.StateSpace:
        """From the reference to the output."""
        s = self.system
        a, c = s.A - s.B @ self.gain, s.C - s.D @ self.gain
        return control.ss(a, s.B * self.precompensator, c, s.D * self.precompensator)


def _checked(system: control.StateSpace) -> None:
    if system.ninputs != 1 or system.noutputs != 1:
        raise InputError(
            f"The system has {system.ninputs} inputs and {system.noutputs} outputs: state feedback "
            "is designed for one of each here."
        )
    reached = control.ctrb(system.A, system.B)
    # Columns of different powers of A: their size is no matter.
    size = np.linalg.norm(reached, axis=0)
    if np.linalg.matrix_rank(reached / np.where(size > 0.0, size, 1.0)) < system.nstates:
        raise InputError(
            "Some states of the system cannot be moved by its input: leave them out "
            "(control.minreal(system))."
        )


def _with_gain(system: control.StateSpace, gain: FloatArray) -> StateFeedback:
    """N = 1 / (C_k (-A_k)^-1 B + D), of the closed loop A_k = A - B K, C_k = C - D K."""
    closed = system.A - system.B @ gain
    slope = (system.C - system.D @ gain) @ np.linalg.solve(-closed, system.B) + system.D
    if slope[0, 0] == 0.0:
        raise InputError(
            "The output does not follow a constant input (a zero at the origin): no precompensator "
            "makes it follow a reference."
        )
    return StateFeedback(system, gain, float(1.0 / slope[0, 0]))


def _weights(system: control.StateSpace, q: ArrayLike, r: float) -> FloatArray:
    weight = np.atleast_1d(np.asarray(q, dtype=float))
    weight = np.diag(weight) if weight.ndim == 1 else weight
    n = system.nstates
    if weight.shape != (n, n):
        raise InputError(f"q has the shape {weight.shape}: the system has {n} states")
    if not np.allclose(weight, weight.T) or np.linalg.eigvalsh(weight).min() < 0.0:
        raise InputError("q must be symmetric without negative eigenvalues: else no cost is least")
    if not r > 0.0:
        raise InputError(f"r = {r}: the weight of the input must be positive")
    return weight


def lqr(system: control.StateSpace, q: ArrayLike, r: float = 1.0) -> StateFeedback:
    """The feedback that minimises int x'Q x + r u^2 dt, by the algebraic Riccati equation.

    Args:
        system: one input, one output.
        q: (n,) diagonal, or (n, n), of the weight of the states.
        r: weight of the input.

    Raises:
        InputError: weights of another size or sign; states that the input cannot move.

    Source: Anderson & Moore (1990), Optimal Control: Linear Quadratic Methods, ch. 3.
    """
    weight = _weights(system, q, r)
    _checked(system)
    gain, _, _ = control.lqr(system, weight, np.array([[r]]))
    return _with_gain(system, np.asarray(gain, dtype=float))


def lqr_as_program(system: control.StateSpace, q: ArrayLike, r: float = 1.0) -> StateFeedback:
    """The same feedback as a nonlinear program over K.

        min ln tr P(K)   with   (A - B K)'P + P (A - B K) + Q + r K'K = 0

    The mean cost from starts in all directions is tr P; a gain that does not stabilise has none,
    and its logarithm turns IPOPT back. The program begins at poles placed in the left half plane.

    Args, raises: as :func:`lqr`.
    """
    weight = _weights(system, q, r)
    _checked(system)
    n = system.nstates
    a, b = np.asarray(system.A), np.asarray(system.B)
    speed = max(1e-12, float(np.abs(np.linalg.eigvals(a)).max()))
    begin = np.asarray(control.place(a, b, -speed * (1.0 + np.arange(n)) / n)).ravel()
    k = ca.SX.sym("k", n)
    loop = a - b @ k.T
    one = ca.SX.eye(n)
    lyapunov = ca.kron(one, loop.T) + ca.kron(loop.T, one)
    cost = ca.reshape(ca.solve(lyapunov, -ca.vec(weight + r * k @ k.T)), n, n)
    program: dict[str, Any] = {"x": k, "f": ca.log(ca.trace(cost))}
    options = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-12}
    solver = ca.nlpsol("lqr", "ipopt", program, cast(Any, options))
    answer = solver(x0=begin)
    gain = np.asarray(answer["x"], dtype=float).reshape(1, n)
    if not (solver.stats()["success"] and np.linalg.eigvals(a - b @ gain).real.max() < 0.0):
        raise InputError(f"The program did not converge: {solver.stats()['return_status']}")
    return _with_gain(system, gain)


def pole_placement(
    system: control.StateSpace, *, overshoot: float, settling: float
) -> StateFeedback:
    """Poles that answer a step with this overshoot, and settle within 2 % in this time.

        zeta = -ln(o) / sqrt(pi^2 + ln^2 o),   zeta omega_n = 4 / t_s,
        s = -zeta omega_n +- i omega_n sqrt(1 - zeta^2)

    Further poles are five times as fast.

    Args:
        system: one input, one output, two states or more.
        overshoot: as a share, 0.02.
        settling: t_s [s].

    Raises:
        InputError: an overshoot that is none, no time, or states that the input cannot move.

    Source: Ogata (2010), Modern Control Engineering, 5th ed., secs. 5-3 and 10-2.
    """
    if not 0.0 < overshoot < 1.0 or not settling > 0.0:
        raise InputError(
            f"overshoot = {overshoot}, settling = {settling} s: give a share between 0 and 1, and "
            "a positive time"
        )
    _checked(system)
    if system.nstates < 2:
        raise InputError("The system has one state: an overshoot takes two.")
    decay = np.log(overshoot)
    zeta = float(-decay / np.hypot(np.pi, decay))
    real = 4.0 / settling
    imaginary = real / zeta * np.sqrt(1.0 - zeta**2)
    more = -5.0 * real * (1.0 + 0.1 * np.arange(system.nstates - 2))
    poles = np.concatenate([[-real + 1j * imaginary, -real - 1j * imaginary], more])
    return _with_gain(system, np.asarray(control.place(system.A, system.B, poles), dtype=float))
