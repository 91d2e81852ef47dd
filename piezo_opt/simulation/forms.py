"""One form of an effect as a few functions of named numbers, for models composed of them.

What an effect gives its place, how fast that changes, how its states move, start and jump: each is
an expression of the signals that it reads, its states and its parameters. What is a signal itself,
or zero, is no function but a name. The rest is written as functions, each with its derivatives by
every number that it reads, and with what is linear in it: coefficients that the parameters alone
decide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, final

import casadi as ca
import numpy as np

from piezo_opt.effects.base import Chain, Effect, Equations, Place, Signal, Symbols
from piezo_opt.effects.promises import CLOSE, INSTANTS, SIZES, equations_of
from piezo_opt.errors import ModelError
from piezo_opt.simulation.exponential import split

PARAMETER: Final = "p:"
STATE: Final = "x:"
CHANNEL: Final = "channel:"
RATE: Final = "'"
"""Ends the name of a number's rate."""
_UNITS: Final = {
    "command": "V", "drive": "V", "incoming": "V", "free": "m", "position": "m", "hysteresis": "m",
}  # fmt: skip
"""Units of signals; others count as of size one."""


@final
@dataclass(frozen=True)
class Term:
    """One number that an effect says.

    Attributes:
        kind: ``"number"``, ``"same"`` as a named number, or the name of a function of the form.
        name: of the number that it is the same as.
        value: the number, or the sign of the same one.
        index: which of the function's outputs.
    """

    kind: str
    name: str = ""
    value: float = 0.0
    index: int = 0


@final
@dataclass(frozen=True)
class Part:
    """A function of a form.

    Attributes:
        inputs: names of what it reads, parameters first.
        outputs: how many numbers it says.
        needs: for each output the inputs that it follows.
        linear: for each output the coefficient of each input that it holds a multiple of.
        bends: for each output the inputs that it follows otherwise than by multiples.
        symbol: name of its C functions.
        kept: numbers that its preparation keeps, without and with derivatives.
    """

    inputs: tuple[str, ...]
    outputs: int
    needs: tuple[tuple[str, ...], ...]
    linear: tuple[Mapping[str, Term], ...]
    bends: tuple[tuple[str, ...], ...]
    symbol: str = ""
    kept: tuple[int, int] = (0, 0)


@final
@dataclass(frozen=True)
class Form:
    """What an effect says, by name.

    Attributes:
        parts: its functions.
        gives: what it gives its place.
        rate: the rate of that, where something reads it: on a line and on the strain balance.
        moves, starts, becomes: of its states, one term an element.
        massless: of a force on the position x, for a balance without inertia: ``"balance"``, the
            force and its derivative by x; ``"drift"``, the rate of the force, the derivative of
            that by the velocity, and whether the latter follows more of it than its sign. Nothing
            where a force follows the velocity itself.
        inertia: as in :class:`piezo_opt.effects.base.Equations`.
        delays: the same.
        settled: whether what it gives is surely the same before and after its states jump.
    """

    parts: Mapping[str, Part]
    gives: Term
    rate: Term
    moves: Mapping[str, tuple[Term, ...]]
    starts: Mapping[str, tuple[Term, ...]]
    becomes: Mapping[str, tuple[Term, ...]]
    massless: Mapping[str, tuple[Term, ...]]
    inertia: Term
    delays: Term
    settled: bool


@final
@dataclass(frozen=True, eq=False)
class Written:
    """A function of a form as expressions: parameters p and others z to outputs and derivatives.

    Attributes:
        plain: ``(p, z) -> outputs``.
        moved: ``(p, z) -> (outputs, derivatives)``, those that are not zero.
        places: output and input (parameters first) of each derivative.
    """

    plain: ca.Function
    moved: ca.Function
    places: tuple[tuple[int, int], ...]


