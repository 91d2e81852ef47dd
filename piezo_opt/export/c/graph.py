"""Symbolic expressions as a graph in which what is equal is one node.

CasADi's symbols know their operands, not their users. To write a reader's C the users count: a
node that several results need gets a name, one that a single result needs is written where it
stands.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import casadi as ca

from piezo_opt.errors import ModelError

LEAF: Final = "leaf"
NUMBER: Final = "number"
CHOICE: Final = "choice"
TRUTHS: Final = ("<", "<=", "==", "!=", "&&", "||", "!")
"""Operations whose result is true or false and not a number."""

_BINARY: Final[Mapping[int, str]] = {
    ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/", ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow", ca.OP_FMIN: "smaller", ca.OP_FMAX: "larger", ca.OP_LT: "<",
    ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!=", ca.OP_AND: "&&", ca.OP_OR: "||",
    ca.OP_ATAN2: "atan2", ca.OP_FMOD: "fmod", ca.OP_COPYSIGN: "copysign", ca.OP_HYPOT: "hypot",
}  # fmt: skip
_UNARY: Final[Mapping[int, str]] = {
    ca.OP_NEG: "negative", ca.OP_SQRT: "sqrt", ca.OP_EXP: "exp", ca.OP_LOG: "log",
    ca.OP_LOG1P: "log1p", ca.OP_EXPM1: "expm1", ca.OP_SIN: "sin", ca.OP_COS: "cos",
    ca.OP_TAN: "tan", ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan",
    ca.OP_SINH: "sinh", ca.OP_COSH: "cosh", ca.OP_TANH: "tanh", ca.OP_FABS: "fabs",
    ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil", ca.OP_NOT: "!", ca.OP_SIGN: "sign",
}  # fmt: skip


@final
@dataclass(frozen=True)
class Node:
    """One operation, leaf or number.

    Attributes:
        kind: the operation, ``LEAF`` or ``NUMBER``.
        inputs: numbers of its operands in the graph.
        name: of a leaf, as it stands in C.
        value: of a number.
    """

    kind: str
    inputs: tuple[int, ...] = ()
    name: str = ""
    value: float = 0.0


@final
class Graph:
    """Nodes by number, each after its operands; equal ones are the same."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._numbers: dict[Node, int] = {}

    def add(self, node: Node) -> int:
        """The number of a node, which is new or was there."""
        found = self._numbers.get(node)
        if found is None:
            found = self._numbers[node] = len(self.nodes)
            self.nodes.append(node)
        return found

    def number(self, value: float) -> int:
        """The node of a number."""
        return self.add(Node(NUMBER, value=value))

    def take(
        self, inputs: Sequence[Any], names: Sequence[Sequence[str]], outputs: Sequence[Any]
    ) -> list[list[int]]:
        """Put expressions into the graph.

        Args:
            inputs: columns of symbols.
            names: for each of them the name of each element in C.
            outputs: columns of expressions of these symbols.

        Returns:
            for each output the node of each element.

        Raises:
            ModelError: an operation that C cannot say.
        """
        dense = [ca.densify(ca.SX(out)) for out in outputs]
        function = ca.Function("po_written", list(inputs), dense)
        held: dict[int, int] = {}
        found = [[-1] * out.numel() for out in dense]
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            read, write = function.instruction_input(k), function.instruction_output(k)
            if operation == ca.OP_OUTPUT:
                found[write[0]][write[1]] = held[read[0]]
            elif operation == ca.OP_INPUT:
                held[write[0]] = self.add(Node(LEAF, name=names[read[0]][read[1]]))
            elif operation == ca.OP_CONST:
                held[write[0]] = self.number(float(function.instruction_constant(k)))
            else:
                held[write[0]] = self._operation(operation, [held[i] for i in read])
        return found

    def _operation(self, operation: int, operands: list[int]) -> int:
        first = operands[0]
        if operation == ca.OP_ASSIGN:
            return first
        if operation == ca.OP_SQ:
            return self.add(Node("*", (first, first)))
        if operation == ca.OP_TWICE:
            return self.add(Node("*", (self.number(2.0), first)))
        if operation == ca.OP_INV:
            return self.add(Node("/", (self.number(1.0), first)))
        if operation == ca.OP_IF_ELSE_ZERO:
            return self.add(Node(CHOICE, (first, operands[1], self.number(0.0))))
        if operation == ca.OP_ADD and (both := self._either(*operands)) is not None:
            return both
        if operation == ca.OP_SUB and self.nodes[operands[1]].kind == "+":
            # a - (b + c) as a - b - c: a product and a sum become one instruction each.
            b, c = self.nodes[operands[1]].inputs
            return self.add(Node("-", (self.add(Node("-", (first, b))), c)))
        kind = _BINARY.get(operation) or _UNARY.get(operation)
        if kind is None:
            raise ModelError(
                f"The model holds the operation {operation} of the symbolic engine, which the C "
                "writer cannot say: write the effect with the functions of piezo_opt.symbolic."
            )
        return self.add(Node(kind, tuple(operands)))

    def _either(self, left: int, right: int) -> int | None:
        """``(c ? a : 0) + (!c ? b : 0)`` as ``c ? a : b``."""
        one, other = self.nodes[left], self.nodes[right]
        zero = self.number(0.0)
        if not (one.kind == other.kind == CHOICE and one.inputs[2] == other.inputs[2] == zero):
            return None
        opposite = self.nodes[other.inputs[0]]
        if opposite.kind != "!" or opposite.inputs[0] != one.inputs[0]:
            return None
        return self.add(Node(CHOICE, (one.inputs[0], one.inputs[1], other.inputs[1])))

    def is_number(self, k: int, value: float) -> bool:
        """Whether a node is this number."""
        return self.nodes[k].kind == NUMBER and self.nodes[k].value == value

    def below(self, ends: Sequence[int]) -> list[int]:
        """Nodes that these follow from and themselves, operands first."""
        seen: set[int] = set()
        waiting = list(ends)
        while waiting:
            k = waiting.pop()
            if k not in seen:
                seen.add(k)
                waiting += self.nodes[k].inputs
        return sorted(seen)

    def leaves(self, ends: Sequence[int]) -> Iterator[str]:
        """Names of the leaves that these follow from."""
        return (self.nodes[k].name for k in self.below(ends) if self.nodes[k].kind == LEAF)

    def uses(self, ends: Sequence[int]) -> Counter[int]:
        """How often each node is read: by others that these follow from, and as one of these."""
        return Counter([*ends, *(i for k in self.below(ends) for i in self.nodes[k].inputs)])
