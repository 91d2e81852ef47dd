"""From a model to CasADi functions: the assembler.

Effects give values; *rates are the assembler's*. Every signal and every state's rate is a
placeholder while effects are asked for their equations; afterwards the definitions are put in
order and substituted. A definition that needs itself is an algebraic loop, which is refused by
name. So there is no build order to discover and no effect differentiates a signal.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata, resources
from pathlib import Path
from typing import Any, Final, final

import casadi as ca

from piezo_opt.effects.base import Chain, Effect, Place, Signal, Symbols
from piezo_opt.effects.model import Model
from piezo_opt.effects.promises import check_promises, equations_of
from piezo_opt.errors import ModelError
from piezo_opt.keeping import digest, kept
from piezo_opt.lazy import lazy
from piezo_opt.symbolic import Expression, one_at_a_time


@final
@dataclass(frozen=True, eq=False)
class System:
    """A model as CasADi functions of one instant.

    With t [s], states x, command u [V] and its rate, channels c and their rates, parameters p
    (all columns, SI units):

    Attributes:
        parameter_names: order of p.
        state_names: order of x, ``"creep.z[0]"`` for elements of a column.
        state_units: SI unit of each state.
        channel_names: order of c.
        constants: parameters folded into the expressions, with their values.
    """

    model: Model
    parameter_names: tuple[str, ...]
    state_names: tuple[str, ...]
    state_units: tuple[str, ...]
    channel_names: tuple[str, ...]
    constants: Mapping[str, float]

    @lazy
    def functions(self) -> Mapping[str, Any]:
        """All functions by their names; made when one is asked for first.

        Raises:
            ModelError: signals depend on themselves, or nothing moves what has to be moved.
        """
        return _functions(self.model, tuple(sorted(self.constants.items())))

    @property
    def rate(self) -> ca.Function:
        """``(t, x, u, du, c, dc, p) -> x'``."""
        found: ca.Function = self.functions["rate"]
        return found

    @property
    def reading(self) -> ca.Function:
        """``(t, x, u, du, c, dc, p) -> y`` [m]."""
        found: ca.Function = self.functions["reading"]
        return found

    @property
    def signals(self) -> ca.Function:
        """``(t, x, u, du, c, dc, p) -> (v, v', h, s, s', x, x')`` stacked."""
        found: ca.Function = self.functions["signals"]
        return found

    @property
    def start(self) -> ca.Function:
        """``(t, u, c, p, deviation) -> x`` at rest, plus the deviation, carried downstream."""
        found: ca.Function = self.functions["start"]
        return found

    @property
    def becomes(self) -> ca.Function | None:
        """``(t, x, u, du, c, p) -> x`` after a monotone stretch, None if no state jumps."""
        found: ca.Function | None = self.functions["becomes"]
        return found

    @property
    def delay(self) -> ca.Function | None:
        """``(p) -> T`` [s], None without a delay."""
        found: ca.Function | None = self.functions["delay"]
        return found

    @lazy
    @one_at_a_time
    def recipe(self) -> str:
        """All of what a program that simulates the system depends on, as one text."""
        parts = (self.rate, self.reading, self.start, self.becomes, self.delay)
        names = (self.parameter_names, self.state_names, self.channel_names)
        return "\n".join(
            (*map(str, names), *("-" if part is None else part.serialize() for part in parts))
        )


def folded(model: Model, runtime: Sequence[str] = ()) -> dict[str, float]:
    """Parameters that are constants of the code: fixed, of no option, not asked for at run time."""
    return {
        k: p.nominal for k, p in model.parameters.items()
        if p.fixed and not p.given and k not in runtime
    }  # fmt: skip


def assemble(model: Model, constants: Mapping[str, float] | None = None) -> System:
    """Write the model's equations as CasADi functions.

    Args:
        model: a sum of effects.
        constants: parameters folded into the expressions; by default those declared fixed, at
            their nominal values.

    Raises:
        ModelError: an effect's needs are not met, or signals depend on themselves.
    """
    system = named(model, constants)
    _ = system.functions
    return system


