"""Multiple shooting: short simulations, tied together by constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.errors import InputError
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
from piezo_opt.simulation.scheme import scheme

FloatArray = NDArray[np.float64]

_SAMPLES: Final = 1
"""Samples in a stretch unless told otherwise.

From starts with the resonance wrong by 0.4 to 4, one sample a stretch reached the optimum every
time and in the fewest iterations; 4 and 8 ended elsewhere or ran out of iterations in some. The
program is larger, but so sparse that an iteration costs less.
"""
_STAGEWISE: Final = 8
"""The same for a solver whose set-up grows with the square of the number of stretches."""
_LONGEST: Final = 100


@final
@dataclass(frozen=True)
class MultipleShooting:
    """Cut each record into short stretches with free states at their beginnings.

        x_{j+1} = F(x_j, theta)   for every stretch j

    The same sub-steps as single shooting, so the same optimum. The states follow the record while
    the unknowns are still wrong, which helps where a long simulation diverges.

    Args:
        samples_per_node: mean number of samples in a stretch; None takes 1, the most robust, or
            8 for a solver that goes stage by stage.
        smoothing: width within which corners of the equations (an absolute value, a sign) are
            rounded, as a share of what the argument reaches at the start values. 0 is exact; a
            little (1e-3) helps a solver over corners and moves the optimum by as little.

    References: Bock (1983), Recent Advances in Parameter Identification Techniques for O.D.E.,
    in Numerical Treatment of Inverse Problems, Birkhaeuser, 95-121.
    """

    samples_per_node: int | None = None
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        check_smoothing(self.smoothing)
        if self.samples_per_node is not None and not 1 <= self.samples_per_node <= _LONGEST:
            raise InputError(
                f"samples_per_node is {self.samples_per_node}; give 1 to {_LONGEST} (the steps of "
                "a stretch are written out one by one), or take SingleShooting()."
            )

    @property
    def name(self) -> str:
        """Name in tables."""
        return "multiple_shooting"

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
        """Estimate the unknowns from a start."""
        chosen = Ipopt() if solver is None else solver
        return identify_by_program(question, unknowns, start, chosen, monitor, self.transcribe)

    def transcribe(self, horizon: Horizon, stagewise: bool) -> Program:
        """The nonlinear program of a question."""
        rows = sum(part.target.size for part in horizon.chains)
        read = sum(int((part.weight > 0).sum()) for part in horizon.chains)
        samples = _SAMPLES if self.samples_per_node is None else self.samples_per_node
        if stagewise and self.samples_per_node is None:
            samples = _STAGEWISE
        length = max(1, round(samples * rows / max(read, 1)))
        counts = [-(-part.target.size // length) for part in horizon.chains]
        layout = Layout.of(
            counts, [part.closed for part in horizon.chains], horizon.sizes.size,
            horizon.theta.size, 0, stagewise,
        )  # fmt: skip
        elements = [self._stretches(horizon, group, layout, length) for group in horizon.groups]
        nodes = np.vstack(
            [
                part.states[np.minimum(np.arange(count + 1) * length, part.target.size)]
                for part, count in zip(horizon.chains, counts, strict=True)
            ]
        )
        nothing = np.zeros((nodes.shape[0], 0))
        return horizon.program(layout, elements, nodes, nothing, self.smoothing)

    def _stretches(self, horizon: Horizon, group: Group, layout: Layout, length: int) -> Element:
        """The steps of one stretch, and its readings."""
        system, n, k = group.system, horizon.sizes.size, len(group.locals)
        nc = len(system.channel_names)
        width = 6 + 2 * nc
        made = scheme(system)
        v = ca.SX.sym("v", 2 * n + k)
        d = ca.SX.sym("d", length * width + group.size)
        p, _ = group.numbers(v[n : n + k], d[length * width :])
        x, none, residuals = v[:n] * horizon.sizes, ca.SX(0, 1), []
        for i in range(length):
            row = d[i * width : (i + 1) * width]
            h, t, u, du, c, dc = row[0], row[1], row[2], row[3], row[4 : 4 + nc], row[4 + nc : -2]
            still = ca.SX.zeros(nc, 1)
            x, _ = made.step(p, h, du, dc, 0, t, x, none, u, c, 0, 0, still)
            y, _ = made.reading(
                p, h, du, dc, 0, t + h, x, none, u + du * h, c + dc * h, 0, 0, still
            )
            residuals.append(row[width - 1] * (y - row[width - 2]) / horizon.unit)
        gap = v[n + k :] - x / horizon.sizes if n else ca.SX(0, 1)
        function = element(v, d, ca.vertcat(*residuals), gap)
        variables, filled, data = [], [], []
        for number in group.chains:
            part = horizon.chains[number]
            stages = np.arange(layout.first[number], layout.last[number])
            variables.append(
                np.hstack(
                    [
                        layout.states[stages], horizon.seen(layout, number, stages),
                        layout.states[stages + 1],
                    ]
                )
            )  # fmt: skip
            filled.append(layout.leads[stages + 1])
            columns = np.vstack([rows_of(part.segment), part.target, part.weight])
            missing = stages.size * length - part.target.size
            # The last stretch is filled up with steps of no length that are not read.
            fill = np.repeat(columns[:, -1:], missing, axis=1)
            fill[[0, -1]] = 0.0
            whole = np.hstack([columns, fill]).T.reshape(stages.size, length * width)
            own = np.tile(horizon.own(number), (stages.size, 1))
            data.append(np.hstack([whole, own]))
        return Element(function, np.vstack(variables), np.vstack(filled), np.vstack(data).T)
