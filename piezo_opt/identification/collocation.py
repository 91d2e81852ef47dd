"""Collocation: the differential equation as constraints on polynomials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification.horizon import (
    Group,
    Horizon,
    check_smoothing,
    element,
    identify_by_program,
    rows_of,
)
from piezo_opt.identification.layout import Layout
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.program import Element, Program
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.solvers.nonlinear_program import Ipopt
from piezo_opt.identification.unknowns import Unknowns

FloatArray = NDArray[np.float64]


@final
@dataclass(frozen=True)
class Collocation:
    """States are polynomials over every sub-step and obey the equations at the collocation points.

        sum_j C_ji x_j = h f(t + tau_i h, x_i),   x(end) = sum_j D_j x_j

    The sub-steps are those of single shooting. The drive is a straight line within each, so none
    of its corners lies inside a polynomial.

    Args:
        degree: number of collocation points in a sub-step.
        scheme: ``"legendre"`` (order 2 degree) or ``"radau"`` (order 2 degree - 1, damps stiff
            components).
        smoothing: width within which corners of the equations are rounded, as in
            :class:`MultipleShooting`.

    References: Biegler (2010), Nonlinear Programming, SIAM, ch. 10; Hairer & Wanner (1996),
    Solving Ordinary Differential Equations II, IV.5.
    """

    degree: int = 3
    scheme: Literal["legendre", "radau"] = "legendre"
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        check_smoothing(self.smoothing)
        if not 1 <= self.degree <= 9:
            raise InputError(f"Collocation degree is {self.degree}; give 1 to 9 points.")
        if self.scheme not in ("legendre", "radau"):
            raise InputError(f"Collocation scheme is {self.scheme!r}; take 'legendre' or 'radau'.")

    @property
    def name(self) -> str:
        """Name in tables."""
        return "collocation"

    @property
    def default_solver(self) -> str:
        """Ipopt."""
        return Ipopt().name

    def identify(
        self,
        question: Identification,
        unknowns: Unknowns,
        start: FloatArray,
        solver: object | None,
        monitor: Monitor,
    ) -> Solution:
        """Estimate the unknowns from a start.

        Raises:
            ModelError: the model has states that jump, or an estimated delay.
        """
        chosen = Ipopt() if solver is None else solver
        return identify_by_program(question, unknowns, start, chosen, monitor, self.transcribe)

    def transcribe(self, horizon: Horizon, stagewise: bool) -> Program:
        """The nonlinear program of a question."""
        for group in horizon.groups:
            if group.system.becomes is not None:
                raise ModelError(
                    f"The model ({', '.join(group.system.model.names)}) has states that jump along "
                    "the drive and no differential equation to collocate; take "
                    "transcription=SingleShooting()."
                )
        n = horizon.sizes.size
        counts = [part.target.size for part in horizon.chains]
        layout = Layout.of(
            counts, [part.closed for part in horizon.chains], n, horizon.theta.size,
            self.degree * n, stagewise,
        )  # fmt: skip
        elements = []
        for group in horizon.groups:
            if n:
                elements.append(self._equations(horizon, group, layout))
            elements.append(_readings(horizon, group, layout))
        nodes = np.vstack([part.states for part in horizon.chains])
        tau = np.array(ca.collocation_points(self.degree, self.scheme))
        controls = []
        for part in horizon.chains:
            begin, end = part.states / horizon.sizes, np.roll(part.states / horizon.sizes, -1, 0)
            between = begin[:, None, :] + tau[None, :, None] * (end - begin)[:, None, :]
            controls.append(between.reshape(begin.shape[0], self.degree * n))
        return horizon.program(layout, elements, nodes, np.vstack(controls), self.smoothing)

    def _equations(self, horizon: Horizon, group: Group, layout: Layout) -> Element:
        """The polynomial of one sub-step."""
        system, n, k = group.system, horizon.sizes.size, len(group.locals)
        nc, degree = len(system.channel_names), self.degree
        width = 4 + 2 * nc
        tau = ca.collocation_points(degree, self.scheme)
        c_matrix, d_vector, _ = ca.collocation_coeff(tau)
        v, d = ca.SX.sym("v", (2 + degree) * n + k), ca.SX.sym("d", width + group.size)
        p, _ = group.numbers(v[n : n + k], d[width:])
        h, t, u, du, c, dc = d[0], d[1], d[2], d[3], d[4 : 4 + nc], d[4 + nc : width]
        inner = ca.reshape(v[n + k : n + k + degree * n], n, degree)
        points = ca.horzcat(v[:n], inner)
        slopes = ca.mtimes(points, ca.DM(c_matrix))
        equations = []
        for i in range(degree):
            at = tau[i] * h
            rate = system.rate(
                t + at, inner[:, i] * horizon.sizes, u + du * at, du, c + dc * at, dc, p
            )
            equations.append(slopes[:, i] - h * rate / horizon.sizes)
        gap = v[n + k + degree * n :] - ca.mtimes(points, ca.DM(d_vector))
        function = element(v, d, ca.SX(0, 1), ca.vertcat(gap, *equations))
        variables, filled, data = [], [], []
        for number in group.chains:
            stages = np.arange(layout.first[number], layout.last[number])
            variables.append(
                np.hstack(
                    [
                        layout.states[stages], horizon.seen(layout, number, stages),
                        layout.controls[stages], layout.states[stages + 1],
                    ]
                )
            )  # fmt: skip
            filled.append(np.hstack([layout.leads[stages + 1], layout.others[stages]]))
            own = np.tile(horizon.own(number)[:, None], (1, stages.size))
            data.append(np.vstack([rows_of(horizon.chains[number].segment), own]))
        return Element(function, np.vstack(variables), np.vstack(filled), np.hstack(data))


def _readings(horizon: Horizon, group: Group, layout: Layout) -> Element:
    """The residual at the end of each sub-step that is read."""
    system, n, k = group.system, horizon.sizes.size, len(group.locals)
    nc = len(system.channel_names)
    width = 6 + 2 * nc
    v, d = ca.SX.sym("v", n + k), ca.SX.sym("d", width + group.size)
    p, _ = group.numbers(v[n:], d[width:])
    h, t, u, du, c, dc = d[0], d[1], d[2], d[3], d[4 : 4 + nc], d[4 + nc : width - 2]
    y = system.reading(t + h, v[:n] * horizon.sizes, u + du * h, du, c + dc * h, dc, p)
    function = element(v, d, d[width - 1] * (y - d[width - 2]) / horizon.unit, ca.SX(0, 1))
    variables, data = [], []
    for number in group.chains:
        part = horizon.chains[number]
        read = np.flatnonzero(part.weight > 0)
        stages = layout.first[number] + read + 1
        variables.append(np.hstack([layout.states[stages], horizon.seen(layout, number, stages)]))
        columns = np.vstack([rows_of(part.segment), part.target, part.weight])[:, read]
        own = np.tile(horizon.own(number)[:, None], (1, read.size))
        data.append(np.vstack([columns, own]))
    empty = np.zeros((sum(v.shape[0] for v in variables), 0), dtype=np.intp)
    return Element(function, np.vstack(variables), empty, np.hstack(data))