def named(model: Model, constants: Mapping[str, float] | None = None) -> System:
    """The system of a model, whose functions are written when one is asked for first.

    Args:
        model: a sum of effects.
        constants: as for :func:`assemble`.

    Raises:
        ModelError: an effect's needs are not met.
    """
    for _, effect in model:
        if not type(effect).__module__.startswith(f"{__package__}."):
            check_effect(effect)
    chosen = folded(model) if constants is None else dict(constants)
    return _assemble(model, tuple(sorted(chosen.items())))


@lru_cache(maxsize=256)
def check_effect(effect: Effect) -> None:
    """Refuse an effect of a user's own that does not keep what an effect has to; once for each.

    It is put beside a gain, a hysteresis loop and a resonance, with random states.

    Raises:
        ModelError: its code raises, its units do not exist, or it does not vanish at its null.
    """
    check_promises(effect, lambda model: _assemble(model, ()))


@lru_cache(maxsize=2048)
def _assemble(model: Model, constants: tuple[tuple[str, float], ...]) -> System:
    channels = _channels(model)
    for name, effect in model:
        refusal = model.refusal(effect, channels)
        if refusal is not None:
            raise ModelError(f"{name}: {refusal}")
    folded_names = dict(constants)
    states = [
        (f"{name}.{state}" if size == 1 else f"{name}.{state}[{i}]", declared[state].unit)
        for name, effect in model
        for declared in (effect.declared_states,)
        for state, size in effect.states.items()
        for i in range(size)
    ]
    return System(
        model=model,
        parameter_names=tuple(n for n in model.parameters if n not in folded_names),
        state_names=tuple(name for name, _ in states),
        state_units=tuple(unit for _, unit in states),
        channel_names=channels,
        constants=folded_names,
    )


def _channels(model: Model) -> tuple[str, ...]:
    """Names of the recorded channels that a model needs."""
    needs = (need for _, effect in model for need in effect.requires)
    marked = (need for need in needs if need.startswith("channel:"))
    return tuple(sorted({need.removeprefix("channel:") for need in marked}))


@one_at_a_time
def _functions(model: Model, constants: tuple[tuple[str, float], ...]) -> Mapping[str, Any]:
    """A system's functions, from another process where one has made them before."""

    def made() -> Mapping[str, Any]:
        return _Assembler(model, dict(constants)).functions()

    def read(text: str) -> Mapping[str, Any]:
        told = json.loads(text)
        return {k: None if v is None else ca.Function.deserialize(v) for k, v in told.items()}

    names = [_told(name, effect) for name, effect in model]
    if None in names:
        return made()
    return kept("systems", f"{names} {constants} {ORIGIN}", made, _written_out, read)


def _written_out(functions: Mapping[str, Any]) -> str:
    """A system's functions as a text."""
    return json.dumps({k: None if f is None else f.serialize() for k, f in functions.items()})


def _told(name: str, effect: Effect) -> str | None:
    """All that tells an effect from others of this package; None for one that is not its own."""
    kind = type(effect)
    own = getattr(sys.modules.get(kind.__module__), kind.__qualname__, None) is kind
    plain = all(isinstance(v, bool | int | float | str) for v in effect.options.values())
    if not (own and plain and kind.__module__.startswith(f"{__package__}.effects.")):
        return None
    return f"{name} {kind.__module__} {effect!r} {kind.equations.__code__.co_code.hex()}"


def _sources() -> str:
    """What turns a model into a system: the engine, and this package's own lines as imported."""
    here = Path(str(resources.files(__package__)))
    files = (here / "assembly.py", here / "symbolic.py", *sorted((here / "effects").rglob("*.py")))
    return f"{metadata.version('casadi')} {digest(b''.join(file.read_bytes() for file in files))}"


ORIGIN: Final = _sources()


