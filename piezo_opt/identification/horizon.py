"""What multiple shooting and collocation share: start, priors, scaling, and the way to a solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol, cast, final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.errors import InputError, ModelError
from piezo_opt.identification.layout import Layout
from piezo_opt.identification.monitor import Monitor
from piezo_opt.identification.objective import Objective
from piezo_opt.identification.outcome import Ending
from piezo_opt.identification.problem import Identification
from piezo_opt.identification.program import Element, Program
from piezo_opt.identification.sampling import Chain, chains, state_sizes
from piezo_opt.identification.solvers.base import Solution
from piezo_opt.identification.unknowns import Unknowns
from piezo_opt.simulation import INITIAL
from piezo_opt.simulation.schedule import Segment
from piezo_opt.symbolic import kinks, smoothed

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

_UNIT = 1e-3
"""Size of the sum of squares in the program: that of this share of the stroke in every sample.

Larger, and the multipliers lose digits; smaller, and weak directions converge too early."""
_SNAP = 1e-6
"""Distance, in sizes of an unknown, within which an interior-point solution is on its bound."""


@final
@dataclass(frozen=True, eq=False)
class Solved:
    """Where a program's solver ended, how, and a sentence of why."""

    variables: FloatArray
    ending: Ending
    sentence: str


class ProgramSolver(Protocol):
    """Solves a nonlinear program."""

    @property
    def name(self) -> str:
        """Name in tables."""

    @property
    def stagewise(self) -> bool:
        """Whether it wants every stage to have its own copy of the unknowns."""

    def solve(self, program: Program, report: Callable[[FloatArray], None]) -> Solved:
        """From the program's start to a minimum; hands the unknowns of iterates to ``report``."""


