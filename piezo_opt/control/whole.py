"""The predictive controller's program solved to its end by a general solver, to compare with."""

from __future__ import annotations

from typing import Any, Final, cast, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.motion import advance_function
from piezo_opt.control.mpc import MPC, MPCState
from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]

SOLVERS: Final = ("ipopt", "fatrop")
MOST: Final = 300
"""Iterations: what converges takes ten to a hundred, and what does not would take thousands."""


@final
class WholeMPC:
    """The same controller as an :class:`MPC`, each program solved until it has converged.

    Multiple shooting over states and drive, functions expanded to scalars, exact Hessian, begun
    from the last solution. Estimates are the controller's own.

    Args:
        controller: whose program it is; without limits of the reading.
        solver: "ipopt" or "fatrop".

    Raises:
        InputError: another solver, or a limit of the reading.
    """

    def __init__(self, controller: MPC, solver: str = "fatrop") -> None:
        if solver not in SOLVERS:
            raise InputError(f"solver = {solver}: give one of {', '.join(SOLVERS)}")
        if controller.stroke is not None or controller.delay:
            raise InputError("The comparison has neither limits of the reading nor a delay.")
        self.controller = controller
        m, n = controller.observer.horizon, controller.horizon
        nx = m.states
        step = advance_function(m.system, m.steps.rise, m.steps.held)
        z0, time = ca.SX.sym("z0", nx + 1), ca.SX.sym("t")
        goals, off = ca.SX.sym("r", n), ca.SX.sym("d")
        first = ca.SX.sym("first", 2)
        weights = controller.weights
        variables, rows, equal, cost = [], [], [], ca.SX(0.0)
        z = ca.SX.sym("z_0", nx + 1)
        for k in range(n):
            w = ca.SX.sym(f"w_{k}")
            after = ca.SX.sym(f"z_{k + 1}", nx + 1)
            variables += [z, w]
            moved, y = step(
                z[:nx], time + k * m.period, z[nx], z[nx] + w, m.period, ca.DM(m.p)
            )  # fmt: skip
            rows.append(after - ca.vertcat(moved, z[nx] + w))
            equal += [True] * (nx + 1)
            if k == 0:
                rows.append(z - z0)
                equal += [True] * (nx + 1)
            rows += [z[nx] + w, w] if k else [z[nx] + w, ca.SX(0.0) + w]
            equal += [False, False]
            cost += 0.5 * weights[0] * (y + off - goals[k]) ** 2 + 0.5 * weights[1] * w**2
            z = after
        variables.append(z)
        program = {
            "x": ca.vertcat(*variables), "f": cost, "g": ca.vertcat(*rows),
            "p": ca.vertcat(z0, time, goals, off, first),
        }  # fmt: skip
        options: dict[str, Any] = {"print_time": 0, "expand": True, "error_on_fail": False}
        if solver == "ipopt":
            options |= {
                "ipopt.print_level": 0,
                "ipopt.sb": "yes",
                "ipopt.tol": 1e-9,
                "ipopt.max_iter": MOST,
            }
        else:
            options |= {
                "structure_detection": "auto", "equality": equal, "fatrop.print_level": 0,
                "fatrop.tol": 1e-9, "fatrop.max_iter": MOST,
            }  # fmt: skip
        self._solver = ca.nlpsol("whole", solver, program, cast(Any, options))
        self._equal, self._nx, self._n = np.array(equal), nx, n
        self._last: FloatArray | None = None

    def begin(self) -> MPCState:
        """As the controller's own."""
        self._last = None
        return self.controller.begin()

    def act(
        self, state: MPCState, reference: float, reading: float, period: float,
        low: float, high: float,
    ) -> tuple[float, MPCState]:  # fmt: skip
        """The drive of the converged program."""
        c = self.controller
        estimate = c.estimated(state, reading)
        n, nx = self._n, self._nx
        goals, u = c.following(state.sample, reference), estimate.drive
        far = c.limits.slew * c.period
        lower = np.zeros(self._equal.size)
        upper = lower.copy()
        bounded = np.flatnonzero(~self._equal)
        lower[bounded[::2]], upper[bounded[::2]] = c.limits.low, c.limits.high
        lower[bounded[1::2]], upper[bounded[1::2]] = -far, far
        lower[bounded[0]], upper[bounded[0]] = low, high
        lower[bounded[1]], upper[bounded[1]] = low - u, high - u
        z0 = np.append(estimate.states[:nx], u)
        if self._last is None:
            self._last = np.append(np.tile(np.append(z0, 0.0), n), z0)
        else:
            width = nx + 2
            self._last = np.append(self._last[width:], [0.0, *self._last[-(nx + 1) :]])
        answer = self._solver(
            x0=self._last, lbg=np.maximum(lower, -1e19), ubg=np.minimum(upper, 1e19),
            p=np.concatenate([z0, [estimate.time], goals, [estimate.states[nx]], [low, high]]),
        )  # fmt: skip
        self._last = np.asarray(answer["x"], dtype=float).ravel()
        drive = float(np.clip(u + self._last[nx + 1], low, high))
        return drive, MPCState(
            state.sample + 1, estimate, np.zeros(n), (drive,), 1,
            0 if self._solver.stats()["success"] else 1,
        )  # fmt: skip
