"""A model as a list of operations: which function, which slots; nothing is compiled for it.

Every number of an instant has a slot. What an effect reads is found by name and made when it is
asked for first, so that the order of the operations follows from what they read; what reads itself
is no composition. Linear blocks are found in the same lists: a function tells which of its inputs
it holds a multiple of, and the multiples along a way are multiplied.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np

from piezo_opt.assembly import System
from piezo_opt.effects.base import Place
from piezo_opt.simulation.exponential import blocks_of
from piezo_opt.simulation.forms import CHANNEL, PARAMETER, RATE, STATE, Form, Term, elements

Signed = tuple[int, float]
"""A slot and the sign of what is meant."""
NOTHING: Final[Mapping[str, int]] = {}

SUMS: Final = {count: f"po_sum_{count}" for count in (1, 2, 3, 4)}
PRODUCT: Final = "po_product"
QUOTIENT: Final = "po_quotient"
SIGN: Final = "po_sign"
WEIGHTS: Final = ("po_weights_1", "po_weights_2")
"""Functions that belong to no effect."""


class NotComposable(Exception):
    """The model has something that only a program of its own can do; the message says what."""


@final
@dataclass(frozen=True)
class Operation:
    """A function, by its symbol, and the slots of its inputs and outputs."""

    symbol: str
    slots: tuple[int, ...]
    inputs: int = 0
    """How many of the slots are inputs, where the function is no sum and no product."""

    @property
    def reads(self) -> tuple[int, ...]:
        """Slots of what it is made of."""
        if self.symbol in SUMS.values():
            return self.slots[1:]
        return self.slots[:2] if self.symbol in (PRODUCT, QUOTIENT) else self.slots[: self.inputs]

    @property
    def makes(self) -> tuple[int, ...]:
        """Slots of what it makes."""
        return tuple(s for s in self.slots if s not in self.reads)


@final
@dataclass(frozen=True)
class Block:
    """A linear block.

    Attributes:
        states: one or two.
        matrix: slots of its entries, row by row.
        quiet: for each state whether its rate is nothing but the other state of the block.
        heard: whether the rate of a state that is in no block follows it.
        followed: whether anything within a sub-step does but for multiples within the block.
    """

    states: tuple[int, ...]
    matrix: tuple[int, ...]
    quiet: tuple[bool, ...]
    heard: bool
    followed: bool


@final
@dataclass(frozen=True, eq=False)
class Composition:
    """A model composed of functions; see the plan in ``core.c`` for what the numbers mean.

    Attributes:
        first: slots of time, drive, slope, channels, their slopes, states, parameters, deviations
            of the start, length of a sub-step, weights, by name.
        count: number of slots.
        constants: number of each slot that never changes.
        lists: operations of each list. Those called ``"driven"`` are asked within a sub-step too,
            but follow nothing that moves there but time, drive and channels.
        driven: slots of what those make for others.
        rates: slot of the rate of each state that moves.
        after: slot of what each state becomes that jumps.
        blocks: linear blocks, none unless they are moved by their exponential.
        read: slot of the reading.
        clocks: parameters that shift the chain's clock.
        delay: number by which the chain lags beside those, [s].
    """

    first: Mapping[str, int]
    count: int
    constants: Mapping[int, float]
    lists: Mapping[str, tuple[Operation, ...]]
    driven: tuple[int, ...]
    rates: Mapping[int, int]
    after: Mapping[int, int]
    blocks: tuple[Block, ...]
    read: int
    clocks: tuple[str, ...]
    delay: float | None


def compose(system: System, forms: Mapping[str, Form], exact: bool) -> Composition:
    """The list of operations of a model.

    Args:
        system: names its parameters, states and channels.
        forms: the form of each of its effects.
        exact: whether linear blocks are taken out.

    Raises:
        NotComposable: the model needs a program of its own.
    """
    return _Composer(system, forms).composition(exact)


@final
class _Composer:
    def __init__(self, system: System, forms: Mapping[str, Form]) -> None:
        self.system = system
        self.model = system.model
        self.forms = forms
        self.slots: dict[str, int] = {}
        self.constants: dict[float, int] = {}
        channels = system.channel_names
        self.state_index = {n: i for i, n in enumerate(system.state_names)}
        self.first = {}
        for what, names in (
            ("time", ["time"]), ("drive", ["command"]), ("slope", ["command" + RATE]),
            ("channel", [CHANNEL + n for n in channels]),
            ("channel_slope", [CHANNEL + n + RATE for n in channels]),
            ("state", [STATE + n for n in system.state_names]),
            ("parameter", [PARAMETER + n for n in system.parameter_names]),
            ("deviation", [f"deviation {n}" for n in system.state_names]),
            ("length", ["length"]),
        ):  # fmt: skip
            self.first[what] = len(self.slots)
            for name in names:
                self.slot(name)
        self.base = len(self.slots)
        flagged: dict[str, tuple[str, str]] = {}
        for name, effect in self.model:
            for state, declared in effect.declared_states.items():
                for role in ("loop", "position", "velocity"):
                    if getattr(declared, role):
                        flagged.setdefault(role, (name, state))
        self.flagged = flagged
        self.at = {place: [n for n, _ in self.model.at(place)] for place in Place}
        self.place = {n: (place, i) for place in Place for i, n in enumerate(self.at[place])}
        if "position" in flagged and not self.at[Place.MOTION]:
            raise NotComposable("a position that nothing moves")
        self.massless = "position" in flagged and "velocity" not in flagged

    def slot(self, key: str) -> int:
        return self.slots.setdefault(key, len(self.slots))

    def constant(self, value: float) -> int:
        if value not in self.constants:
            self.constants[value] = self.slot(f"number {value!r}")
        return self.constants[value]

    def composition(self, exact: bool) -> Composition:
        stage = _List(self)
        rates = {}
        zero = self.constant(0.0)
        jumping = []
        for name, effect in self.model:
            form = self.forms[name]
            for state, size in effect.states.items():
                for element in elements(f"{name}.{state}", size):
                    index = self.state_index[element]
                    if state in form.becomes:
                        jumping.append((index, name, form.becomes[state], element))
                    if state in form.moves:
                        rate = stage.number(STATE + element + RATE)
                        if rate != zero:
                            rates[index] = rate
        reading = _List(self)
        read = reading.positive(reading.line(Place.OUTPUT, len(self.at[Place.OUTPUT]) - 1))
        jump, after = _List(self), {}
        counted: dict[str, int] = {}
        for index, name, terms, element in jumping:
            which = counted.setdefault(f"{name} {element.partition('[')[0]}", 0)
            after[index] = jump.positive(jump.term(name, terms[which]))
            counted[f"{name} {element.partition('[')[0]}"] += 1
        if self.massless and jumping:
            element = ".".join(self.flagged["position"])
            after[self.state_index[element]] = jump.balanced(self.slots[STATE + element], 1)
        start = _Start(self)
        for name in self.system.state_names:
            start.number(STATE + name)
        once, weigh = _List(self), _List(self)
        blocks: tuple[Block, ...] = ()
        first = dict(self.first)
        if exact and rates:
            blocks = _Linear(stage, once, rates).blocks()
        first["weights"] = len(self.slots)
        for i, block in enumerate(blocks):
            size = len(block.states)
            outputs = [self.slot(f"weight {i} {k}") for k in range(6 * size * size)]
            slots = (*block.matrix, first["length"], *outputs)
            weigh.operations.append(Operation(WEIGHTS[size - 1], slots, size * size + 1))
        clocks, delay = self._delays()
        driven = self._driven(stage.operations, rates)
        made = {slot for one in driven for slot in one.makes}

        def others(of: _List) -> tuple[Operation, ...]:
            return tuple(one for one in of.operations if one not in driven)

        lists = {
            "once": tuple(once.operations), "weigh": tuple(weigh.operations), "driven": driven,
            "stage": others(stage), "reading": others(reading), "jump": others(jump),
            "start": tuple(start.operations),
        }  # fmt: skip
        asked = {slot for k in ("stage", "reading", "jump") for one in lists[k]
                 for slot in one.reads}  # fmt: skip
        asked |= {read, *rates.values(), *after.values()}
        return Composition(
            first, len(self.slots), {slot: value for value, slot in self.constants.items()}, lists,
            tuple(sorted(made & asked)), rates, after, blocks, read, clocks, delay,
        )  # fmt: skip

    def _driven(
        self, operations: Sequence[Operation], rates: Mapping[int, int]
    ) -> tuple[Operation, ...]:
        """Those that follow no state that moves, no slope, and no jump that they would show."""
        moving = {self.first["state"] + i for i in rates}
        moving |= {s for n, s in self.slots.items() if n.endswith(RATE) and s < self.base}
        for name, effect in self.model:
            if not self.forms[name].settled:
                moving |= {
                    self.slots[STATE + one]
                    for state, size in effect.states.items()
                    for one in elements(f"{name}.{state}", size)
                }
        found = []
        for one in operations:
            if moving & {*one.reads}:
                moving |= {*one.makes}
            else:
                found.append(one)
        return tuple(found)

    def _delays(self) -> tuple[tuple[str, ...], float | None]:
        clocks, delay = [], 0.0
        for name, _ in self.model:
            term = self.forms[name].delays
            if term.kind == "number":
                delay += term.value
            elif term.kind == "same" and term.name.startswith(PARAMETER) and term.value == 1.0:
                full = f"{name}.{term.name.removeprefix(PARAMETER)}"
                if full in self.system.constants:
                    delay += self.system.constants[full]
                else:
                    clocks.append(full)
            else:
                raise NotComposable(f"{name} delays by a formula")
        return tuple(clocks), delay if clocks or delay else None


class _List:
    """Operations in the order in which they are asked for."""

    def __init__(self, composer: _Composer) -> None:
        self.own = composer
        self.operations: list[Operation] = []
        self._known: dict[str, int] = {}
        self._asked: set[str] = set()
        self.made: dict[int, tuple[str, tuple[str, ...], tuple[int, ...], int]] = {}
        """Of a slot: effect and part, the names of the inputs, their slots, which output."""
        self.sums: dict[int, tuple[Signed, ...]] = {}
        self.quotients: dict[int, tuple[int, int]] = {}
        self.bent: dict[int, tuple[int, ...]] = {}
        """Of a slot that holds a multiple of nothing: the slots that it follows."""

    def number(self, name: str) -> int:
        """The slot of a number of the chain, computed by now."""
        if name in self._known:
            return self._known[name]
        if name in self._asked:
            raise NotComposable(f"{name} follows from itself")
        self._asked.add(name)
        found = self.positive(self.made_of(name))
        self._known[name] = found
        return found

    def made_of(self, name: str) -> Signed:
        """How a number is made."""
        own = self.own
        if own.slots.get(name, own.base) < own.base:
            return own.slots[name], 1.0
        if name.startswith(PARAMETER):
            return own.constant(own.system.constants[name.removeprefix(PARAMETER)]), 1.0
        makers: dict[str, Callable[[], Signed]] = {
            "drive": lambda: self.line(Place.INPUT, len(own.at[Place.INPUT]) - 1),
            "drive'": lambda: self.line_rate(Place.INPUT, len(own.at[Place.INPUT]) - 1),
            "free": lambda: self.total(Place.STRAIN),
            "free'": lambda: self.total(Place.STRAIN, rate=True),
            "hysteresis": self._remembered,
            "hysteresis'": lambda: self._remembered(RATE),
            "law": self._law,
            "position": lambda: self._flagged("position", otherwise="free"),
            "position'": lambda: (
                self._massless() if own.massless else self._flagged("velocity", otherwise="free'")
            ),
            "position''": lambda: self._flagged("velocity", RATE),
            "acceleration": self._acceleration,
        }
        if name in makers:
            return makers[name]()
        if name.startswith(STATE) and name.endswith(RATE):
            return self._state_rate(name.removeprefix(STATE).removesuffix(RATE))
        raise NotComposable(f"nothing makes {name}")

    def _flagged(self, role: str, end: str = "", otherwise: str = "") -> Signed:
        flagged = self.own.flagged.get(role)
        if flagged is not None:
            return self.number(f"{STATE}{'.'.join(flagged)}{end}"), 1.0
        return (self.number(otherwise) if otherwise else self.own.constant(0.0)), 1.0

    def _remembered(self, end: str = "") -> Signed:
        """What the hysteresis law takes from the strain, or how fast that changes."""
        law = self.own.model.hysteresis
        if law is None or "loop" in self.own.flagged:
            return self._flagged("loop", end)
        form = self.own.forms[law]
        slot, sign = self.term(law, form.rate if end else form.gives)
        return slot, -sign

    def _law(self) -> Signed:
        if "loop" not in self.own.flagged:
            return self.own.constant(0.0), 1.0
        name, state = self.own.flagged["loop"]
        terms = self.own.forms[name].moves.get(state)
        if terms is None:
            raise NotComposable("the loop has no rate")
        return self.term(name, terms[0])

    def held(self, what: str, index: int, at: int) -> Signed:
        """What the forces of a balance without inertia add up to (see ``Form.massless``).

        Args:
            what: ``"balance"`` at a position, or ``"drift"`` at a velocity.
            index: which of its numbers.
            at: slot of the position or velocity.
        """
        name = "position" if what == "balance" else "position" + RATE
        terms = []
        for effect in self.own.at[Place.MOTION]:
            said = self.own.forms[effect].massless.get(what)
            if said is None:
                raise NotComposable(f"{effect} follows the velocity itself")
            terms.append(self.term(effect, said[index], {name: at}))
        return self.added(terms, f"{what} {index} at {at}")

    def balanced(self, at: int, steps: int) -> int:
        """Where a balance without inertia is zero, by Newton's method (see ``assembly.py``)."""
        for _ in range(steps):
            miss, steep = (self.positive(self.held("balance", k, at)) for k in (0, 1))
            at = self.less_ratio(at, miss, steep)
        return at

    def less_ratio(self, at: int | None, over: int, under: int) -> int:
        """A number less a quotient: where Newton's method goes."""
        quotient = self.own.slot(f"{over} over {under}")
        self.operations.append(Operation(QUOTIENT, (over, under, quotient)))
        self.bent[quotient] = over, under
        terms = [(quotient, -1.0)] if at is None else [(at, 1.0), (quotient, -1.0)]
        return self.sum_into(self.own.slot(f"after {quotient}"), terms)

    def _massless(self) -> Signed:
        """The velocity at which a balance without inertia stays at zero (see ``assembly.py``)."""
        still = self.positive(self.held("drift", 0, self.own.constant(0.0)))
        side = self.own.slot(f"sign of {still}")
        self.operations.append(Operation(SIGN, (still, side), 1))
        self.bent[side] = (still,)
        at = self.less_ratio(None, still, self.positive(self.held("drift", 1, side)))
        forms = (self.own.forms[effect] for effect in self.own.at[Place.MOTION])
        for _ in range(2 if any(form.massless["drift"][2].value for form in forms) else 0):
            miss, steep = (self.positive(self.held("drift", k, at)) for k in (0, 1))
            at = self.less_ratio(at, miss, steep)
        return at, 1.0

    def _acceleration(self) -> Signed:
        motion = self.total(Place.MOTION)
        inertia = self.inertia()
        if inertia is None:
            return motion
        found = self.own.slot("acceleration")
        over = self.positive(motion)
        self.operations.append(Operation(QUOTIENT, (over, inertia, found)))
        self.quotients[found] = (over, inertia)
        return found, 1.0

    def inertia(self) -> int | None:
        """The slot of the mass that the position carries over its own; None where it is 1."""
        terms = [self.term(n, self.own.forms[n].inertia) for n in self.own.system.model.names]
        left = self._without_zeros(terms)
        if not left:
            return None
        return self.positive(self.added([(self.own.constant(1.0), 1.0), *left], "inertia"))

    def _state_rate(self, element: str) -> Signed:
        own = self.own
        state, _, index = element.removesuffix("]").partition("[")
        name, _, short = state.rpartition(".")
        if (name, short) == own.flagged.get("loop"):
            terms = [self._number_signed("law")]
            terms += [self.term(n, own.forms[n].gives) for n in own.at[Place.LOOP]]
            return self.added(terms, f"rate {element}")
        terms_of = own.forms[name].moves.get(short)
        if terms_of is None:
            return own.constant(0.0), 1.0
        return self.term(name, terms_of[int(index or 0)])

    def _number_signed(self, name: str) -> Signed:
        return self.number(name), 1.0

    def line(self, place: Place, index: int) -> Signed:
        """A signal as the effect of that index leaves it."""
        if index < 0:
            return self.number("command" if place is Place.INPUT else "position"), 1.0
        name = self.own.at[place][index]
        return self.term(name, self.own.forms[name].gives)

    def line_rate(self, place: Place, index: int) -> Signed:
        """Its rate."""
        if index < 0:
            return self.number("command'" if place is Place.INPUT else "position'"), 1.0
        name = self.own.at[place][index]
        return self.term(name, self.own.forms[name].rate)

    def total(self, place: Place, rate: bool = False) -> Signed:
        """What the effects of a balance add up to, or how fast that changes."""
        forms, names = self.own.forms, self.own.at[place]
        terms = [self.term(n, forms[n].rate if rate else forms[n].gives) for n in names]
        return self.added(terms, f"{place.name}{RATE if rate else ''}")

    def _without_zeros(self, terms: Sequence[Signed]) -> list[Signed]:
        zero = self.own.constant(0.0)
        return [term for term in terms if term[0] != zero]

    def added(self, terms: Sequence[Signed], key: str) -> Signed:
        """The slot of a sum."""
        left = self._without_zeros(terms)
        if len(left) == 0:
            return self.own.constant(0.0), 1.0
        if len(left) == 1:
            return left[0]
        return self.sum_into(self.own.slot(f"sum {key}"), left), 1.0

    def sum_into(self, slot: int, terms: Sequence[Signed]) -> int:
        """A slot that becomes a sum."""
        self.sums[slot] = tuple(terms)
        left, most = list(terms), max(SUMS)
        while len(left) > most:
            inner = self.own.slot(f"sum {slot} {len(left)}")
            self._add(inner, left[:most])
            left = [(inner, 1.0), *left[most:]]
        self._add(slot, left)
        return slot

    def _add(self, slot: int, terms: Sequence[Signed]) -> None:
        signs = [(of, self.own.constant(sign)) for of, sign in terms]
        slots = [n for pair in signs for n in pair]
        self.operations.append(Operation(SUMS[len(terms)], (slot, *slots)))

    def positive(self, of: Signed) -> int:
        """A slot that holds the number with its sign."""
        slot, sign = of
        if sign > 0:
            return slot
        key = f"less {slot}"
        if key not in self._known:
            self._known[key] = self.sum_into(self.own.slot(key), [of])
        return self._known[key]

    def term(self, effect: str, term: Term, instead: Mapping[str, int] = NOTHING) -> Signed:
        """What an effect says, with other slots in the place of some that it reads."""
        if term.kind == "number":
            return self.own.constant(term.value), 1.0
        if term.kind == "same" and term.name in instead:
            return instead[term.name], term.value
        if term.kind == "same":
            slot, sign = self._local(effect, term.name)
            return slot, sign * term.value
        return self._part(effect, term.kind, instead) + term.index, 1.0

    def _part(self, effect: str, kind: str, instead: Mapping[str, int] = NOTHING) -> int:
        """The first slot of a function's outputs."""
        others = {
            n: s for n, s in instead.items() if n in self.own.forms[effect].parts[kind].inputs
        }
        key = " ".join([effect, kind, *(f"{n} {slot}" for n, slot in others.items())])
        if key in self._known:
            return self._known[key]
        if key in self._asked:
            raise NotComposable(f"{effect} follows from itself")
        self._asked.add(key)
        part = self.own.forms[effect].parts[kind]
        inputs = tuple(
            others[name] if name in others else self.positive(self._local(effect, name))
            for name in part.inputs
        )
        outputs = tuple(self.own.slot(f"{key} {i}") for i in range(part.outputs))
        self.operations.append(Operation(part.symbol, (*inputs, *outputs), len(inputs)))
        for i, slot in enumerate(outputs):
            self.made[slot] = (effect, (kind,), inputs, i)
        self._known[key] = outputs[0]
        return outputs[0]

    def _local(self, effect: str, name: str) -> Signed:
        """A number by the name that an effect has for it."""
        if name.startswith((PARAMETER, STATE)):
            kind, _, own = name.partition(":")
            return self.number(f"{kind}:{effect}.{own}"), 1.0
        place, index = self.own.place[effect]
        if name == "incoming":
            return self.line(place, index - 1)
        if name == "incoming" + RATE:
            return self.line_rate(place, index - 1)
        return self.number(name), 1.0


