"""CasADi's solvers of nonlinear programs on single shooting: a few unknowns, exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.solvers.base import Solution

FloatArray = NDArray[np.float64]

_QP: Final[dict[str, Any]] = {
    "qpsol": "qrqp",
    "qpsol_options": {
        "print_iter": False, "print_header": False, "print_info": False, "print_time": False,
        "error_on_fail": False,
    },
}  # fmt: skip
_SILENT: Final[dict[str, Any]] = {"print_time": False, "error_on_fail": False}
_SQP: Final[dict[str, Any]] = {
    **_SILENT, **_QP, "print_header": False, "print_iteration": False, "print_status": False,
    "max_iter": 100, "tol_du": 1e-10,
}  # fmt: skip
_OPTIONS: Final[dict[str, dict[str, Any]]] = {
    "ipopt": {
        **_SILENT,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.max_iter": 300,
        "ipopt.tol": 1e-10,
    },
    "sqpmethod": _SQP,
    "feasiblesqpmethod": _SQP,
    "qrsqp": {**_SILENT},
    "scpgen": {**_SILENT, **_QP},
}
"""What keeps each of them quiet, and what it does not run without."""


@final
@dataclass(frozen=True)
class DenseProgram:
    """A solver of nonlinear programs out of CasADi, by its name there, on the cost itself.

        minimise cost(theta) within the bounds,   gradient J'r,   Hessian J'J

    Cost, gradient and the Gauss-Newton Hessian come from one simulation with sensitivities.

    Args:
        plugin: ``"ipopt"``, ``"uno"``, ``"sleqp"``, ``"alpaqa"``, ``"sqpmethod"``,
            ``"feasiblesqpmethod"``, or any other that this CasADi has.

    Reference: Andersson, Gillis, Horn, Rawlings & Diehl (2019), Math. Program. Comput. 11, 1-36.
    """

    plugin: str = "ipopt"

    @property
    def name(self) -> str:
        """Name in tables."""
        return self.plugin

    def minimise(self, objective: Objective, start: FloatArray) -> Solution:
        """From a start within the bounds to a minimum.

        Raises:
            InputError: this CasADi does not have the solver, or cannot load its library.
        """
        unknowns = objective.unknowns
        at = _Point(objective, unknowns.clip(start))
        z = ca.MX.sym("z", start.size)
        cost = _Cost(at)
        options = _OPTIONS.get(self.plugin, {"print_time": False})
        try:
            solver = ca.nlpsol("po_dense", self.plugin, {"x": z, "f": cost(z)}, options)
        except RuntimeError as error:
            raise InputError(
                f"CasADi's solver '{self.plugin}' does not run here: {_why(error)}."
            ) from None
        scale = unknowns.scale
        failed = ""
        try:
            found = solver(
                x0=unknowns.clip(start) / scale, lbx=unknowns.low / scale, ubx=unknowns.high / scale
            )
            at.at(np.array(found["x"], dtype=float).ravel())
        except RuntimeError as error:
            failed = _why(error)
        if at.raised is not None:
            raise at.raised
        if "shared library" in failed:
            raise InputError(f"CasADi's solver '{self.plugin}' does not run here: {failed}.")
        best = objective.monitor.best
        if best is None:
            return Solution(unknowns.clip(start), Ending.FAILED, failed or "nothing was finite")
        if failed or not solver.stats().get("success", False):
            why = failed or str(solver.stats().get("return_status", "no reason given"))
            return Solution(
                best, Ending.LIMIT,
                f"{self.plugin} gave up ({why}); this is the best point that it saw.",
            )  # fmt: skip
        return Solution(best, Ending.CONVERGED, "optimality is met")


def _why(error: RuntimeError) -> str:
    """The line of a message of CasADi's that says something."""
    lines = [line.strip(" '\"") for line in str(error).splitlines() if line.strip(" '\"")]
    telling = [line for line in lines if not line.startswith(("Error", ".../", "in "))]
    return (telling or lines or ["no reason given"])[0].rpartition(": ")[2].rstrip(":.")


