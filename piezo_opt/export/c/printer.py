"""C text of a graph: as few parentheses as C needs, and a name for what is needed twice."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from piezo_opt.export.c.graph import CHOICE, LEAF, NUMBER, TRUTHS, Graph, Node

WIDTH: Final = 100
"""Columns of a line."""
_BINDING: Final = {
    "||": 1,
    "&&": 2,
    "==": 3,
    "!=": 3,
    "<": 4,
    "<=": 4,
    "+": 5,
    "-": 5,
    "*": 6,
    "/": 6,
}
_TIGHT, _PREFIX, _LOOSE = 9, 7, 0
HELPERS: Final = ("sign", "smaller", "larger")
"""Functions that the C library lacks, or has with rules for what is not a number."""
_WORDS: Final = {
    "+": "sum", "-": "difference", "*": "product", "/": "ratio", CHOICE: "choice", "fabs": "size",
    "negative": "opposite", "&&": "both", "||": "any", "!": "not", "<": "below", "<=": "within",
    "==": "same", "!=": "other",
}  # fmt: skip


@final
@dataclass(frozen=True)
class Precision:
    """How numbers are written: ``double``, or ``float`` and nothing wider."""

    name: str

    @property
    def is_float(self) -> bool:
        """Whether numbers have four bytes."""
        return self.name == "float"

    def number(self, value: float) -> str:
        """A literal of this type: the shortest that reads back as the same number."""
        if not np.isfinite(value):
            return {"inf": "INFINITY", "-inf": "-INFINITY"}.get(repr(value), "NAN")
        if not self.is_float:
            return repr(float(value))
        limits = np.finfo(np.float32)
        size = abs(value)
        if size > 0.0:
            # What a float cannot hold becomes the nearest that it can, never zero or infinite.
            size = min(max(size, float(limits.tiny)), float(limits.max))
        text = str(np.float32(np.copysign(size, value)))
        return f"{text}{'' if '.' in text or 'e' in text else '.0'}f"

    def call(self, function: str) -> str:
        """The name of a function of the C library for this type."""
        return f"{function}f" if self.is_float else function


DOUBLE: Final = Precision("double")
FLOAT: Final = Precision("float")


@final
class Printer:
    """Writes results of one graph as the statements of one C function.

    Args:
        graph: what is written.
        precision: type of the numbers.
        prefix: of the helper functions.
        names: names that nodes shall have, by node.
        effects: name of each effect, to call what belongs to one of them after it.
    """

    def __init__(
        self,
        graph: Graph,
        precision: Precision,
        prefix: str,
        names: Mapping[int, str],
        effects: Sequence[str],
    ) -> None:
        self.graph = graph
        self.precision = precision
        self.called: set[str] = set()
        self._prefix = prefix
        self._names = names
        self._effects = effects

    def statements(
        self, results: Sequence[tuple[str, int]], known: Mapping[int, str] | None = None
    ) -> list[str]:
        """Statements that give each result its value: named locals first where they are needed.

        Args:
            results: what stands left of ``=``, and its node.
            known: nodes that have a name already, outside of these statements.
        """
        uses = self.graph.uses([k for _, k in results])
        text = {k: (name, _TIGHT) for k, name in (known or {}).items()}
        taken = {name for name, _ in text.values()}
        lines: list[str] = []
        for left, end in results:
            for k in self._unwritten(end, text):
                node = self.graph.nodes[k]
                text[k] = self._said(node, text)
                if k in self._names or (uses[k] > 1 and not self._plain(node)):
                    name = self._local(k, taken)
                    taken.add(name)
                    kind = "int" if node.kind in TRUTHS else self.precision.name
                    lines += wrapped(f"const {kind} {name} = {text[k][0]};")
                    text[k] = (name, _TIGHT)
            lines += wrapped(f"{left} {self.number(end, text)};")
        return lines

    def _unwritten(self, end: int, text: Mapping[int, tuple[str, int]]) -> list[int]:
        """Nodes that an end needs and that have no text yet, operands first."""
        seen: set[int] = set()
        waiting = [end]
        while waiting:
            k = waiting.pop()
            if k not in seen and k not in text:
                seen.add(k)
                waiting += self.graph.nodes[k].inputs
        return sorted(seen)

    def number(self, k: int, text: Mapping[int, tuple[str, int]]) -> str:
        """A node's text as a number, also where it is true or false."""
        said, _ = text[k]
        if self.graph.nodes[k].kind in TRUTHS:
            one, zero = self.precision.number(1.0), self.precision.number(0.0)
            return f"{said} ? {one} : {zero}"
        return said

    def _plain(self, node: Node) -> bool:
        """Whether a node is as short as its name would be."""
        if node.kind in (LEAF, NUMBER):
            return True
        return node.kind == "negative" and self.graph.nodes[node.inputs[0]].kind in (LEAF, NUMBER)

    def _local(self, k: int, taken: set[str]) -> str:
        node = self.graph.nodes[k]
        own = self._names.get(k)
        if own is None:
            parts = [self.graph.nodes[i] for i in node.inputs]
            if node.kind == "fabs" and (parts[0].kind == LEAF or node.inputs[0] in self._names):
                own = f"abs_{_short(self._names.get(node.inputs[0], parts[0].name))}"
            else:
                leaves = [_short(leaf) for leaf in self.graph.leaves([k])]
                owners = {e for e in self._effects for leaf in leaves if leaf.startswith(f"{e}_")}
                word = _WORDS.get(node.kind, node.kind)
                own = f"{owners.pop()}_{word}" if len(owners) == 1 else f"common_{word}"
        name, count = own, 1
        while name in taken:
            count += 1
            name = f"{own}_{count}"
        return name

    def _said(self, node: Node, text: Mapping[int, tuple[str, int]]) -> tuple[str, int]:
        """C text of a node and how tightly it binds."""
        if node.kind == LEAF:
            return node.name, _TIGHT
        if node.kind == NUMBER:
            said = self.precision.number(node.value)
            return said, (_PREFIX if said.startswith("-") else _TIGHT)
        if node.kind == CHOICE:
            condition = self._truth(node.inputs[0], text)
            then, otherwise = (self._operand(i, text, _LOOSE + 1) for i in node.inputs[1:])
            return f"({condition} ? {then} : {otherwise})", _TIGHT
        if node.kind == "!":
            return f"!{self._truth(node.inputs[0], text)}", _PREFIX
        if node.kind in ("&&", "||"):
            a, b = (self._truth(i, text) for i in node.inputs)
            return f"{a} {node.kind} {b}", _BINDING[node.kind]
        if node.kind == "negative":
            return f"-{self._operand(node.inputs[0], text, _PREFIX + 1)}", _PREFIX
        binding = _BINDING.get(node.kind)
        if binding is not None:
            left = self._operand(node.inputs[0], text, binding)
            right = self._operand(node.inputs[1], text, binding + 1)
            return f"{left} {node.kind} {right}", binding
        arguments = ", ".join(self._operand(i, text, _LOOSE) for i in node.inputs)
        self.called.add(node.kind)
        own = node.kind in HELPERS
        function = f"{self._prefix}_{node.kind}" if own else self.precision.call(node.kind)
        return f"{function}({arguments})", _TIGHT

    def _operand(self, k: int, text: Mapping[int, tuple[str, int]], least: int) -> str:
        """A number as an operand of something that binds at least so tightly."""
        said, binding = text[k]
        if self.graph.nodes[k].kind in TRUTHS:
            return f"({self.number(k, text)})"
        return said if binding >= least else f"({said})"

    def _truth(self, k: int, text: Mapping[int, tuple[str, int]]) -> str:
        said, binding = text[k]
        if self.graph.nodes[k].kind not in TRUTHS:
            said, binding = f"{self._operand(k, text, 4)} != {self.precision.number(0.0)}", 3
        return said if binding >= _TIGHT else f"({said})"


def _short(name: str) -> str:
    """A leaf's name without the struct that holds it, and without brackets."""
    return re.sub(r"\W+", "_", name.rpartition("->")[2]).strip("_")


def wrapped(line: str, width: int = WIDTH - 4) -> list[str]:
    """A statement cut at spaces before operators, so that every line fits."""
    lines: list[str] = []
    while len(line) > width:
        at = max(
            (
                m.start()
                for m in re.finditer(r" (?=[-+*/?:] |&& |\|\| )|(?<=,) ", line[:width])
                if m.start() > 8
            ),
            default=-1,
        )
        if at < 0:
            break
        lines.append(line[:at])
        line = f"    {line[at + 1 :]}"
    return [*lines, line]