def with_slopes(column: ca.SX, p: ca.SX, z: ca.SX) -> Written:
    """Expressions of parameters p and others z, with their derivatives by both."""
    slopes = ca.jacobian(column, ca.vertcat(p, z))
    rows, columns = slopes.sparsity().get_triplet()
    every = [slopes.nz[i] for i in range(slopes.nnz())]
    told = [
        (place, entry)
        for place, entry in zip(zip(rows, columns, strict=True), every, strict=True)
        if not entry.is_zero()
    ]
    entries = [entry for _, entry in told]
    derivatives = ca.vertcat(*entries) if entries else ca.SX(0, 1)
    return Written(
        ca.Function("po_plain", [p, z], [ca.cse(column)]),
        ca.Function("po_moved", [p, z], ca.cse([column, derivatives])),
        tuple(place for place, _ in told),
    )


def elements(name: str, size: int) -> tuple[str, ...]:
    """Names of a state's elements."""
    return (name,) if size == 1 else tuple(f"{name}[{i}]" for i in range(size))


def common(effect: Effect) -> Effect:
    """The form that shares an effect's functions: options that only hold a number do not matter."""
    given = {p.given for p in effect.parameters.values() if p.given}
    plain: Any = type(effect)
    defaults = {f.name: f.default for f in fields(plain) if f.name in given}
    changed: Any = replace(effect, **defaults) if given else effect  # type: ignore[type-var]
    return changed if isinstance(changed, Effect) else effect


def changeable(effect: Effect) -> frozenset[str]:
    """Parameters that are numbers of a form's code unless they are asked for."""
    return frozenset(k for k, p in effect.parameters.items() if p.fixed and not p.given)


def written(effect: Effect, runtime: frozenset[str]) -> tuple[Form, dict[str, Written]]:
    """The functions of an effect.

    Args:
        effect: with its options.
        runtime: fixed parameters that are not numbers of the code.

    Raises:
        ModelError: the equations are not those of the declared states.
    """
    return _Writer(effect, runtime).form()