@final
class _Point:
    """Cost and derivatives at the last point that was asked for, by scaled unknowns."""

    def __init__(self, objective: Objective, start: FloatArray) -> None:
        self._objective = objective
        self._scale = objective.unknowns.scale
        self._asked: FloatArray | None = None
        self._unit = 1.0
        self.raised: BaseException | None = None
        self.size = start.size
        self.cost: float = np.nan
        self.gradient: FloatArray = np.full(start.size, np.nan)
        self.hessian: FloatArray = np.full((start.size, start.size), np.nan)
        self.at(start / self._scale)
        if self.raised is not None:
            raise self.raised
        # Costs of order one, or an absolute tolerance would be met at once.
        self._unit = self.cost if 0.0 < self.cost < np.inf else 1.0
        self.cost, self.gradient = self.cost / self._unit, self.gradient / self._unit
        self.hessian = self.hessian / self._unit

    def at(self, scaled: FloatArray) -> _Point:
        """Everything at a point; not a number once something has been raised."""
        z = np.asarray(scaled, dtype=float).ravel()
        if self._asked is not None and np.array_equal(z, self._asked):
            return self
        self._asked = z.copy()
        self.cost = np.nan
        self.gradient, self.hessian = np.full(z.size, np.nan), np.full((z.size, z.size), np.nan)
        if self.raised is not None:
            return self
        objective = self._objective
        theta = objective.unknowns.clip(z * self._scale)
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                point = objective.linearised(theta)
                cost = objective.cost(point.residual)
                robust = objective.robust(point)
                jacobian = robust.jacobian * self._scale
                self.gradient = jacobian.T @ robust.residual / self._unit
                self.hessian = jacobian.T @ jacobian / self._unit
        except BaseException as error:  # which must not pass through compiled code
            self.raised = error
            return self
        known = np.isfinite(cost) and np.isfinite(self.hessian).all()
        self.cost = cost / self._unit if known else np.nan
        if known:
            objective.monitor.saw(theta, cost)
            objective.monitor.iterate(theta, objective.rms(point.residual))
        return self


class _Cost(ca.Callback):
    """The cost of scaled unknowns."""

    def __init__(self, at: _Point) -> None:
        ca.Callback.__init__(self)
        self._at = at
        self._kept: list[ca.Callback] = []
        self.construct("po_cost", {})

    def get_n_in(self) -> int:
        """The unknowns."""
        return 1

    def get_n_out(self) -> int:
        """The cost."""
        return 1

    def get_sparsity_in(self, i: int) -> Any:  # noqa: ARG002
        """A column."""
        return ca.Sparsity.dense(self._at.size, 1)

    def eval(self, arguments: Any) -> list[Any]:
        """The cost."""
        return [float(self._at.at(np.array(arguments[0])).cost)]

    def has_jacobian(self) -> bool:
        """The gradient is known."""
        return True

    def get_jacobian(self, name: str, _inames: Any, _onames: Any, options: Any) -> Any:
        """The gradient."""
        self._kept.append(_Gradient(self._at, name, options))
        return self._kept[-1]


class _Gradient(ca.Callback):
    """The gradient, as CasADi calls it: by the unknowns and the cost there."""

    def __init__(self, at: _Point, name: str, options: Any) -> None:
        ca.Callback.__init__(self)
        self._at = at
        self._kept: list[ca.Callback] = []
        self.construct(name, options)

    def get_n_in(self) -> int:
        """The unknowns, and the cost."""
        return 2

    def get_n_out(self) -> int:
        """The gradient."""
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        """A column, and a number."""
        return ca.Sparsity.dense(self._at.size if i == 0 else 1, 1)

    def get_sparsity_out(self, i: int) -> Any:  # noqa: ARG002
        """A row."""
        return ca.Sparsity.dense(1, self._at.size)

    def eval(self, arguments: Any) -> list[Any]:
        """The gradient."""
        return [ca.DM(self._at.at(np.array(arguments[0])).gradient).T]

    def has_jacobian(self) -> bool:
        """The Hessian is known, near enough."""
        return True

    def get_jacobian(self, name: str, _inames: Any, _onames: Any, options: Any) -> Any:
        """The Hessian of Gauss and Newton."""
        self._kept.append(_Hessian(self._at, name, options))
        return self._kept[-1]


class _Hessian(ca.Callback):
    """The Hessian of Gauss and Newton, as CasADi calls it."""

    def __init__(self, at: _Point, name: str, options: Any) -> None:
        ca.Callback.__init__(self)
        self._at = at
        self.construct(name, options)

    def get_n_in(self) -> int:
        """The unknowns, the cost, and the gradient."""
        return 3

    def get_n_out(self) -> int:
        """Derivatives of the gradient by the unknowns, and by the cost."""
        return 2

    def get_sparsity_in(self, i: int) -> Any:
        """A column, a number, and a row."""
        n = self._at.size
        return ca.Sparsity.dense(*((n, 1), (1, 1), (1, n))[i])

    def get_sparsity_out(self, i: int) -> Any:
        """A square, and nothing."""
        n = self._at.size
        return ca.Sparsity.dense(n, n) if i == 0 else ca.Sparsity(n, 1)

    def eval(self, arguments: Any) -> list[Any]:
        """The Hessian."""
        return [ca.DM(self._at.at(np.array(arguments[0])).hessian), ca.DM(self._at.size, 1)]