@final
class _Start(_List):
    """The same at rest: nothing moves, and states are what they begin as."""

    def _local(self, effect: str, name: str) -> Signed:
        if name.endswith(RATE):
            return self.own.constant(0.0), 1.0
        return super()._local(effect, name)

    def number(self, name: str) -> int:
        if name.endswith(RATE) or name in ("law", "acceleration"):
            return self.own.constant(0.0)
        if not name.startswith(STATE):
            return super().number(name)
        if name in self._known:
            return self._known[name]
        if name in self._asked:
            raise NotComposable(f"the start of {name} follows from itself")
        self._asked.add(name)
        element = name.removeprefix(STATE)
        state, _, index = element.removesuffix("]").partition("[")
        effect, _, short = state.rpartition(".")
        terms = self.own.forms[effect].starts.get(short)
        added = [(self.own.slots[f"deviation {element}"], 1.0)]
        if self.own.massless and (effect, short) == self.own.flagged["position"]:
            at = self.positive(self.term(effect, terms[0])) if terms else self.own.constant(0.0)
            added = [(self.balanced(at, 3), 1.0), *added]
        elif terms is not None:
            added = [*self._without_zeros([self.term(effect, terms[int(index or 0)])]), *added]
        self._known[name] = self.sum_into(self.own.slots[name], added)
        return self._known[name]


