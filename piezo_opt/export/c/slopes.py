"""What moves how much with what: partial derivatives of a system's functions, in its graph."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, final

import casadi as ca

from piezo_opt.export.c.graph import Graph

Entry: TypeAlias = tuple[int, int, int]
"""Row, column, and the node of a derivative that is not zero throughout."""
Take: TypeAlias = Callable[[Sequence[Any]], list[list[int]]]


@final
@dataclass(frozen=True)
class Partial:
    """Derivatives of one function.

    Attributes:
        by_state: by each state.
        by_parameter: by each parameter, the states held.
    """

    by_state: tuple[Entry, ...] = ()
    by_parameter: tuple[Entry, ...] = ()

    @property
    def nodes(self) -> list[int]:
        """Nodes of all of them."""
        return [k for _, _, k in (*self.by_state, *self.by_parameter)]


@final
@dataclass(frozen=True)
class Slopes:
    """Derivatives of all that a sub-step, the start and the reading are made of.

    Attributes:
        rates: of each state's rate.
        reading: of the reading, a single row.
        start: of the states at rest, by parameters only.
        jumps: of the states after a sub-step; empty where none jumps.
        delay: of the delay, a single row, by parameters only.
    """

    rates: Partial
    reading: Partial
    start: Partial
    jumps: Partial
    delay: Partial

    def __iter__(self) -> Iterator[Partial]:
        return iter((self.rates, self.reading, self.start, self.jumps, self.delay))

    @property
    def nodes(self) -> list[int]:
        """Nodes that are computed while time passes."""
        return [k for one in (self.rates, self.reading, self.jumps, self.delay) for k in one.nodes]


def slopes(graph: Graph, take: Take, x: Any, p: Any, outputs: Sequence[Any]) -> Slopes:
    """Differentiate the functions of a system.

    Args:
        graph: takes the derivatives.
        take: puts expressions of the system's symbols into the graph.
        x, p: symbols of states and parameters.
        outputs: rates, reading, states at rest, states after a sub-step and delay; None where the
            system has no such function.
    """
    found = []
    for out in outputs:
        if out is None:
            found.append(Partial())
            continue
        columns = ca.SX(out)
        found.append(Partial(*(_entries(graph, take, columns, by) for by in (x, p))))
    return Slopes(*found)


def _entries(graph: Graph, take: Take, out: Any, by: Any) -> tuple[Entry, ...]:
    """Derivatives that are not zero throughout."""
    rows, columns = out.numel(), by.numel()
    if not rows * columns:
        return ()
    (nodes,) = take([ca.densify(ca.jacobian(out, by))])
    # Columns stand one behind the other.
    return tuple(
        (row, column, nodes[column * rows + row])
        for row in range(rows) for column in range(columns)
        if not graph.is_number(nodes[column * rows + row], 0.0)
    )  # fmt: skip
