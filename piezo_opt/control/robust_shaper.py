"""The shaper that leaves least vibration over the actuators that a record allows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.control.modes import Mode
from piezo_opt.control.shapers import Shaper, zvd
from piezo_opt.errors import InputError

FloatArray = NDArray[np.float64]

_LEAST: Final = 1e-3
"""Of the delay between two impulses."""


def robust(
    actuators: Sequence[Sequence[Mode]], delay: float | None = None, impulses: int = 3
) -> Shaper:
    """Amplitudes and times with the smallest mean square of the vibration.

        min over A, t   mean over actuators of  sum_m s_m^2 V_m(A, t)^2 / sum_m s_m^2
        with   sum A = 1,   A >= 0,   0 = t_1 < ... < t_n <= delay

    of the modes m of each actuator with their shares s of a step's swinging: a nonlinear program,
    by IPOPT, from a shaper of equal steps.

    Args:
        actuators: modes of each of the actuators that are thought possible.
        delay: longest [s]; that of ZVD for the first actuator's largest mode unless given.
        impulses: n.

    Raises:
        InputError: fewer than two impulses, no delay, or a program that does not converge.

    Source: Singhose, Seering & Singer (1997), J. Mech. Design 119, 198-205 (expected vibration).
    """
    largest = actuators[0][0]
    allowed = zvd(largest.omega, largest.zeta).delay if delay is None else delay
    if impulses < 2 or not 0.0 < allowed < float("inf"):
        raise InputError(
            f"impulses = {impulses}, delay = {allowed} s: give two impulses or more, and a "
            "positive time"
        )
    a, gaps = ca.SX.sym("a", impulses), ca.SX.sym("gap", impulses - 1)
    # In units of the delay.
    times = ca.vertcat(0.0, ca.cumsum(gaps))
    costs = []
    for own in actuators:
        whole = sum(mode.share**2 for mode in own)
        for mode in own:
            turn, fall = allowed * mode.omega, mode.zeta * allowed * mode.omega
            grown = a * ca.exp(fall * (times - times[-1]))
            phase = turn * np.sqrt(1.0 - mode.zeta**2) * times
            left = ca.dot(grown, ca.cos(phase)) ** 2 + ca.dot(grown, ca.sin(phase)) ** 2
            costs.append(mode.share**2 / whole * left)
    program: dict[str, Any] = {
        "x": ca.vertcat(a, gaps), "f": sum(costs) / len(actuators),
        "g": ca.vertcat(ca.sum1(a), times[-1]),
    }  # fmt: skip
    options = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-12}
    solver = ca.nlpsol("shaper", "ipopt", program, cast(Any, options))
    best: tuple[float, FloatArray] | None = None
    # Vibration over time has minima half a swing apart: begun at the whole of the delay and less.
    for part in (1.0, 0.75, 0.5):
        weights = np.array([1.0, *[2.0] * (impulses - 2), 1.0])
        start = [*(weights / weights.sum()), *[part / (impulses - 1)] * (impulses - 1)]
        answer = solver(
            x0=start, lbx=[0.0] * impulses + [_LEAST] * (impulses - 1), ubx=1.0,
            lbg=[1.0, 0.0], ubg=[1.0, 1.0],
        )  # fmt: skip
        if solver.stats()["success"] and (best is None or float(answer["f"]) < best[0]):
            best = float(answer["f"]), np.asarray(answer["x"], dtype=float).ravel()
    if best is None:
        raise InputError(f"The program did not converge: {solver.stats()['return_status']}")
    found = best[1]
    amplitudes = np.clip(found[:impulses], 0.0, 1.0)
    return Shaper(
        "robust", amplitudes / amplitudes.sum(),
        allowed * np.concatenate([[0.0], np.cumsum(found[impulses:])]),
    )  # fmt: skip