@final
class _Linear:
    """The blocks of states whose rates hold multiples of one another."""

    def __init__(self, stage: _List, once: _List, rates: Mapping[int, int]) -> None:
        self.stage = stage
        self.once = once
        self.rates = rates
        self.own = stage.own
        self._states = {
            self.own.first["state"] + i: i for i in range(len(self.own.system.state_names))
        }
        self._multiples: dict[int, frozenset[int]] = {}
        self._followed: dict[int, frozenset[int]] = {}
        self._bent: dict[int, frozenset[int]] = {}

    def blocks(self) -> tuple[Block, ...]:
        n = len(self._states)
        pattern = np.zeros((n, n), dtype=bool)
        for i, slot in self.rates.items():
            pattern[i, list(self.multiples(slot))] = True
        found = blocks_of(pattern)
        among = {i for block in found for i in block}
        others: set[int] = set()
        for i, slot in self.rates.items():
            if i not in among:
                others |= self.follows(slot)
        return tuple(self._block(states, bool(others & {*states})) for states in found)

    def _block(self, states: tuple[int, ...], heard: bool) -> Block:
        zero = self.own.constant(0.0)
        matrix = []
        for i in states:
            for j in states:
                slope = self.slope(self.rates[i], j) if i in self.rates else None
                matrix.append(zero if slope is None else self.once.positive(slope))
        quiet = tuple(self._states.get(self.rates[i]) in states for i in states)
        read: set[int] = set()
        for i, slot in self.rates.items():
            read |= self.bends(slot) if i in states else self.follows(slot)
        return Block(states, tuple(matrix), quiet, heard, bool(read & {*states}))

    def multiples(self, slot: int) -> frozenset[int]:
        """States that a number holds multiples of."""
        if slot not in self._multiples:
            found: set[int] = set()
            if slot in self._states:
                found.add(self._states[slot])
            for _, of in self._ways(slot):
                found |= self.multiples(of)
            self._multiples[slot] = frozenset(found)
        return self._multiples[slot]

    def _ways(self, slot: int) -> list[tuple[Term | Signed | None, int]]:
        """What a number holds multiples of, and by what."""
        stage = self.stage
        if slot in stage.made:
            effect, (kind,), inputs, index = stage.made[slot]
            part = self.own.forms[effect].parts[kind]
            linear = part.linear[index]
            return [
                (linear[name], of)
                for name, of in zip(part.inputs, inputs, strict=True)
                if name in linear
            ]
        if slot in stage.sums:
            return [((0, sign), of) for of, sign in stage.sums[slot]]
        if slot in stage.quotients:
            return [(None, stage.quotients[slot][0])]
        return []

    def follows(self, slot: int) -> frozenset[int]:
        """States that a number follows, in whatever way."""
        if slot not in self._followed:
            found: set[int] = set()
            stage = self.stage
            if slot in self._states:
                found.add(self._states[slot])
            if slot in stage.made:
                effect, (kind,), inputs, index = stage.made[slot]
                part = self.own.forms[effect].parts[kind]
                needs = {*part.needs[index]}
                for name, of in zip(part.inputs, inputs, strict=True):
                    if name in needs:
                        found |= self.follows(of)
            for of, _ in stage.sums.get(slot, ()):
                found |= self.follows(of)
            for of in (*stage.quotients.get(slot, ()), *stage.bent.get(slot, ())):
                found |= self.follows(of)
            self._followed[slot] = frozenset(found)
        return self._followed[slot]

    def bends(self, slot: int) -> frozenset[int]:
        """States that a number follows otherwise than by multiples."""
        if slot not in self._bent:
            found: set[int] = set()
            stage = self.stage
            if slot in stage.made:
                effect, (kind,), inputs, index = stage.made[slot]
                part = self.own.forms[effect].parts[kind]
                for name, of in zip(part.inputs, inputs, strict=True):
                    if name in part.bends[index]:
                        found |= self.follows(of)
                    elif name in part.linear[index]:
                        found |= self.bends(of)
            for of, _ in stage.sums.get(slot, ()):
                found |= self.bends(of)
            for of in stage.bent.get(slot, ()):
                found |= self.follows(of)
            if slot in stage.quotients:
                over, under = stage.quotients[slot]
                found |= self.bends(over) | self.follows(under)
            self._bent[slot] = frozenset(found)
        return self._bent[slot]

    def slope(self, slot: int, state: int) -> Signed | None:
        """The multiple of a state that a number holds, as a number of the parameters alone."""
        if self._states.get(slot) == state:
            return self.own.constant(1.0), 1.0
        terms: list[Signed] = []
        for by, of in self._ways(slot):
            if state not in self.multiples(of):
                continue
            inner = self.slope(of, state)
            if inner is None:
                continue
            if by is None:
                terms.append(self._over(inner))
            elif isinstance(by, Term):
                effect = self.stage.made[slot][0]
                terms.append(self._times(self.once.term(effect, by), inner))
            else:
                terms.append((inner[0], inner[1] * by[1]))
        if not terms:
            return None
        return self.once.added(terms, f"slope {slot} {state}")

    def _times(self, a: Signed, b: Signed) -> Signed:
        one = self.own.constant(1.0)
        if a[0] == one or b[0] == one:
            return (b[0] if a[0] == one else a[0]), a[1] * b[1]
        slot = self.own.slot(f"product {a[0]} {b[0]}")
        self.once.operations.append(Operation(PRODUCT, (a[0], b[0], slot)))
        return slot, a[1] * b[1]

    def _over(self, a: Signed) -> Signed:
        inertia = self.once.inertia()
        assert inertia is not None
        slot = self.own.slot(f"over inertia {a[0]}")
        self.once.operations.append(Operation(QUOTIENT, (a[0], inertia, slot)))
        return slot, a[1]