@final
@dataclass(frozen=True, eq=False)
class Group:
    """Chains that share one small function: the same system and the same unknowns by local name.

    Attributes:
        system: the assembled model.
        locals: the unknowns' names within a record.
        chains: which chains.
    """

    system: System
    locals: tuple[str, ...]
    chains: tuple[int, ...]

    def numbers(self, theta: ca.SX, data: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Parameters and initial deviations from scaled unknowns and a chain's own numbers."""
        count, extra = len(self.system.parameter_names), len(self.system.state_names)
        names = (*self.system.parameter_names, *(INITIAL + n for n in self.system.state_names))
        places = [names.index(n) for n in self.locals]
        take = ca.DM(
            ca.Sparsity.triplet(len(names), len(places), places, list(range(len(places)))), 1.0
        )
        scale = data[count + extra :]
        everything = data[: count + extra] + ca.mtimes(take, theta * scale)
        return everything[:count], everything[count:]

    @property
    def size(self) -> int:
        """How many numbers of its own a chain has."""
        return len(self.system.parameter_names) + len(self.system.state_names) + len(self.locals)


@final
@dataclass(frozen=True, eq=False)
class Horizon:
    """A question cut into rows, with its sizes: what a transcription starts from.

    Attributes:
        objective: the same question by single shooting; judges every iterate.
        theta: SI start values.
        chains: the records, cut into sub-steps.
        sizes: (n,) size of each state.
        unit: size of a residual [m].
        groups: chains that share their small functions.
    """

    objective: Objective
    theta: FloatArray
    chains: tuple[Chain, ...]
    sizes: FloatArray
    unit: float
    groups: tuple[Group, ...]

    @staticmethod
    def of(objective: Objective, theta: FloatArray, from_record: bool = True) -> Horizon:
        """Cut a question at start values; the position is guessed from the records or not."""
        records = objective.question.campaign.records
        stroke = max(float(np.ptp(r.position)) for r in records) or 1.0
        parts = chains(objective, theta, from_record)
        sizes = state_sizes(parts, objective.simulators[0].system.state_units, stroke)
        found: dict[tuple[int, tuple[str, ...]], Group] = {}
        for number, part in enumerate(parts):
            system = objective.simulators[part.record].system
            columns = objective.unknowns.columns(part.record)
            names = tuple(objective.unknowns.members[k].local for k in columns)
            key = (id(system), names)
            group = found.get(key, Group(system, names, ()))
            found[key] = replace(group, chains=(*group.chains, number))
        unit = _UNIT * stroke * float(np.sqrt(objective.samples))
        return Horizon(objective, theta, parts, sizes, unit, tuple(found.values()))

    def own(self, number: int) -> FloatArray:
        """The numbers of a chain that :meth:`Group.numbers` reads: kept values, then sizes."""
        unknowns, record = self.objective.unknowns, self.chains[number].record
        system = self.objective.simulators[record].system
        kept = unknowns.of_record(record, np.zeros(self.theta.size))
        kept.update({unknowns.members[k].local: 0.0 for k in unknowns.columns(record)})
        return np.array(
            [kept[n] for n in system.parameter_names]
            + [kept.get(INITIAL + n, 0.0) for n in system.state_names]
            + [unknowns.members[k].scale for k in unknowns.columns(record)]
        )

    def seen(self, layout: Layout, number: int, stages: IntArray) -> IntArray:
        """Variables of the unknowns of a chain's record as seen from these stages."""
        columns = self.objective.unknowns.columns(self.chains[number].record)
        return layout.unknowns[np.ix_(stages, np.array(columns, dtype=np.intp))]

    def starts(self, layout: Layout) -> list[Element]:
        """The conditions on the first states of all chains."""
        found: list[Element] = []
        n = self.sizes.size
        if n == 0:
            return found
        for group in self.groups:
            system = group.system
            nc = len(system.channel_names)
            v, d = ca.SX.sym("v", n + len(group.locals)), ca.SX.sym("d", 2 + nc + group.size)
            p, deviation = group.numbers(v[n:], d[2 + nc :])
            at_rest = system.start(d[0], d[1], d[2 : 2 + nc], p, deviation)
            function = element(v, d, ca.SX(0, 1), v[:n] - at_rest / self.sizes)
            variables, rows, data = [], [], []
            for number in group.chains:
                if not self._from_rest(number):
                    continue
                first, segment = int(layout.first[number]), self.chains[number].segment
                seen = self.seen(layout, number, np.array([max(first - 1, 0)]))[0]
                variables.append(np.concatenate([layout.states[first], seen]))
                rows.append(layout.leads[first])
                data.append(
                    np.concatenate(
                        [
                            [segment.time[0], segment.drive[0]],
                            segment.channels[0], self.own(number),
                        ]
                    )
                )  # fmt: skip
            if variables:
                found.append(
                    Element(function, np.array(variables), np.array(rows), np.array(data).T)
                )
        return found

    def _from_rest(self, number: int) -> bool:
        """Whether a chain starts from rest (else: on the cycle that stands before it)."""
        part = self.chains[number]
        follows = number > 0 and self.chains[number - 1].closed
        return not part.closed and not follows

    def ties(self, layout: Layout) -> list[Element]:
        """The cycles closed, the records tied to their cycles, copies of unknowns handed on."""
        pairs: list[IntArray] = []
        rows: list[IntArray] = []
        for number, part in enumerate(self.chains):
            if part.closed:
                begin, end = int(layout.first[number]), int(layout.last[number])
                record = int(layout.first[number + 1])
                pairs += [
                    np.column_stack([layout.states[end], layout.states[begin]]),
                    np.column_stack([layout.states[record], layout.states[begin]]),
                ]
                rows += [layout.closing[number], layout.leads[record]]
        if layout.keeps.shape[1]:
            after, before = layout.unknowns[1:].ravel(), layout.unknowns[:-1].ravel()
            pairs.append(np.column_stack([after, before]))
            rows.append(layout.keeps.ravel())
        if not pairs:
            return []
        v, d = ca.SX.sym("v", 2), ca.SX.sym("d", 0)
        variables, filled = np.vstack(pairs), np.concatenate(rows)[:, None]
        data = np.zeros((0, variables.shape[0]))
        return [Element(element(v, d, ca.SX(0, 1), v[0] - v[1]), variables, filled, data)]

    def priors(self, layout: Layout) -> list[Element]:
        """One residual for each prior, weighed against the noise as in single shooting."""
        question, members = self.objective.question, self.objective.unknowns.members
        known = [(k, m.scale, m.prior) for k, m in enumerate(members) if m.prior is not None]
        if not known:
            return []
        noise = float(question.noise or 1.0) / self.unit
        v, d = ca.SX.sym("v", 1), ca.SX.sym("d", 2)
        function = element(v, d, d[0] * v - d[1], ca.SX(0, 1))
        variables = np.array([[layout.unknowns[0, k]] for k, _, _ in known])
        data = np.array([[noise * s / p.std, noise * p.mean / p.std] for _, s, p in known])
        return [Element(function, variables, np.zeros((len(known), 0), dtype=np.intp), data.T)]

    def program(
        self,
        layout: Layout,
        elements: list[Element],
        nodes: FloatArray,
        controls: FloatArray,
        smoothing: float,
    ) -> Program:
        """Everything together.

        Args:
            layout: numbers of variables and rows.
            elements: the transcription's own.
            nodes: (S, n) guess of the states.
            controls: (S, m) guess of the further variables.
            smoothing: width of rounded corners, as a share of each argument's largest size.
        """
        unknowns = self.objective.unknowns
        start = np.zeros(layout.variables)
        low, high = np.full(layout.variables, -np.inf), np.full(layout.variables, np.inf)
        start[layout.states] = nodes / self.sizes
        inside = layout.controls >= 0
        start[layout.controls[inside]] = controls[inside]
        start[layout.unknowns] = self.theta / unknowns.scale
        low[layout.unknowns[0]] = unknowns.low / unknowns.scale
        high[layout.unknowns[0]] = unknowns.high / unknowns.scale
        loss = self.objective.question.loss
        own = [_rounded(one, start, smoothing) for one in elements] if smoothing else elements
        return Program(
            elements=(*own, *self.starts(layout), *self.ties(layout), *self.priors(layout)),
            loss=replace(loss, scale=loss.scale / self.unit),
            start=start,
            low=low,
            high=high,
            constraints=layout.rows,
            unknowns=layout.unknowns[0],
            stages=layout.stages,
        )


def _rounded(one: Element, start: FloatArray, share: float) -> Element:
    """An element with its corners rounded by a share of what it meets at the start."""
    corners = kinks(one.function)
    if corners.numel_out(0) == 0:
        return one
    met = np.abs(np.array(corners.map(one.variables.shape[0])(start[one.variables].T, one.data)))
    return replace(one, function=smoothed(one.function, (share * met.max(axis=1)).tolist()))


def element(v: ca.SX, d: ca.SX, residual: ca.SX, constraint: ca.SX) -> ca.Function:
    return ca.Function("po_element", [v, d], [ca.densify(residual), ca.densify(constraint)])


def check_smoothing(share: float) -> None:
    """Refuse a width that makes no sense."""
    if not 0.0 <= share < 1.0:
        raise InputError(f"smoothing is {share}; give a share of at least 0 and below 1.")


def rows_of(segment: Segment) -> FloatArray:
    """What a sub-step needs to know, one row a quantity: h, t, u, u', channels, their slopes."""
    return np.vstack(
        [
            segment.length, segment.time, segment.drive, segment.slope,
            segment.channels.T, segment.channel_slopes.T,
        ]
    )  # fmt: skip


def identify_by_program(
    question: Identification,
    unknowns: Unknowns,
    start: FloatArray,
    solver: object,
    monitor: Monitor,
    transcribe: Callable[[Horizon, bool], Program],
) -> Solution:
    """Write the program at the start, solve it, and once more if its sub-steps were too coarse."""
    if not hasattr(solver, "solve"):
        raise ModelError(
            f"{type(solver).__name__} minimises residuals and cannot keep constraints: use it "
            "with transcription=SingleShooting(), or take solver=Ipopt()."
        )
    taken: ProgramSolver = cast(ProgramSolver, solver)
    theta = unknowns.clip(start)
    objective = Objective(question, unknowns, theta, monitor)
    scale = unknowns.scale

    def report(scaled: FloatArray) -> None:
        at = _snapped(unknowns, scaled * scale)
        # On the way the simulation of the whole record may run away; the program does not.
        with np.errstate(over="ignore", invalid="ignore"):
            residual = objective.residual(at)
            cost, rms = objective.cost(residual), objective.rms(residual)
        if np.isfinite(cost):
            monitor.saw(at, cost)
        monitor.iterate(at, rms if np.isfinite(rms) else float("inf"))

    solved = None
    for again in (False, True):
        # The second time the simulation is the better guess: it is all but the solution.
        program = transcribe(Horizon.of(objective, theta, not again), taken.stagewise)
        solved = taken.solve(program, report)
        theta = _snapped(unknowns, solved.variables[program.unknowns] * scale)
        if again or not objective.refine(theta):
            break
    assert solved is not None
    if solved.ending is not Ending.CONVERGED and monitor.best is not None:
        # Short of a solution the last iterate may be worse than an earlier one.
        theta = monitor.best
    return Solution(theta, solved.ending, solved.sentence, objective.accuracy)


def _snapped(unknowns: Unknowns, theta: FloatArray) -> FloatArray:
    """Onto a bound that an interior-point method has come as near to as it can."""
    near = _SNAP * unknowns.scale
    inside = np.where(theta - unknowns.low <= near, unknowns.low, theta)
    inside = np.where(unknowns.high - inside <= near, unknowns.high, inside)
    return unknowns.clip(inside)
