"""The predictive controller's program as a user of do-mpc writes it."""

from __future__ import annotations

import warnings
from importlib.util import find_spec
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.control import MPC
from piezo_opt.control.motion import advance_function
from piezo_opt.control.mpc import MPCState
from piezo_opt.control.whole import MOST


def installed() -> bool:
    """Whether do-mpc is."""
    return find_spec("do_mpc") is not None


@final
class ToolkitMPC:
    """The same program as an :class:`~piezo_opt.control.MPC`, in do-mpc with its own settings.

    A discrete model of states, drive and reading, moves of the drive as input, references as what
    varies in time; multiple shooting, IPOPT with exact Hessian, begun from the last solution.
    Estimates are the controller's own.

    Args:
        controller: whose program it is; without limits of the reading and without a delay.

    Source: Fiedler et al. (2023), Control Engineering Practice 140, 105676.
    """

    def __init__(self, controller: MPC) -> None:
        with warnings.catch_warnings():
            # At its import it tells of extras that are not installed.
            warnings.simplefilter("ignore")
            import do_mpc

        self.controller = controller
        m, n = controller.observer.horizon, controller.horizon
        step = advance_function(m.system, m.steps.rise, m.steps.held)
        model = do_mpc.model.Model("discrete", "SX")
        x = model.set_variable("_x", "x", shape=(m.states, 1))
        u = model.set_variable("_x", "u")
        y = model.set_variable("_x", "y")
        w = model.set_variable("_u", "w")
        goal = model.set_variable("_tvp", "goal")
        moved, read = step(x, 0.0, u, u + w, m.period, m.p)
        model.set_rhs("x", moved)
        model.set_rhs("u", u + w)
        model.set_rhs("y", read)
        model.setup()
        own = do_mpc.controller.MPC(model)
        own.settings.n_horizon, own.settings.t_step = n, m.period
        own.settings.store_full_solution = False
        own.settings.supress_ipopt_output()
        own.settings.nlpsol_opts["ipopt.max_iter"] = MOST
        error, move = (0.5 * float(one) for one in controller.weights[:2])
        off = error * (y - goal) ** 2
        own.set_objective(mterm=off, lterm=off + move * w**2)
        # Without scaling its tolerance of 1e-8 is a hundredth of a micrometre.
        own.scaling["_x", "x"] = _sizes(controller)
        own.scaling["_x", "u"] = own.scaling["_u", "w"] = controller.span / controller.gain
        own.scaling["_x", "y"] = controller.span
        limits = controller.limits
        far = limits.slew * m.period
        for place, name, low, high in (
            ("_x", "u", limits.low, limits.high), ("_u", "w", -far, far),
        ):  # fmt: skip
            own.bounds["lower", place, name] = low
            own.bounds["upper", place, name] = high
        self._ahead = np.zeros(n + 1)
        self._template = own.get_tvp_template()
        own.set_tvp_fun(self._goals)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            own.setup()
        self._own, self._begun = own, False

    def _goals(self, _: float) -> Any:
        for k, goal in enumerate(self._ahead.tolist()):
            self._template["_tvp", k, "goal"] = goal
        return self._template

    def begin(self) -> MPCState:
        """As the controller's own."""
        self._begun = False
        return self.controller.begin()

    def act(
        self, state: MPCState, reference: float, reading: float, period: float,
        low: float, high: float,
    ) -> tuple[float, MPCState]:  # fmt: skip
        """The drive of the converged program."""
        c = self.controller
        estimate = c.estimated(state, reading)
        x, u, off = estimate.states[:-1], estimate.drive, float(estimate.states[-1])
        goals = c.following(state.sample, reference) - off
        self._ahead = np.concatenate([goals[:1], goals])
        now = np.concatenate([x, [u, c.observer.horizon.reading(estimate.time, x, u)]])
        if not self._begun:
            self._own.x0 = now
            self._own.set_initial_guess()
            self._begun = True
        move = float(self._own.make_step(now)[0, 0])
        drive = min(max(u + move, low), high)
        good = bool(self._own.solver_stats["success"])
        return drive, MPCState(
            state.sample + 1, estimate, np.zeros(c.horizon), (drive,), 1, 0 if good else 1
        )


def _sizes(controller: MPC) -> NDArray[np.float64]:
    """How large the states become while the reading goes through its span and back."""
    m, drive = controller.observer.horizon, 0.0
    x, largest = m.rest(0.0), np.zeros(m.states)
    volts = controller.span / controller.gain
    for goal in volts * (1.0 - np.abs(np.linspace(-1.0, 1.0, controller.horizon))):
        x = m.along(0.0, x, drive, np.array([goal - drive])).end
        drive, largest = float(goal), np.maximum(largest, np.abs(x))
    return np.asarray(np.where(largest > 0.0, largest, 1.0))