@final
class _Assembler:
    """Collects definitions of placeholders, then substitutes them in order."""

    def __init__(self, model: Model, constants: Mapping[str, float]) -> None:
        self.model = model
        self.constants = constants
        self.channel_names = _channels(model)
        self.time = ca.SX.sym("t")
        self.command = Signal(ca.SX.sym("u"), ca.SX.sym("du"))
        self.channels = {n: Signal(ca.SX.sym(n), ca.SX.sym(f"d_{n}")) for n in self.channel_names}
        self.p = {n: ca.SX.sym(n) for n in model.parameters if n not in constants}
        self.x = {
            f"{n}.{s}": ca.SX.sym(f"{n}.{s}", size)
            for n, e in model
            for s, size in e.states.items()
        }
        self.dx = {n: ca.SX.sym(f"d_{n}", s.numel()) for n, s in self.x.items()}
        self.drive = Signal(ca.SX.sym("drive"), ca.SX.sym("rate_of_drive"), ca.SX.sym("heading"))
        self.free = _signal("free")
        self.acceleration = ca.SX.sym("acceleration")
        self.law = ca.SX.sym("law")
        self.hysteresis = ca.SX.sym("hysteresis")
        self.remembered: Expression = 0.0
        self.moves: dict[str, Expression] = {}
        self.starts: dict[str, Expression] = {}
        self.becomes: dict[str, Expression] = {}
        self.delays: list[Expression] = []
        self.inertia: Expression = 1.0
        self.incoming_rates: list[tuple[Expression, Expression]] = []
        self.loop_state = self._flagged("loop")
        self.position_state = self._flagged("position")
        self.velocity_state = self._flagged("velocity")
        self.velocity = ca.SX.sym("velocity")

    def _flagged(self, role: str) -> str | None:
        for name, effect in self.model:
            for state, declared in effect.declared_states.items():
                if getattr(declared, role):
                    return f"{name}.{state}"
        return None

    def _chain(self, incoming: Signal) -> Chain:
        if self.position_state is None:
            position = self.free
        else:
            velocity = self.velocity_state
            rate = self.velocity if velocity is None else self.x[velocity]
            position = Signal(self.x[self.position_state], rate)
        loop = self.loop_state
        return Chain(
            time=self.time,
            command=self.command,
            incoming=incoming,
            drive=self.drive,
            hysteresis=self.hysteresis if loop is None else self.x[loop],
            law=self.law,
            free=self.free,
            position=position,
            acceleration=self.acceleration,
            channels=self.channels,
        )

    def _ask(self, name: str, incoming: Signal) -> Expression:
        effect = self.model[name]
        own_p = Symbols(
            **{
                k: (
                    ca.SX(self.constants[f"{name}.{k}"])
                    if f"{name}.{k}" in self.constants
                    else self.p[f"{name}.{k}"]
                )
                for k in effect.parameters
            }
        )
        own_x = Symbols(**{k: self.x[f"{name}.{k}"] for k in effect.states})
        said = equations_of(name, effect, self._chain(incoming), own_x, own_p)
        for what, into in (
            (said.moves, self.moves),
            (said.starts, self.starts),
            (said.becomes, self.becomes),
        ):
            for state, expression in what.items():
                if state not in effect.states:
                    raise ModelError(
                        f"{name}: equations() moves '{state}', which is not a declared state; "
                        f"declare {state} = State(...) in the class body."
                    )
                into[f"{name}.{state}"] = self._column(f"{name}.{state}", expression)
        for state in effect.states:
            if state not in said.moves and state not in said.becomes:
                raise ModelError(
                    f"{name}: state '{state}' neither moves nor becomes; "
                    "return its rate in Equations(moves=...)."
                )
        if not isinstance(said.delays, float | int) or said.delays != 0.0:
            self.delays.append(said.delays)
        self.inertia += said.inertia
        gives = _expression(name, "gives", said.gives)
        if gives.numel() != 1:
            raise ModelError(
                f"{name}: equations() gives {gives.numel()} elements: give one, such as their sum."
            )
        return gives

    def _column(self, state: str, expression: Expression) -> ca.SX:
        column = self._headed(_expression(state, "the rate or start", expression))
        wanted = self.x[state].numel()
        if column.numel() == 1 and wanted > 1:
            return ca.repmat(column, wanted, 1)
        if column.numel() != wanted:
            raise ModelError(
                f"{state}: equations() returned {column.numel()} elements, the state has {wanted}."
            )
        return ca.reshape(column, wanted, 1)

    def _line(self, place: Place, value: Expression, rate: Expression) -> Expression:
        signal = Signal(value, rate)
        for index, (name, _) in enumerate(self.model.at(place)):
            value = self._headed(self._ask(name, signal))
            outgoing_rate = ca.SX.sym(f"rate_{place.name}_{index}")
            self.incoming_rates.append((outgoing_rate, value))
            signal = Signal(value, outgoing_rate)
        return signal.value

    def _headed(self, value: Expression, times: float = 1.0) -> ca.SX:
        """A value with the rate of the drive, times a number, for its heading."""
        by = times * self.drive.rate
        found: ca.SX = ca.substitute([_written(value)], [self.drive.heading], [by])[0]
        return found

    def _sum(self, place: Place) -> Expression:
        total = ca.SX(0.0)
        for name, effect in self.model.at(place):
            given = self._ask(name, self.drive)
            total += given
            if effect.is_hysteresis_law:
                self.remembered = -given
        return total

    def functions(self) -> dict[str, ca.Function | None]:
        """The functions of the whole model, by their names in :class:`System`."""
        drive = self._line(Place.INPUT, self.command.value, self.command.rate)
        loop = self._headed(self._sum(Place.LOOP))
        free = self._sum(Place.STRAIN)
        motion = self._headed(self._sum(Place.MOTION))
        chain = self._chain(self.command)
        reading = self._line(Place.OUTPUT, chain.position.value, chain.position.rate)
        law = self.moves.get(self.loop_state or "", ca.SX(0.0))
        if self.loop_state is not None:
            # A law that jumps along the drive has no rate for other effects to add to.
            if self.loop_state in self.moves:
                self.moves[self.loop_state] = self.moves[self.loop_state] + loop
            elif self.model.at(Place.LOOP):
                names = ", ".join(n for n, _ in self.model.at(Place.LOOP))
                raise ModelError(
                    f"{names}: the hysteresis law {self.model.loop} has no rate to add to; "
                    "use a differential law such as BoucWen()."
                )
        if not self.model.quasi_static and not self.model.at(Place.MOTION):
            raise ModelError(
                "The model has a position but nothing moves it: add SecondOrder() or Spring()."
            )

        values = {
            "drive": (self.drive.value, drive),
            "free": (self.free.value, self._headed(free, 0.0)),
            "hysteresis": (self.hysteresis, self._headed(self.remembered, 0.0)),
        }
        resolve_values = _in_order(values)
        total_rate = self._total_rate(resolve_values)
        rates = {
            "rate of the drive": (self.drive.rate, total_rate(drive)),
            "rate of the free displacement": (self.free.rate, total_rate(free)),
            "acceleration": (self.acceleration, resolve_values(motion / self.inertia)),
            "rate of the loop by its law": (self.law, resolve_values(law)),
        }
        if self.position_state is not None and self.velocity_state is None:
            if ca.depends_on(motion, self.velocity):
                raise ModelError(
                    f"{', '.join(n for n, _ in self.model.at(Place.MOTION))}: a force depends on "
                    "the velocity itself, which a spring without mass does not hold: take "
                    "SecondOrder() in the place of Spring()."
                )
            begins = _written(self.starts[self.position_state])
            self.starts[self.position_state] = self._balanced(motion, begins, 3)
            if self.becomes:  # plays, in whose turns the velocity jumps
                at = self.x[self.position_state]
                self.becomes[self.position_state] = self._balanced(motion, at, 1)
            rates["velocity"] = (self.velocity, resolve_values(self._massless(total_rate(motion))))
        for symbol, value in self.incoming_rates:
            rates[symbol.name()] = (symbol, total_rate(value))
        for name, symbol in self.dx.items():
            move = self.moves.get(name, ca.SX.zeros(symbol.numel(), 1))
            rates[f"rate of {name}"] = (symbol, resolve_values(move))
        resolve_rates = _in_order(rates)

        def resolve(expression: Expression) -> Expression:
            return resolve_rates(resolve_values(_written(expression)))

        x = ca.vertcat(*self.x.values()) if self.x else ca.SX(0, 1)
        c = ca.vertcat(*(s.value for s in self.channels.values())) if self.channels else ca.SX(0, 1)
        dc = ca.vertcat(*(s.rate for s in self.channels.values())) if self.channels else ca.SX(0, 1)
        p = ca.vertcat(*self.p.values()) if self.p else ca.SX(0, 1)
        instant = [self.time, x, self.command.value, self.command.rate, c, dc, p]
        dx = ca.vertcat(*self.dx.values()) if self.dx else ca.SX(0, 1)
        signals = ca.vertcat(
            self.drive.value, self.drive.rate, chain.hysteresis,
            self.free.value, self.free.rate, chain.position.value, chain.position.rate,
        )  # fmt: skip
        jump: ca.Function | None = None
        if self.becomes:
            after = ca.vertcat(*(self.becomes.get(n, s) for n, s in self.x.items()))
            # What is dragged by the drive needs its rate for derivatives by time only: to rounding
            # it is the same at any rate of the channels.
            after = ca.substitute(resolve(after), dc, ca.SX.zeros(dc.numel()))
            jump = ca.Function("po_becomes", [*instant[:5], p], [after])
        delay = sum(self.delays, ca.SX(0.0))
        return {
            "rate": ca.Function("po_rate", instant, [resolve(dx)]),
            "reading": ca.Function("po_reading", instant, [resolve(reading)]),
            "signals": ca.Function("po_signals", instant, [resolve(signals)]),
            "start": self._start(resolve_values, x, c, p),
            "becomes": jump,
            "delay": ca.Function("po_delay", [p], [delay]) if self.delays else None,
        }

    def _total_rate(
        self, resolve: Callable[[Expression], Expression]
    ) -> Callable[[Expression], Expression]:
        """Chain rule in time: states, command, channels and time itself all move."""
        arguments = [self.time, self.command.value, *self.x.values()]
        rates = [ca.SX(1.0), self.command.rate, *self.dx.values()]
        for signal in self.channels.values():
            arguments.append(signal.value)
            rates.append(signal.rate)

        def rate(value: Expression) -> Expression:
            moved = ca.jtimes(resolve(_written(value)), ca.vertcat(*arguments), ca.vertcat(*rates))
            return self._headed(moved)

        return rate

    def _balanced(self, motion: Expression, at: Expression, steps: int) -> Expression:
        """Where a balance without inertia is zero, by Newton's method.

        Forces are small beside the spring: three steps from the free displacement reach rounding.
        Behind plays the position is put back on its balance after each sub-step: the scheme misses
        the way to a play's contact, which would add up else. One step is enough for that.

        Args:
            motion: the balance, in terms of the position.
            at: where to begin.
            steps: of Newton's method.
        """
        symbol = self.x[self.position_state or ""]
        step = motion / ca.jacobian(_written(motion), symbol)
        for _ in range(steps):
            at = at - ca.substitute(step, symbol, at)
        return at

    def _massless(self, drift: Expression) -> Expression:
        """The velocity at which a balance without inertia stays at zero.

        The balance's derivative is a line in the velocity on either side of zero, where forces
        depend on the way and not on how fast it is gone; a spring makes it fall. Where it is bent
        (static friction) two steps of Newton's method follow.

        Args:
            drift: derivative of the balance by time, in terms of the states' rates.
        """
        moves = [self.moves.get(n, ca.SX.zeros(s.numel(), 1)) for n, s in self.dx.items()]
        rate = ca.substitute([_written(drift)], [*self.dx.values()], [*map(_written, moves)])[0]
        slope = ca.jacobian(rate, self.velocity)
        still = ca.substitute(rate, self.velocity, ca.SX(0.0))
        at = -still / ca.substitute(slope, self.velocity, ca.sign(still))
        bent = not ca.jacobian(slope, self.velocity).is_zero()
        for _ in range(2 if bent else 0):
            miss, steep = ca.substitute([rate, slope], [self.velocity], [at])
            at = at - miss / steep
        return at

    def _start(
        self, resolve: Callable[[Expression], Expression], x: ca.SX, c: ca.SX, p: ca.SX
    ) -> ca.Function:
        deviation = ca.SX.sym("deviation", x.numel())
        definitions: dict[str, tuple[Expression, Expression]] = {}
        offset = 0
        for name, symbol in self.x.items():
            size = symbol.numel()
            start = _written(self.starts.get(name, ca.SX.zeros(size, 1)))
            value = resolve(start) + deviation[offset : offset + size]
            definitions[f"start of {name}"] = (symbol, value)
            offset += size
        at_rest = _in_order(definitions)(x)
        signals = (self.command, self.drive, self.free, *self.channels.values())
        rates = (symbol for symbol, _ in self.incoming_rates)
        still = [
            *(s.rate for s in signals),
            *rates,
            *self.dx.values(),
            self.acceleration,
            self.velocity,
            self.law,
        ]
        at_rest = ca.substitute([at_rest], still, [ca.SX.zeros(s.shape) for s in still])[0]
        return ca.Function("po_start", [self.time, self.command.value, c, p, deviation], [at_rest])


