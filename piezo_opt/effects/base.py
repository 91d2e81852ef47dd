"""What an effect is: a place in the chain, its states, its parameters, and one pure method.

The chain (DESIGN of the package)::

    command -- INPUT line [V] --> drive -- LOOP balance [m/s] --> hysteretic displacement
            -- STRAIN balance [m] --> free displacement -- MOTION balance [m/s2] --> position
            -- OUTPUT line [m] --> reading

On a *line* effects act one after another in the order written; on a *balance* contributions add
and their order cannot matter.
"""

from __future__ import annotations

import inspect
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import Enum
from functools import cache, cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, final

from piezo_opt.errors import ModelError
from piezo_opt.symbolic import Expression

if TYPE_CHECKING:
    from piezo_opt.effects.model import Model


_LARGEST = 100
"""Largest number of elements of a state: a guard against a slip of the keyboard."""


class Place(Enum):
    """Where in the chain an effect acts, in the order of the chain."""

    INPUT = "input line"
    LOOP = "loop balance"
    STRAIN = "strain balance"
    MOTION = "motion balance"
    OUTPUT = "output line"

    @property
    def is_line(self) -> bool:
        """Whether effects act one after another here (else their contributions add)."""
        return self in (Place.INPUT, Place.OUTPUT)

    @property
    def unit(self) -> str:
        """Unit of what an effect gives its place; V stands for the drive's unit."""
        return {"input line": "V", "loop balance": "m/s", "strain balance": "m",
                "motion balance": "m/s^2", "output line": "m"}[self.value]  # fmt: skip


@final
@dataclass(frozen=True)
class Parameter:
    """Declaration of one number of an effect, in SI units.

    Attributes:
        unit: SI unit in terms of m, s, V, K, rad; ``"1"`` for none, e.g. ``"m/V"``.
        meaning: what it is, in a few words.
        nominal: value used where the user gives none.
        bounds: physically possible range, (-inf, inf) where there is none.
        typical: range seen in practice: start values and search grids are drawn from it.
        null: on the gate of an optional effect: the value at which the effect vanishes.
        fixed: kept at its value unless the user frees it; folded into the compiled code unless an
            option gives it.
        detail: a fixed shape that one record in many can see (the roundness of a knee): a search
            for missing effects frees it where that pays, before it asks for another effect.
        per_record: a campaign estimates one value for every record.
        repeats: a length along the reading, after half of which what the effect does repeats: a
            search looks for it in the spectrum of what is left along the reading.
        coarse: a shape that hardly changes what the effect does: a search tries every second value.
        when, unless: name of an option of the effect (or several: any of them) with which, or
            without which, there is this parameter: effects of several forms declare those of all.
        freed: name of an option of the effect with which it is not fixed, but a shape as any other.
        given: name of an option of the effect that holds the nominal value in this one's place
            (the mains of a country): forms that differ in nothing else share their compiled code.
    """

    unit: str
    meaning: str
    nominal: float
    bounds: tuple[float, float] = (-float("inf"), float("inf"))
    typical: tuple[float, float] | None = None
    null: float | None = None
    fixed: bool = False
    detail: bool = False
    per_record: bool = False
    repeats: bool = False
    coarse: bool = False
    when: str | tuple[str, ...] = ()
    unless: str | tuple[str, ...] = ()
    freed: str = ""
    given: str = ""

    def __post_init__(self) -> None:
        low, high = self.bounds
        if self.detail and not self.fixed:
            raise ModelError(
                f"Parameter '{self.meaning}' is a detail and not fixed: declare fixed=True, "
                "a detail is freed only where that pays."
            )
        if not low < high or not low <= self.nominal <= high:
            raise ModelError(
                f"Parameter '{self.meaning}': nominal {self.nominal} is outside its bounds "
                f"{self.bounds}; declare bounds as (low, high) around the nominal value."
            )
        if self.null is not None and not low <= self.null <= high:
            raise ModelError(
                f"Parameter '{self.meaning}': null {self.null} is outside its bounds {self.bounds}."
            )

    @property
    def scale(self) -> float:
        """A positive size of the parameter, by which solvers scale it."""
        if self.typical is not None:
            size = max(abs(self.typical[0]), abs(self.typical[1]))
        else:
            size = abs(self.nominal)
        return size if size > 0 else 1.0


