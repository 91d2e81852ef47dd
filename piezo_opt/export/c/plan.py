"""What is written: the equations of a system as one graph, and the names of all that is in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, final

import casadi as ca
import numpy as np

from piezo_opt.assembly import System, assemble, folded
from piezo_opt.effects.base import Place
from piezo_opt.export.c import naming
from piezo_opt.export.c.graph import LEAF, NUMBER, Graph
from piezo_opt.export.c.slopes import Slopes, slopes
from piezo_opt.export.given import Given
from piezo_opt.simulation import Substeps
from piezo_opt.symbolic import one_at_a_time

_COSTLY: Final = """
pow exp log log1p expm1 sqrt sin cos tan asin acos atan sinh cosh tanh atan2 fmod hypot
"""
"""Operations that are worth a place of their own where only parameters decide them."""
_SIGNALS: Final = (
    "drive",
    "drive_rate",
    "",
    "free_displacement",
    "free_rate",
    "position",
    "velocity",
)


@final
@dataclass(frozen=True, eq=False)
class Plan:
    """The equations of a model, ready to be written.

    Attributes:
        given: model and values.
        system: assembled from it, with its values for what is declared fixed.
        prefix: of every symbol.
        substeps: how an interval is cut.
        graph: all expressions.
        rates: node of each state's rate.
        reading, start: nodes of the reading, and of the states at rest.
        jumps: nodes of the states after a sub-step; None where none jumps.
        names: names of the chain's signals, by node.
        derived: what only parameters decide and is costly: name and node.
        delay: node of the time by which the chain lags the command; None without a delay.
        corners: of the command that wait at most, in a chain with a delay.
        slopes: derivatives, where they are carried along.
    """

    given: Given
    system: System
    prefix: str
    substeps: Substeps
    graph: Graph
    rates: tuple[int, ...]
    reading: int
    start: tuple[int, ...]
    jumps: tuple[int, ...] | None
    names: Mapping[int, str]
    derived: Mapping[str, int]
    delay: int | None = None
    corners: int = 0
    slopes: Slopes | None = None

    @cached_property
    def parameters(self) -> list[naming.Field]:
        """Its parameters, in order."""
        return naming.parameters(self.system)

    @cached_property
    def states(self) -> list[naming.Field]:
        """Its states, in order."""
        return naming.states(self.system)

    @cached_property
    def channels(self) -> list[str]:
        """Its further inputs."""
        return naming.channels(self.system)

    @cached_property
    def flowing(self) -> list[naming.Field]:
        """States that have a rate; others only jump."""
        return [
            one for one in self.states
            if any(not self.graph.is_number(k, 0.0) for k in self.nodes(one, self.rates))
        ]  # fmt: skip

    @cached_property
    def input(self) -> str:
        """What the input is called: the drive itself, or a command that effects act on first."""
        return input_name(self.system)

    @cached_property
    def ends(self) -> list[int]:
        """Nodes of everything that is computed while time passes."""
        moved = self.slopes.nodes if self.slopes else ()
        return [*self.rates, self.reading, *(self.jumps or ()), *moved]

    @cached_property
    def timed(self) -> bool:
        """Whether anything follows the time itself."""
        return "time" in self.graph.leaves(self.ends)

    def nodes(self, one: naming.Field, of: Sequence[int]) -> Sequence[int]:
        """Those of the nodes that belong to a state."""
        return of[one.at : one.at + (one.size or 1)]


def input_name(system: System) -> str:
    """``command`` where effects act on it before it is the drive."""
    return "command" if system.model.at(Place.INPUT) else "drive"


def system_of(given: Given) -> System:
    """The system of what is exported; its values stand for what the model declares fixed."""
    constants = {name: given.values[name] for name in folded(given.model)}
    return assemble(given.model, constants)


@one_at_a_time
def plan(
    given: Given,
    system: System,
    prefix: str,
    substeps: Substeps,
    every: float,
    sensitivities: bool = False,
) -> Plan:
    """The equations of a system as a graph, with names for what a reader looks for.

    Args:
        given: model and values.
        system: assembled from it.
        prefix: of every symbol.
        substeps: how an interval is cut.
        every: interval between two calls [s], which decides how much of the past is kept.
        sensitivities: whether derivatives by the parameters are carried along.
    """
    u = input_name(system)
    own = naming.channels(system)
    sizes = (1, len(system.state_names), 1, 1, len(own), len(own), len(system.parameter_names))
    time, x, drive, slope, c, dc, p = (ca.SX.sym("v", n) for n in sizes)
    instant = [time, x, drive, slope, c, dc, p]
    leaves: list[list[str]] = [
        ["time"],
        [f"x->{name}" for field in naming.states(system) for name in field.elements],
        [u],
        [f"{u}_rate"],
        own,
        [f"{name}_rate" for name in own],
        [f"p->{field.name}" for field in naming.parameters(system)],
    ]
    still = ca.SX.zeros(x.numel())
    graph = Graph()

    def take(outputs: Sequence[Any]) -> list[list[int]]:
        return graph.take(instant, leaves, outputs)

    signals = system.signals(*instant)
    moving = [
        system.rate(*instant), system.reading(*instant), system.start(time, drive, c, p, still),
        system.becomes and system.becomes(time, x, drive, slope, c, p),
        system.delay and system.delay(p),
    ]  # fmt: skip
    found = iter(take([signals, *(one for one in moving if one is not None)]))
    named = next(found)
    rates, reading, start, jumps, late = (
        None if one is None else tuple(next(found)) for one in moving
    )
    assert rates is not None
    assert reading is not None
    assert start is not None
    corners = 0
    if system.delay is not None:
        numbers = [given.values[name] for name in system.parameter_names]
        # What is left of the oldest line, whole ones, and the one that is new.
        corners = int(np.ceil(float(system.delay(numbers)) / every)) + 2
    moved = slopes(graph, take, x, p, moving) if sensitivities else None
    names: dict[int, str] = {}
    for name, k in zip(_SIGNALS, named, strict=True):
        if name and graph.nodes[k].kind not in (LEAF, NUMBER):
            names.setdefault(k, name)
    ends = [*rates, *reading, *(jumps or ()), *(moved.nodes if moved else ())]
    needed = set(graph.below(ends))
    names = {k: name for k, name in names.items() if k in needed}
    return Plan(
        given, system, prefix, substeps, graph, rates, reading[0], start, jumps, names,
        _derived(graph, ends, given), late[0] if late else None, corners, moved,
    )  # fmt: skip


def _derived(graph: Graph, ends: Sequence[int], given: Given) -> dict[str, int]:
    """What only parameters decide and is costly, by the name of the effect that it belongs to."""
    order = graph.below(ends)
    costly_kinds = _COSTLY.split()
    alone: dict[int, bool] = {}
    costly: dict[int, bool] = {}
    for k in order:
        node = graph.nodes[k]
        alone[k] = all(alone[i] for i in node.inputs) and (
            node.kind != LEAF or node.name.startswith("p->")
        )
        costly[k] = node.kind in costly_kinds or any(costly[i] for i in node.inputs)
    top = {
        i for k in order if not alone[k] for i in graph.nodes[k].inputs if alone[i] and costly[i]
    } | {k for k in ends if alone[k] and costly[k]}
    found: dict[str, int] = {}
    for k in sorted(top):
        leaves = [leaf.removeprefix("p->") for leaf in graph.leaves([k])]
        owners = [e for e in given.model.names if any(leaf.startswith(f"{e}_") for leaf in leaves)]
        stem = owners[0] if len(owners) == 1 else "common"
        found[f"{stem}_constant_{1 + sum(n.startswith(f'{stem}_constant') for n in found)}"] = k
    return found