def _written(value: Expression) -> ca.SX:
    """A value as an expression; one that is an expression is not copied, which takes far longer."""
    return value if isinstance(value, ca.SX) else ca.SX(value)


def _expression(name: str, what: str, value: Expression) -> ca.SX:
    """What an effect wrote, which may be something that is no expression."""
    try:
        return _written(value)
    except (NotImplementedError, TypeError, ValueError) as error:
        raise ModelError(
            f"{name}: equations() returned {value!r} as {what}: return a number or an expression."
        ) from error


def _signal(name: str) -> Signal:
    return Signal(ca.SX.sym(name), ca.SX.sym(f"rate_of_{name}"))


def _in_order(
    definitions: Mapping[str, tuple[Any, Any]],
) -> Callable[[Expression], Expression]:
    """A function that replaces every placeholder by its definition, in dependency order."""
    owners = {
        element.__hash__(): label
        for label, (symbol, _) in definitions.items()
        for element in ca.symvar(symbol)
    }

    def needed(expression: Expression) -> list[str]:
        found = (owners.get(e.__hash__()) for e in ca.symvar(expression))
        return list(dict.fromkeys(label for label in found if label is not None))

    needs = {label: needed(_written(value)) for label, (_, value) in definitions.items()}
    order: list[str] = []
    visiting: list[str] = []

    def visit(label: str) -> None:
        if label in order:
            return
        if label in visiting:
            circle = " -> ".join([*visiting[visiting.index(label) :], label])
            raise ModelError(
                f"The effects form an algebraic loop: {circle}; let one of them act through a "
                "state (a lag), and read what is upstream: on a line chain.incoming."
            )
        visiting.append(label)
        for need in needs[label]:
            visit(need)
        visiting.pop()
        order.append(label)

    for label in definitions:
        visit(label)
    closed: dict[str, Any] = {}

    def closing(expression: Expression, needs: Sequence[str]) -> Expression:
        if not needs:
            return expression
        symbols = [definitions[label][0] for label in needs]
        return ca.substitute([expression], symbols, [closed[label] for label in needs])[0]

    for label in order:
        closed[label] = ca.densify(closing(_written(definitions[label][1]), needs[label]))

    def resolve(expression: Expression) -> Expression:
        value = _written(expression)
        return closing(value, needed(value))

    return resolve