@final
@dataclass(frozen=True)
class State:
    """Declaration of one state (or a column of ``size`` equal ones) of an effect.

    Attributes:
        unit: SI unit.
        meaning: what it is, in a few words.
        size: number of elements, or the name of the effect's option that holds it.
        loop: the hysteretic displacement itself, whose rate the LOOP balance adds to.
        position: the position of the mechanics; a chain without one is quasi-static.
        velocity: the velocity of the mechanics.
        remanent: a record may begin with this state away from rest (memory of what was before).
        relaxing: its rest is the whole displacement, and it may begin anywhere in that.
        trailing: it follows a signal at a short distance, at which a record that is cut out of a
            motion begins, unless mechanics behind it take that up; soon forgotten, and not counted
            where models are compared.
        when, unless: name of an option of the effect (or several) with which, or without which,
            there is this state.
    """

    unit: str
    meaning: str
    size: int | str = 1
    loop: bool = False
    position: bool = False
    velocity: bool = False
    remanent: bool = False
    relaxing: bool = False
    trailing: bool = False
    when: str | tuple[str, ...] = ()
    unless: str | tuple[str, ...] = ()


@final
@dataclass(frozen=True)
class Signal:
    """A signal of the chain and its time derivative."""

    value: Expression
    rate: Expression


@final
@dataclass(frozen=True)
class Chain:
    """What an effect may read. Signals are upstream of its place; states are free to read.

    Attributes:
        time: time of the record [s].
        command: the recorded drive [V] and its rate.
        incoming: on a line: the signal as the effect before left it.
        drive: end of the INPUT line [V].
        hysteresis: the hysteretic displacement h of the model's loop [m] (0 without one).
        law: the rate of h by its own law [m/s], before the LOOP balance adds to it.
        free: free displacement s, the sum of the STRAIN balance [m], and its rate.
        position: position x [m] and velocity x' [m/s]; equal to ``free`` when quasi-static.
        acceleration: x'' [m/s^2]: the MOTION balance; only for rates of states.
        channels: further recorded channels by name, e.g. ``"temperature"`` [K].
    """

    time: Expression
    command: Signal
    incoming: Signal
    drive: Signal
    hysteresis: Expression
    law: Expression
    free: Signal
    position: Signal
    acceleration: Expression
    channels: Mapping[str, Signal]


@final
@dataclass(frozen=True)
class Equations:
    """What an effect gives its place and how its own states move.

    Attributes:
        gives: on a balance, what is added; on a line, the outgoing signal.
        moves: time derivative of each own state, by name.
        starts: value of own states at rest at the start of a record (0 where not named).
        becomes: states that jump instead of flowing: their value after a monotone stretch of
            the drive, from their value before and the signals at its end (play operators).
        delays: seconds by which the whole chain lags the command (only ``Delay``).
        inertia: mass that the position carries, over the mass the MOTION balance is written for:
            the balance is divided by one plus the sum of them (only ``LoadMass``).
    """

    gives: Expression
    moves: Mapping[str, Expression] = field(default_factory=dict)
    starts: Mapping[str, Expression] = field(default_factory=dict)
    becomes: Mapping[str, Expression] = field(default_factory=dict)
    delays: Expression = 0.0
    inertia: Expression = 0.0


class Symbols(SimpleNamespace):
    """Own symbols of an effect by attribute: ``p.alpha``, ``x.h``."""

    def __getattr__(self, name: str) -> Expression:
        raise ModelError(f"'{name}' is not declared in the effect's class body.")


