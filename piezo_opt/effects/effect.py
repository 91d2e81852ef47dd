"""An effect: declarations and one pure method."""

from __future__ import annotations

import inspect
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import fields, replace
from functools import cache, cached_property
from typing import Any, ClassVar

from piezo_opt.effects.chain import Chain, Equations
from piezo_opt.effects.declare import Parameter, Place, State
from piezo_opt.effects.model import Model
from piezo_opt.errors import ModelError

_LARGEST = 100
"""Largest number of elements of a state: a guard against a slip of the keyboard."""


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
    elsewhere: ClassVar[tuple[Mapping[str, float], ...]] = ()
    """Details, by name, from which a fit begins as well: those along which its error has several
    minima."""
    rarer: ClassVar[tuple[str, ...]] = ()
    """Options of rarer forms: tried as well, but scores are told of the usual ones."""
    reshaped: ClassVar[tuple[str, ...]] = ()
    """Options of forms that hold a simpler effect and would enter in its place: they are tried only
    in the place of another form that has entered, or of that effect."""

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
                for option in (*_names(s.when), *_names(s.unless))
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
        """What the chain must hold: ``"loop"``, ``"hysteresis"``, ``"motion"`` or
        ``"channel:NAME"``."""
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
    def is_hysteresis_law(self) -> bool:
        """Whether it is what the strain remembers."""
        return self.structural and self.place is Place.STRAIN and bool(self.states)

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
    def forms(self) -> tuple[Effect, ...]:
        """The effect in each form under which a search tries it, its other options as they are."""
        # A form is what its options say, and what the others of the forms' options are by default.
        asked = {option for options in self.variants for option in options}
        kept = {option: value for option, value in self.options.items() if option not in asked}
        written: Any = type(self)
        return tuple(written(**kept, **options) for options in self.variants)

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
