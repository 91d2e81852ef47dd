"""A nonlinear program as data: many copies of a few small functions, and where they touch.

Shooting over short stretches and collocation repeat the same small computation thousands of times
on different data. Written as elements (a function, the variables it reads, the constraint rows it
fills), gradient, Jacobian and Hessian are assembled like the matrices of finite elements: the
small function is differentiated once, mapped over its copies, and its entries are added where
they belong. That builds a problem of 8000 samples in about a second and keeps it sparse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.identification.problem import Loss, Shape

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

Curvature = Literal["exact", "gauss_newton"]
"""Hessian of the Lagrangian: all of it, or only that of the sum of squares, without residual and
constraint curvature."""


@final
@dataclass(frozen=True, eq=False)
class Element:
    """K copies of one small function.

    Attributes:
        function: SX function ``(v, d) -> (residual, constraint)`` of n variables and q data.
        variables: (K, n) indices of the variables each copy reads, all different within a copy.
        rows: (K, m) indices of the constraint rows each copy fills.
        data: (q, K) numbers of each copy.
    """

    function: ca.Function
    variables: IntArray
    rows: IntArray
    data: FloatArray


@final
@dataclass(frozen=True)
class Stages:
    """Order of variables and constraints along time, for solvers that use it.

    Variables are ordered by stage, states before controls; constraints by stage, first the rows
    ``next state - f(state, control) = 0``, then the others of the stage.

    Attributes:
        states, controls: number of each in every stage.
        others: number of constraints besides those that lead to the next stage.
    """

    states: tuple[int, ...]
    controls: tuple[int, ...]
    others: tuple[int, ...]


@final
@dataclass(frozen=True, eq=False)
class Program:
    """Minimise ``sum 1/2 rho(residuals)`` subject to ``constraints = 0`` and bounds.

    Attributes:
        elements: what the sum and the constraints are made of.
        loss: rho, its scale in units of the residuals.
        start: (n,) initial guess.
        low, high: (n,) bounds of the variables.
        constraints: number of constraint rows.
        unknowns: (k,) indices of the question's (scaled) unknowns among the variables.
        stages: the order along time, None where variables are shared between stages.
    """

    elements: tuple[Element, ...]
    loss: Loss
    start: FloatArray
    low: FloatArray
    high: FloatArray
    constraints: int
    unknowns: IntArray
    stages: Stages | None


@final
@dataclass(frozen=True, eq=False)
class Functions:
    """A program as CasADi functions, with the names and outputs that solvers expect.

    Attributes:
        problem: x, f and g as expressions.
        gradient: ``(x, p) -> (f, gradient)``.
        jacobian: ``(x, p) -> (g, Jacobian)``.
        both: ``(x, p) -> (f, gradient, g, Jacobian)``.
        hessian: ``(x, p, lam_f, lam_g) -> upper triangle``.
        full_hessian: the same with both triangles.
    """

    problem: dict[str, Any]
    gradient: ca.Function
    jacobian: ca.Function
    both: ca.Function
    hessian: ca.Function
    full_hessian: ca.Function


def functions(program: Program, curvature: Curvature) -> Functions:
    """Assemble a program's functions and their derivatives."""
    n, m = program.start.size, program.constraints
    x, p = ca.MX.sym("x", n), ca.MX.sym("p", 0)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", m)
    f, g, slope = ca.MX(0.0), ca.MX.zeros(m, 1), ca.MX.zeros(n, 1)
    jacobian, hessian = _Entries(m, n), _Entries(n, n)
    for element in program.elements:
        count = element.variables.shape[0]
        if count == 0:
            continue
        local = _differentiate(element.function, program.loss, curvature)
        v = _gather(x, element.variables)
        d = ca.MX(ca.DM(element.data))
        if local.has_residual:
            f += ca.sum2(local.loss.map(count)(v, d))
            slopes = local.slope.map(count)(v, d)
            slope += _sum_into(n, element.variables.ravel(), ca.vec(slopes))
        if element.rows.shape[1]:
            g += _sum_into(m, element.rows.ravel(), ca.vec(local.constraint.map(count)(v, d)))
            entries = ca.vec(local.jacobian.map(count)(v, d))
            jacobian.add(
                element.rows[:, local.jacobian_at[0]],
                element.variables[:, local.jacobian_at[1]],
                entries,
            )
        multipliers = (
            _gather(lam_g, element.rows) if element.rows.shape[1] else ca.MX.zeros(0, count)
        )
        entries = ca.vec(local.hessian.map(count)(v, d, ca.repmat(lam_f, 1, count), multipliers))
        one = element.variables[:, local.hessian_at[0]]
        two = element.variables[:, local.hessian_at[1]]
        hessian.add(np.minimum(one, two), np.maximum(one, two), entries)
    j, h = jacobian.matrix(), hessian.matrix()
    return Functions(
        problem={"x": x, "f": f, "g": g},
        gradient=_named("nlp_grad_f", {"x": x, "p": p}, {"f": f, "grad_f_x": slope}),
        jacobian=_named("nlp_jac_g", {"x": x, "p": p}, {"g": g, "jac_g_x": j}),
        both=_named(
            "nlp_jac_fg", {"x": x, "p": p}, {"f": f, "grad_f_x": slope, "g": g, "jac_g_x": j}
        ),
        hessian=_named(
            "nlp_hess_l",
            {"x": x, "p": p, "lam_f": lam_f, "lam_g": lam_g},
            {"triu_hess_gamma_x_x": h},
        ),
        full_hessian=_named(
            "nlp_hess_l",
            {"x": x, "p": p, "lam_f": lam_f, "lam_g": lam_g},
            {"hess_gamma_x_x": ca.triu2symm(h)},
        ),
    )


