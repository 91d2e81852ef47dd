"""Operations of the loops in forms that a sub-step waits for less long.

Powers, exponentials and logarithms come from tables, and a division by what is known further out
is a product. Each differs from the usual form by some units of the last digit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import casadi as ca

from piezo_opt.simulation.instructions import Instruction


@final
@dataclass(frozen=True)
class _Power:
    """``exp(exponent * logarithm)``, by the numbers of both."""

    exponent: int
    logarithm: int


@final
class Quick:
    """The quick forms of one instruction list.

    Args:
        program: the list.
        level: the loop level at which each result is known.
        prefix: prefix of the variables made here.
        tables: whether a power comes from a table of its own exponent; else it is the exponential
            of a logarithm, which the tables of those two serve.
    """

    def __init__(
        self,
        program: Mapping[int, Instruction],
        level: Mapping[int, int],
        prefix: str,
        tables: bool = True,
    ) -> None:
        self._by_tables = tables
        self._program = program
        self._level = level
        self._prefix = prefix
        self._powers = {k: power for k in program if (power := self._power(k)) is not None}
        self._served = Counter(power.logarithm for power in self._powers.values())
        self._uses = Counter(i for one in program.values() for i in one.inputs)
        self._tables: dict[int, str] = {}
        self._inverses: dict[int, str] = {}
        self._hoisted: dict[int, list[tuple[int, str]]] = {}

    def hoisted(self, k: int) -> list[tuple[int, str]]:
        """Lines, each with its level, that an operation's text asks for beforehand."""
        return self._hoisted.get(k, [])

    def said(self, k: int, text: Mapping[int, str]) -> str | None:
        """The C text of an operation; None where the usual one serves as well."""
        one = self._program[k]
        if self._level[k] == 0:
            return None
        if k in self._powers and self._by_tables:
            power = self._powers[k]
            base = text[self._program[power.logarithm].inputs[0]]
            return f"po_power({base}, &{self._table(k, power.exponent, text)})"
        if one.op == ca.OP_EXP:
            return f"po_exp({text[one.inputs[0]]})"
        # A logarithm that is wanted for itself keeps its last digits near 1.
        if one.op == ca.OP_LOG and self._uses[k] == self._served[k]:
            return f"po_log({text[one.inputs[0]]})"
        if one.op == ca.OP_LOG1P and self._program[one.inputs[0]].op == ca.OP_EXP:
            return f"po_log(1.0 + {text[one.inputs[0]]})"
        if one.op == ca.OP_DIV and self._level[one.inputs[1]] < self._level[k]:
            return f"({text[one.inputs[0]]} * {self._inverse(k, one.inputs[1], text)})"
        return None

    def _power(self, k: int) -> _Power | None:
        """An exponential that is a power with an exponent known before the loops."""
        one = self._program[k]
        if one.op != ca.OP_EXP or self._program[one.inputs[0]].op != ca.OP_MUL:
            return None
        factors = self._program[one.inputs[0]].inputs
        for exponent, logarithm in (factors, factors[::-1]):
            if self._program[logarithm].op == ca.OP_LOG and self._level[exponent] == 0:
                return _Power(exponent, logarithm)
        return None

    def _table(self, k: int, exponent: int, text: Mapping[int, str]) -> str:
        if exponent not in self._tables:
            self._tables[exponent] = name = f"{self._prefix}{k}_t"
            line = f"const po_powers {name} = po_powers_of({text[exponent]});"
            self._hoisted[k] = [(0, line)]
        return self._tables[exponent]

    def _inverse(self, k: int, divisor: int, text: Mapping[int, str]) -> str:
        if divisor not in self._inverses:
            self._inverses[divisor] = name = f"{self._prefix}{k}_i"
            line = f"const double {name} = 1.0 / {text[divisor]};"
            self._hoisted[k] = [(self._level[divisor], line)]
        return self._inverses[divisor]