@final
class _Writer:
    def __init__(self, effect: Effect, runtime: frozenset[str]) -> None:
        self._symbols: dict[str, ca.SX] = {}
        self._headings: list[tuple[ca.SX, ca.SX]] = []
        self._parts: dict[str, Part] = {}
        self._written: dict[str, Written] = {}
        self._effect = effect
        folded = changeable(effect) - runtime
        self._p = {
            k: ca.SX(p.nominal) if k in folded else self._symbol(PARAMETER + k)
            for k, p in effect.parameters.items()
        }
        self._x = {
            k: ca.vertcat(*(self._symbol(STATE + name) for name in elements(k, size)))
            for k, size in effect.states.items()
        }
        incoming = self._signal("incoming" if effect.place.is_line else "drive")
        channels = [n.removeprefix(CHANNEL) for n in effect.requires if n.startswith(CHANNEL)]
        self._chain = Chain(
            time=self._symbol("time"),
            command=self._signal("command"),
            incoming=incoming,
            drive=self._signal("drive"),
            hysteresis=self._symbol("hysteresis"),
            law=self._symbol("law"),
            free=self._signal("free"),
            position=self._signal("position"),
            acceleration=self._symbol("acceleration"),
            channels={name: self._signal(CHANNEL + name) for name in channels},
        )

    def _symbol(self, name: str) -> ca.SX:
        return self._symbols.setdefault(name, ca.SX.sym(name))

    def _signal(self, name: str) -> Signal:
        rate, heading = self._symbol(name + RATE), ca.SX.sym(f"heading of {name}")
        self._headings.append((heading, rate))
        return Signal(self._symbol(name), rate, heading)

    def form(self) -> tuple[Form, dict[str, Written]]:
        said = equations_of(
            self._effect.name, self._effect, self._chain, Symbols(**self._x), Symbols(**self._p)
        )
        for what in (said.moves, said.starts, said.becomes):
            for state in what:
                if state not in self._effect.states:
                    raise ModelError(f"'{state}' is not a declared state")
        gives = self._by_rate(said.gives)
        asked = self._effect.place.is_line or self._effect.place is Place.STRAIN
        by_time = [n for n in self._symbols if _moves(n)] if asked else []
        rates = [ca.SX(1.0) if n == "time" else self._symbol(n + RATE) for n in by_time]
        rate = ca.jtimes(
            gives, ca.vertcat(*(self._symbols[n] for n in by_time)), ca.vertcat(*rates)
        )
        form = Form(
            parts=self._parts,
            gives=self._terms("gives", self._by_rate(said.gives, 0.0))[0],
            rate=self._terms("rate", rate)[0],
            moves=self._columns("moves", said.moves),
            starts=self._columns("starts", said.starts, apart=True),
            becomes=self._columns("becomes", said.becomes),
            massless=self._massless(gives, said),
            inertia=self._terms("inertia", self._by_rate(said.inertia))[0],
            delays=self._terms("delays", self._by_rate(said.delays))[0],
            settled=self._settled(said),
        )
        return form, self._written

    def _by_rate(self, said: Any, times: float = 1.0) -> ca.SX:
        """An expression with the rates, times a number, where it asks for headings."""
        headings = [heading for heading, _ in self._headings]
        rates = [times * rate for _, rate in self._headings]
        found: ca.SX = ca.substitute([ca.SX(said)], headings, rates)[0]
        return found

    def _settled(self, said: Equations) -> bool:
        """Whether what it gives is the same before and after its states jump.

        An effect says so by asking for a heading, as plays do. It is looked at where numbers are
        drawn at random, of either sign and up to some tens of times their usual size.
        """
        given, states = self._by_rate(said.gives, 0.0), [self._x[k] for k in said.becomes]
        if not any(ca.depends_on(given, state) for state in states):
            return True
        headings = [heading for heading, _ in self._headings]
        if not ca.depends_on(ca.SX(said.gives), ca.vertcat(*headings)):
            return False
        after = ca.substitute([given], states, [ca.SX(v) for v in said.becomes.values()])[0]
        names = [s.name() for s in ca.symvar(ca.vertcat(given, after))]
        both = ca.Function("po_both", [self._symbols[n] for n in names], [given, after])
        random = np.random.default_rng(0)
        drawn = ([self._drawn(random, n) for n in names] for _ in range(INSTANTS))
        found = np.array([[float(one) for one in both(*numbers)] for numbers in drawn])
        return bool(np.ptp(found, axis=1).max() <= CLOSE * np.abs(found).max())

    def _drawn(self, random: np.random.Generator, name: str) -> float:
        """A number that something of that name may be."""
        kind, _, own = name.partition(":")
        if name.startswith(PARAMETER):
            parameter = self._effect.parameters[own]
            far = parameter.nominal + parameter.scale * random.uniform(0.5, 1.5)
            return float(np.clip(far, *parameter.bounds))
        unit = _UNITS.get(kind, "1")
        if name.startswith(STATE):
            unit = self._effect.declared_states[own.partition("[")[0]].unit
        size = SIZES.get(unit, 1.0) * 10.0 ** random.uniform(-1.0, 1.0)
        return float(size * random.standard_normal())

    def _massless(self, gives: ca.SX, said: Equations) -> dict[str, tuple[Term, ...]]:
        declared = self._effect.declared_states
        if self._effect.place is not Place.MOTION or any(s.velocity for s in declared.values()):
            return {}
        x, v = self._symbol("position"), self._symbol("position" + RATE)
        own = [self._x[k] for k, state in declared.items() if state.position]

        def held(column: Any) -> ca.SX:
            return ca.substitute([ca.SX(column)], own, [x] * len(own))[0]

        force = held(gives)
        if ca.depends_on(force, v):
            return {}
        rates = {"time": ca.SX(1.0), "position": v}
        for k, size in self._effect.states.items():
            rate = held(self._by_rate(said.moves.get(k, 0.0)))
            column = ca.repmat(rate, size, 1) if rate.numel() == 1 else ca.reshape(rate, size, 1)
            names = (STATE + name for name in elements(k, size))
            rates.update(zip(names, ca.vertsplit(ca.densify(column)), strict=True))
        moving = [n for n in list(self._symbols) if _moves(n) and n != v.name()]
        drift = ca.jtimes(
            force,
            ca.vertcat(*(self._symbols[n] for n in moving)),
            ca.vertcat(*(rates[n] if n in rates else self._symbol(n + RATE) for n in moving)),
        )
        slope = ca.jacobian(drift, v)
        bent = not ca.jacobian(slope, v).is_zero()
        balance = ca.vertcat(force, ca.jacobian(force, x))
        return {
            "balance": self._terms("balance", balance, structure=False),
            "drift": (
                *self._terms("drift", ca.vertcat(drift, slope), structure=False),
                Term("number", value=float(bent)),
            ),
        }

    def _columns(
        self, kind: str, said: Mapping[str, Any], apart: bool = False
    ) -> dict[str, tuple[Term, ...]]:
        columns = {}
        for state, expression in said.items():
            column, size = self._by_rate(expression), self._effect.states[state]
            if column.numel() == 1:
                column = ca.repmat(column, size, 1)
            elif column.numel() != size:
                raise ModelError(f"'{state}' has {size} elements")
            columns[state] = ca.reshape(column, size, 1)
        if apart:
            return {k: self._terms(f"{kind} {k}", column) for k, column in columns.items()}
        terms = iter(self._terms(kind, ca.vertcat(*columns.values())))
        return {k: tuple(next(terms) for _ in range(c.numel())) for k, c in columns.items()}

    def _terms(self, kind: str, column: ca.SX, structure: bool = True) -> tuple[Term, ...]:
        """What a column of expressions says, and as its part what is not said otherwise."""
        terms: list[Term | None] = []
        left: list[ca.SX] = []
        for one in ca.vertsplit(ca.densify(column)) if column.numel() else ():
            plain = self._named(one)
            if plain is None:
                plain = Term(kind, index=len(left))
                left.append(one)
            terms.append(plain)
        if left:
            self._part(kind, left, structure)
        return tuple(t for t in terms if t is not None)

    def _named(self, one: ca.SX) -> Term | None:
        """A number, or a named one with its sign; None for anything else."""
        if one.is_constant():
            return Term("number", value=float(one))
        sign = 1.0
        while one.is_op(ca.OP_NEG):
            one, sign = one.dep(0), -sign
        return Term("same", one.name(), sign) if one.is_symbolic() else None

    def _part(self, kind: str, outputs: Sequence[ca.SX], structure: bool) -> None:
        column = ca.vertcat(*outputs)
        names = {s.name() for s in ca.symvar(column)}
        parameters = [n for n in self._symbols if n in names and n.startswith(PARAMETER)]
        others = [n for n in self._symbols if n in names and not n.startswith(PARAMETER)]
        inputs = (*parameters, *others)
        p = ca.vertcat(*(self._symbols[n] for n in parameters)) if parameters else ca.SX(0, 1)
        z = ca.vertcat(*(self._symbols[n] for n in others)) if others else ca.SX(0, 1)
        self._written[kind] = with_slopes(column, p, z)
        needs = [{s.name() for s in ca.symvar(one)} for one in outputs]
        linear: list[Mapping[str, Term]] = [{}] * len(outputs)
        bends = needs
        if structure and others:
            linear, bends = self._linear(kind, outputs, others, z)

        def ordered(names: set[str]) -> tuple[str, ...]:
            return tuple(n for n in inputs if n in names)

        self._parts[kind] = Part(
            inputs, len(outputs), tuple(map(ordered, needs)), tuple(linear),
            tuple(map(ordered, bends)),
        )  # fmt: skip

    def _linear(
        self, kind: str, outputs: Sequence[ca.SX], others: Sequence[str], z: ca.SX
    ) -> tuple[list[Mapping[str, Term]], list[set[str]]]:
        """Multiples of inputs in each output, and the inputs that the rest of it follows."""
        wanted = {i: self._symbols[n] for i, n in enumerate(others)}
        found = [split(one, wanted, z, z) for one in outputs]
        told = [(i, j, slope) for i, (one, _) in enumerate(found) for j, slope in one.items()]
        terms = self._terms(f"linear {kind}", ca.vertcat(*(s for *_, s in told)), structure=False)
        linear: list[dict[str, Term]] = [{} for _ in outputs]
        for (i, j, _), term in zip(told, terms, strict=True):
            if not (term.kind == "number" and term.value == 0.0):
                linear[i][others[j]] = term
        return list(linear), [{s.name() for s in ca.symvar(rest)} for _, rest in found]


def _moves(name: str) -> bool:
    """Whether the rate of a named number is known; where it is not, the number counts as steady."""
    if name.startswith(PARAMETER) or name in ("law", "acceleration"):
        return False
    return not name.endswith(RATE) or name == "position" + RATE