def _named(name: str, inputs: dict[str, Any], outputs: dict[str, Any]) -> ca.Function:
    return ca.Function(
        name, list(inputs.values()), list(outputs.values()), list(inputs), list(outputs)
    )


@final
@dataclass(frozen=True, eq=False)
class _Local:
    """One small function and its derivatives; matrices as columns of their non-zeros."""

    has_residual: bool
    loss: ca.Function
    slope: ca.Function
    constraint: ca.Function
    jacobian: ca.Function
    jacobian_at: tuple[IntArray, IntArray]
    hessian: ca.Function
    hessian_at: tuple[IntArray, IntArray]


def _differentiate(function: ca.Function, loss: Loss, curvature: Curvature) -> _Local:
    v, d = ca.SX.sym("v", function.numel_in(0)), ca.SX.sym("d", function.numel_in(1))
    residual, constraint = function(v, d)
    lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", constraint.numel())
    cost = 0.5 * ca.sum1(_each(residual, loss, _rho)) if residual.numel() else ca.SX(0.0)
    jacobian = ca.jacobian(constraint, v)
    if curvature == "exact":
        curved = lam_f * cost + ca.dot(lam_g, constraint)
        hessian = ca.triu(ca.hessian(curved, v)[0])
    elif residual.numel():
        inner = ca.jacobian(residual, v)
        weight = _each(residual, loss, _rho_slope)
        hessian = lam_f * ca.triu(ca.mtimes(inner.T, ca.mtimes(ca.diag(weight), inner)))
    else:
        hessian = ca.SX(v.numel(), v.numel())
    return _Local(
        has_residual=residual.numel() > 0,
        loss=ca.Function("po_loss", [v, d], [cost]),
        slope=ca.Function("po_slope", [v, d], [ca.densify(ca.gradient(cost, v))]),
        constraint=ca.Function("po_constraint", [v, d], [ca.densify(constraint)]),
        jacobian=ca.Function("po_jacobian", [v, d], [_nonzeros(jacobian)], {"cse": True}),
        jacobian_at=_places(jacobian.sparsity()),
        hessian=ca.Function(
            "po_hessian", [v, d, lam_f, lam_g], [_nonzeros(hessian)], {"cse": True}
        ),
        hessian_at=_places(hessian.sparsity()),
    )


def _each(residual: Any, loss: Loss, rule: Callable[[Any, Loss], Any]) -> Any:
    return ca.vertcat(*(rule(residual[i], loss) for i in range(residual.numel())))


def _rho(r: Any, loss: Loss) -> Any:
    z = (r / loss.scale) ** 2
    if loss.shape is Shape.SQUARE:
        return r**2
    if loss.shape is Shape.SOFT_L1:
        return loss.scale**2 * 2.0 * (ca.sqrt(1.0 + z) - 1.0)
    if loss.shape is Shape.HUBER:
        # max(z, 1) keeps the root regular in the branch that is not taken.
        far = 2.0 * ca.sqrt(ca.fmax(z, 1.0)) - 1.0
        return loss.scale**2 * ca.if_else(z <= 1.0, z, far)
    return loss.scale**2 * ca.log1p(z)


def _rho_slope(r: Any, loss: Loss) -> Any:
    z = (r / loss.scale) ** 2
    if loss.shape is Shape.SQUARE:
        return ca.SX(1.0)
    if loss.shape is Shape.SOFT_L1:
        return 1.0 / ca.sqrt(1.0 + z)
    if loss.shape is Shape.HUBER:
        return 1.0 / ca.sqrt(ca.fmax(z, 1.0))
    return 1.0 / (1.0 + z)


def _nonzeros(matrix: Any) -> Any:
    return ca.vertcat(*matrix.nonzeros()) if matrix.nnz() else ca.SX(0, 1)


def _places(sparsity: ca.Sparsity) -> tuple[IntArray, IntArray]:
    rows, columns = sparsity.get_triplet()
    return np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)


def _gather(column: ca.MX, index: IntArray) -> ca.MX:
    """(n, K) matrix whose columns are the copies' own entries."""
    return ca.reshape(column[index.ravel().tolist()], index.shape[1], index.shape[0])


def _sum_into(size: int, index: IntArray, entries: ca.MX) -> ca.MX:
    """Column in which entries with the same index are added."""
    return ca.mtimes(_adder(size, index), entries)


def _adder(size: int, index: IntArray) -> ca.DM:
    return ca.DM(
        ca.Sparsity.triplet(size, index.size, index.tolist(), list(range(index.size))), 1.0
    )


@final
class _Entries:
    """A sparse matrix as entries that are added where they coincide."""

    def __init__(self, rows: int, columns: int) -> None:
        self._shape = (rows, columns)
        self._rows: list[IntArray] = []
        self._columns: list[IntArray] = []
        self._values: list[ca.MX] = []

    def add(self, rows: IntArray, columns: IntArray, values: ca.MX) -> None:
        """Entries copy by copy."""
        self._rows.append(rows.ravel())
        self._columns.append(columns.ravel())
        self._values.append(values)

    def matrix(self) -> ca.MX:
        """The matrix, columns first, each place once."""
        if not self._values:
            return ca.MX(*self._shape)
        rows, columns = np.concatenate(self._rows), np.concatenate(self._columns)
        key = columns * self._shape[0] + rows
        places, which = np.unique(key, return_inverse=True)
        sparsity = ca.Sparsity.triplet(
            *self._shape, (places % self._shape[0]).tolist(), (places // self._shape[0]).tolist()
        )
        values = ca.mtimes(_adder(places.size, which.ravel()), ca.vertcat(*self._values))
        return ca.MX(sparsity, values)
