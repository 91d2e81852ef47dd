"""Derivatives of straight-line expressions along several directions at once, written as C.

Forward differentiation of the instruction list: the tangent of a result is the sum of its partial
derivatives times the tangents of its operands. Every direction does the same, so the tangents of
up to four directions share one vector register (GCC's vector extension, which Clang has as well;
a processor without such registers is given the same text). What is zero in all four is not
written.

Source: Griewank & Walther (2008), Evaluating Derivatives, 2nd ed., ch. 3 (vector forward mode).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

import casadi as ca

_LANES: Final = 4
_SAME: Final = ""
_MINUS: Final = "-"

_SLOPES: Final[dict[int, tuple[str | None, ...]]] = {
    ca.OP_ADD: (_SAME, _SAME),
    ca.OP_SUB: (_SAME, _MINUS),
    ca.OP_MUL: ("{b}", "{a}"),
    ca.OP_DIV: ("(1.0 / {b})", "(-{f} * {s})"),
    ca.OP_POW: ("({b} * pow({a}, {b} - 1.0))", "(log({a}) * {f})"),
    ca.OP_CONSTPOW: ("({b} * pow({a}, {b} - 1.0))", None),
    ca.OP_FMIN: ("(0.5 * (({a} <= {b}) + ({a} < {b})))", "(1.0 - {s})"),
    ca.OP_FMAX: ("(0.5 * (({a} >= {b}) + ({a} > {b})))", "(1.0 - {s})"),
    ca.OP_IF_ELSE_ZERO: (None, "(double)({a} != 0.0)"),
    ca.OP_ATAN2: ("({b} / ({a} * {a} + {b} * {b}))", "(-{a} / ({a} * {a} + {b} * {b}))"),
    ca.OP_FMOD: (_SAME, "(({f} - {a}) / {b})"),
    ca.OP_REMAINDER: (_SAME, "(({f} - {a}) / {b})"),
    ca.OP_COPYSIGN: ("((({a} > 0.0) - ({a} < 0.0)) * copysign(1.0, {b}))", None),
    ca.OP_HYPOT: ("({a} / {f})", "({b} / {f})"),
    ca.OP_ASSIGN: (_SAME,),
    ca.OP_NEG: (_MINUS,),
    ca.OP_SQ: ("({a} + {a})",),
    ca.OP_TWICE: ("2.0",),
    ca.OP_INV: ("(-{f} * {f})",),
    ca.OP_SQRT: ("(0.5 / {f})",),
    ca.OP_EXP: ("{f}",),
    ca.OP_LOG: ("(1.0 / {a})",),
    ca.OP_LOG1P: ("(1.0 / (1.0 + {a}))",),
    ca.OP_EXPM1: ("exp({a})",),
    ca.OP_SIN: ("cos({a})",),
    ca.OP_COS: ("(-sin({a}))",),
    ca.OP_TAN: ("(1.0 + {f} * {f})",),
    ca.OP_ASIN: ("(1.0 / sqrt(1.0 - {a} * {a}))",),
    ca.OP_ACOS: ("(-1.0 / sqrt(1.0 - {a} * {a}))",),
    ca.OP_ATAN: ("(1.0 / (1.0 + {a} * {a}))",),
    ca.OP_SINH: ("cosh({a})",),
    ca.OP_COSH: ("sinh({a})",),
    ca.OP_TANH: ("(1.0 - {f} * {f})",),
    ca.OP_ASINH: ("(1.0 / sqrt(1.0 + {a} * {a}))",),
    ca.OP_ACOSH: ("(1.0 / (sqrt({a} - 1.0) * sqrt({a} + 1.0)))",),
    ca.OP_ATANH: ("(1.0 / (1.0 - {a} * {a}))",),
    ca.OP_ERF: ("(1.1283791670955126 * exp(-{a} * {a}))",),
    ca.OP_FABS: ("(double)(({a} > 0.0) - ({a} < 0.0))",),
}
"""Partial derivatives by each operand, None where it is zero: of operands a and b, result f, and
the first partial derivative s.

Steps (comparisons, signs, rounding) are not named: their derivative is zero."""

_BARE: Final = ("{a}", "{b}", "{f}", "2.0")
"""Those that need no name of their own."""


@final
@dataclass(frozen=True)
class Carried:
    """A C expression and the loop level at which it is known."""

    text: str
    level: int


@final
@dataclass(frozen=True)
class Lanes:
    """Directions in groups that share a register.

    Attributes:
        groups: indices of the directions of each group, one to four.
    """

    groups: tuple[tuple[int, ...], ...]

    @staticmethod
    def of(patterns: Sequence[tuple[bool, ...]]) -> Lanes:
        """Groups in which directions that move the same states stand together."""
        order = sorted(range(len(patterns)), key=lambda k: (patterns[k], k))
        return Lanes(tuple(tuple(order[i : i + _LANES]) for i in range(0, len(order), _LANES)))

    def kind(self, group: int) -> str:
        """C type of a group's tangents."""
        return {1: "double", 2: "po_v2"}.get(len(self.groups[group]), "po_v4")

    def literal(self, group: int, entries: Sequence[str]) -> str:
        """A tangent from its entries, one a direction of the group."""
        kind = self.kind(group)
        # C fills up with zeros.
        return entries[0] if kind == "double" else f"(({kind}){{{', '.join(entries)}}})"

    def entry(self, group: int, text: str, lane: int) -> str:
        """One direction's entry of a tangent."""
        return text if self.kind(group) == "double" else f"{text}[{lane}]"