class Effect(ABC):
    """A small final class: place, states, parameters, and :meth:`equations`.

    Subclasses are ``@final @dataclass(frozen=True)``; annotated fields are structural options
    (for instance the number of elements of a chain), everything else is declared with
    :class:`Parameter` and :class:`State`.
    """

    structural: ClassVar[bool] = False
    """Structural effects make up the base model and need no gate."""
    variants: ClassVar[tuple[Mapping[str, Any], ...]] = ({},)
    """Options under which a search tries the effect; none: only where it is offered."""
    rarer: ClassVar[tuple[str, ...]] = ()
    """Options of rarer forms: tried as well, but scores are told of the usual ones."""
    reshaped: ClassVar[tuple[str, ...]] = ()
    """Options of forms that hold a simpler effect and would enter in its place: they are tried only
    in the place of another form that has entered."""

    redundant: ClassVar[int] = 0
    """Parameters beyond the numbers that act; what counts parameters does not count these."""

    _parameters: ClassVar[Mapping[str, Parameter]]
    _states: ClassVar[Mapping[str, State]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        body = cls.__dict__
        cls._parameters = {k: v for k, v in body.items() if isinstance(v, Parameter)}
        cls._states = {k: v for k, v in body.items() if isinstance(v, State)}
        if not isinstance(body.get("place"), Place | property):
            raise ModelError(
                f"Effect {cls.__name__} declares no place: write place = Place.STRAIN."
            )
        options = [
            *(
                (f"parameter '{name}'", option, option == p.given)
                for name, p in cls._parameters.items()
                for option in (*_names(p.when), *_names(p.unless), p.freed, p.given)
            ),
            *(
                (f"state '{name}'", option, False)
                for name, s in cls._states.items()
                for option in (s.when, s.unless)
            ),
        ]
        for member, option, number in options:
            if option and option not in body.get("__annotations__", {}):
                raise ModelError(
                    f"Effect {cls.__name__}: the {member} depends on the option '{option}', which "
                    f"is not declared: write {option}: "
                    f"{'float = ...' if number else 'bool = False'}."
                )
        gates = {k: v for k, v in cls._parameters.items() if v.null is not None}
        always = [k for k, v in gates.items() if not v.when and not v.unless]
        if not cls.structural and (not gates or len(always) > 1):
            raise _miscounted(cls.__name__, list(gates))

    def __post_init__(self) -> None:
        for name, size in self.states.items():
            if not isinstance(size, int) or isinstance(size, bool) or not 1 <= size <= _LARGEST:
                raise ModelError(
                    f"{self.name}: the number of elements of '{name}' is {size!r}; give a whole "
                    f"number from 1 to {_LARGEST}."
                )
        for p in (p for p in self._parameters.values() if p.given):
            given, (low, high) = getattr(self, p.given), p.bounds
            number = isinstance(given, (int, float)) and not isinstance(given, bool)
            if not number or not low <= given <= high:
                raise ModelError(
                    f"{self.name}: the option '{p.given}' is {given!r}; give the {p.meaning} as a "
                    f"number from {low:g} to {high:g} {p.unit}."
                )
        gates = [k for k, v in self.parameters.items() if v.null is not None]
        if not self.structural and len(gates) != 1:
            raise _miscounted(f"{self!r}", gates)

    @property
    @abstractmethod
    def place(self) -> Place:
        """Where in the chain it acts: ``place = Place.STRAIN``, or by the form it has."""

    @property
    def requires(self) -> tuple[str, ...]:
        """What the chain must hold: ``"loop"``, ``"motion"`` or ``"channel:NAME"``."""
        return ()

    @abstractmethod
    def equations(self, chain: Chain, x: Any, p: Any) -> Equations:
        """The physics: read ``chain``, own states ``x`` and parameters ``p``; no side effects."""

    def like(self, other: str, own: Mapping[str, float]) -> Mapping[str, float] | None:
        """Own values with which this effect does what another one does; None where it cannot.

        Args:
            other: name of the other effect.
            own: its values, by its own parameter names.
        """
        del other, own
        return None

    def finer(self, own: Mapping[str, float]) -> tuple[Effect, Mapping[str, float]]:
        """The same effect written in more detail, and values to begin with; itself by default.

        Args:
            own: values by own parameter names.
        """
        del own
        return self, {}

    @property
    def name(self) -> str:
        """The snake_case name that commands, JSON and tables use."""
        return _snake_case(type(self).__name__)

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        """Declared parameters of this form by name, in the order written."""
        return {
            k: self._formed(p)
            for k, p in self._parameters.items()
            if (not p.when or self._has(p.when)) and not self._has(p.unless)
        }

    def _has(self, options: str | tuple[str, ...]) -> bool:
        """Whether any of these options is set."""
        return any(getattr(self, option) for option in _names(options))

    def _formed(self, parameter: Parameter) -> Parameter:
        """A parameter as this form has it."""
        if parameter.freed and getattr(self, parameter.freed):
            parameter = replace(parameter, fixed=False, detail=False)
        if parameter.given:
            parameter = replace(parameter, nominal=getattr(self, parameter.given))
        return parameter

    @cached_property
    def states(self) -> Mapping[str, int]:
        """Number of elements of each declared state, by name, in the order written."""
        return {
            name: (getattr(self, s.size) if isinstance(s.size, str) else s.size)
            for name, s in self.declared_states.items()
        }

    @cached_property
    def declared_states(self) -> Mapping[str, State]:
        """Declarations of this form's states by name."""
        return {
            name: state
            for name, state in self._states.items()
            if (not state.when or self._has(state.when)) and not self._has(state.unless)
        }

    @property
    def gate(self) -> str | None:
        """Name of the parameter whose null value makes the effect vanish; None if structural."""
        return next((k for k, v in self.parameters.items() if v.null is not None), None)

    @property
    def details(self) -> tuple[str, ...]:
        """Names of the parameters that a diagnosis frees where the record pays for it."""
        return tuple(k for k, v in self.parameters.items() if v.detail)

    @classmethod
    def check_frozen(cls) -> None:
        """Refuse a class that is no frozen dataclass: effects are compared by their options.

        Raises:
            ModelError: names the two lines that are missing.
        """
        declared = cls.__dict__.get("__dataclass_params__")
        if declared is None or not declared.frozen:
            raise ModelError(
                f"Effect {cls.__name__} is no frozen dataclass: write @final and "
                "@dataclass(frozen=True) above the class."
            )

    @classmethod
    def entries(cls) -> tuple[Effect, ...]:
        """The forms in which a search lets the effect enter."""
        cls.check_frozen()
        written: Any = cls
        forms = [written(**options) for options in cls.variants]
        return tuple(form for form in forms if not form.holds_another)

    @property
    def holds_another(self) -> bool:
        """Whether this is one of the forms that hold a simpler effect."""
        return self._has(self.reshaped)

    @property
    def rare(self) -> bool:
        """Whether this is one of the effect's rarer forms."""
        return self._has(self.rarer)

    @property
    def options(self) -> dict[str, Any]:
        """Structural options (the dataclass fields) by name."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]

    @property
    def summary(self) -> str:
        """First line of the docstring."""
        return (inspect.getdoc(type(self)) or "").split("\n", 1)[0]

    @property
    def equation(self) -> str:
        """The indented block of the docstring, as printed: the equation of this form.

        A line that ends in three spaces and the name of an option holds with that option, in the
        place of those without one.
        """
        lines = (inspect.getdoc(type(self)) or "").splitlines()[1:]
        block: list[str] = []
        for line in lines:
            if line.startswith("    "):
                block.append(line.strip())
            elif line.strip() and block:
                break
        chosen = {option for option, value in self.options.items() if value is True}
        forms: dict[str, list[str]] = {}
        for line in block:
            body, _, option = line.rpartition("   ")
            tagged = option in self.options
            forms.setdefault(option if tagged else "", []).append(body.rstrip() if tagged else line)
        form = next((option for option in forms if option in chosen), "")
        return "\n".join(forms.get(form, ()))

    def __add__(self, other: Effect | Model) -> Model:
        from piezo_opt.effects.model import Model

        return Model.of(self) + other


@cache
def _snake_case(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def _names(options: str | tuple[str, ...]) -> tuple[str, ...]:
    return (options,) if isinstance(options, str) else options


def _miscounted(effect: str, gates: list[str]) -> ModelError:
    return ModelError(
        f"Effect {effect} has {len(gates)} gates ({', '.join(gates) or 'none'}); "
        "an optional effect has exactly one parameter with a null value."
    )