TYPES: Final = """\
typedef double po_v2 __attribute__((vector_size(16)));
typedef double po_v4 __attribute__((vector_size(32)));
"""


@final
class Tangents:
    """The tangents of one instruction list, asked for in its order.

    Args:
        lanes: the directions.
        seeds: for an input and its element the tangent of each group, None where it is zero.
        prefix: prefix of the variables made here.
    """

    def __init__(
        self,
        lanes: Lanes,
        seeds: Mapping[tuple[int, int], Sequence[Carried | None]],
        prefix: str,
    ) -> None:
        self.lanes = lanes
        self._seeds = seeds
        self._prefix = prefix
        self._known: dict[int, tuple[Carried | None, ...]] = {}

    def __getitem__(self, number: int) -> tuple[Carried | None, ...]:
        return self._known[number]

    def of_input(self, number: int, place: tuple[int, int]) -> None:
        """Note an input of the function."""
        nothing = (None,) * len(self.lanes.groups)
        self._known[number] = tuple(self._seeds.get(place, nothing))

    def of_constant(self, number: int) -> None:
        """Note a constant."""
        self._known[number] = (None,) * len(self.lanes.groups)

    def of_operation(
        self, number: int, operation: int, inputs: Sequence[int], values: Sequence[Carried],
        result: Carried,
    ) -> list[tuple[int, str]]:  # fmt: skip
        """Lines, each with its loop level, for the tangents of an operation.

        Args:
            number: of the operation, which is that of its result.
            operation: which one.
            inputs: numbers of its operands.
            values: the operands.
            result: the result.
        """
        slopes = _Slopes(_SLOPES.get(operation, ()), values, result, f"{self._prefix}{number}")
        lines: list[tuple[int, str]] = []
        known: list[Carried | None] = []
        for group in range(len(self.lanes.groups)):
            own = [self._known[i][group] for i in inputs]
            terms = [
                (slope, tangent)
                for tangent, slope in zip(own, slopes.patterns, strict=False)
                if slope is not None and tangent is not None
            ]
            if not terms:
                known.append(None)
            elif len(terms) == 1 and terms[0][0] == _SAME:
                known.append(terms[0][1])
            else:
                name = f"{self._prefix}{number}_{group}"
                factors = [(slopes.of(slope), tangent) for slope, tangent in terms]
                said = " + ".join(f"{by.text}{tangent.text}" for by, tangent in factors)
                level = max(max(by.level, tangent.level) for by, tangent in factors)
                lines.append((level, f"const {self.lanes.kind(group)} {name} = {said};"))
                known.append(Carried(name, level))
        self._known[number] = tuple(known)
        return [*slopes.lines, *lines]


@final
class _Slopes:
    """Partial derivatives of one operation, each written once for all groups, if at all."""

    def __init__(
        self, patterns: Sequence[str | None], values: Sequence[Carried], result: Carried, name: str
    ) -> None:
        self.patterns = patterns
        self.lines: list[tuple[int, str]] = []
        self._operands = {**dict(zip("ab", values, strict=False)), "f": result}
        self._name = name
        self._told: dict[str, Carried] = {}

    def of(self, pattern: str) -> Carried:
        """A factor with the sign of multiplication behind it; one of 1 or -1 is not multiplied."""
        if pattern in (_SAME, _MINUS):
            return Carried(pattern, 0)
        factor = self._factor(pattern)
        return Carried(f"{factor.text} * ", factor.level)

    def _factor(self, pattern: str) -> Carried:
        known = self._told.get(pattern)
        if known is not None:
            return known
        used = {k: v for k, v in self._operands.items() if f"{{{k}}}" in pattern}
        if "{s}" in pattern:
            used["s"] = self._factor(str(self.patterns[0]))
        level = max((v.level for v in used.values()), default=0)
        said = pattern.format(**{k: v.text for k, v in used.items()})
        if pattern not in _BARE:
            name = f"{self._name}_d{len(self._told)}"
            self.lines.append((level, f"const double {name} = {said};"))
            said = name
        self._told[pattern] = Carried(said, level)
        return self._told[pattern]
