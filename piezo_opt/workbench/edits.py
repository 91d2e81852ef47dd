"""What a click asks: one change of the model, as a question to solve and as a line of Python."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final, TypeAlias, final

from piezo_opt.choosing import is_number
from piezo_opt.errors import InputError, PiezoOptError

if TYPE_CHECKING:  # a page is there before effects and solvers are loaded
    from piezo_opt.effects import Effect, Model
    from piezo_opt.identification import Fit, Identification
    from piezo_opt.values import Values


@final
@dataclass(frozen=True)
class Add:
    """One effect more."""

    effect: Effect

    @property
    def title(self) -> str:
        """In a few words."""
        return f"add {self.effect.name}"

    def question(self, fit: Fit) -> Identification:
        """What is to be solved after a fit."""
        return fit.question.with_model(fit.model + self.effect)

    def code(self, fit: str) -> str:
        """The same as an expression, for a fit of that name."""
        return f"{fit}.question.with_model({fit}.model + {constructed(self.effect)})"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"effect": _written(self.effect)}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Add:
        """What :meth:`to_dict` gave."""
        return Add(_effect(data["effect"]))


@final
@dataclass(frozen=True)
class Remove:
    """One effect less."""

    name: str

    @property
    def title(self) -> str:
        """In a few words."""
        return f"remove {self.name}"

    def question(self, fit: Fit) -> Identification:
        """What is to be solved after a fit."""
        return fit.question.with_model(fit.model.without(self.name))

    def code(self, fit: str) -> str:
        """The same as an expression, for a fit of that name."""
        return f"{fit}.question.with_model({fit}.model.without({self.name!r}))"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"name": self.name}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Remove:
        """What :meth:`to_dict` gave."""
        return Remove(str(data["name"]))


@final
@dataclass(frozen=True)
class Exchange:
    """One effect in the place of another."""

    name: str
    effect: Effect

    @property
    def title(self) -> str:
        """In a few words."""
        return f"{self.effect.name} in the place of {self.name}"

    def question(self, fit: Fit) -> Identification:
        """What is to be solved after a fit."""
        return fit.question.with_model(fit.model.replaced(self.name, self.effect))

    def code(self, fit: str) -> str:
        """The same as an expression, for a fit of that name."""
        new = f"{self.name!r}, {constructed(self.effect)}"
        return f"{fit}.question.with_model({fit}.model.replaced({new}))"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"name": self.name, "effect": _written(self.effect)}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Exchange:
        """What :meth:`to_dict` gave."""
        return Exchange(str(data["name"]), _effect(data["effect"]))


@final
@dataclass(frozen=True)
class Fix:
    """A parameter kept at a value, in SI units."""

    name: str
    value: float

    @property
    def title(self) -> str:
        """In a few words."""
        return f"fix {self.name}"

    def question(self, fit: Fit) -> Identification:
        """What is to be solved after a fit."""
        asked = fit.question
        free = tuple(n for n in asked.free if n != self.name)
        return replace(asked, fixed={**asked.fixed, self.name: self.value}, free=free)

    def code(self, fit: str) -> str:
        """The same as an expression, for a fit of that name."""
        asked = f"{fit}.question"
        free = f"tuple(n for n in {asked}.free if n != {self.name!r})"
        fixed = f"{{**{asked}.fixed, {self.name!r}: {self.value!r}}}"
        return f"replace({asked}, fixed={fixed}, free={free})"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"name": self.name, "value": self.value}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Fix:
        """What :meth:`to_dict` gave."""
        return Fix(str(data["name"]), _number(data["value"]))


@final
@dataclass(frozen=True)
class Free:
    """A parameter that was kept is estimated."""

    name: str

    @property
    def title(self) -> str:
        """In a few words."""
        return f"free {self.name}"

    def question(self, fit: Fit) -> Identification:
        """What is to be solved after a fit."""
        asked = fit.question
        fixed = {n: v for n, v in asked.fixed.items() if n != self.name}
        return replace(asked, fixed=fixed, free=tuple(sorted({*asked.free, self.name})))

    def code(self, fit: str) -> str:
        """The same as an expression, for a fit of that name."""
        asked = f"{fit}.question"
        fixed = f"{{n: v for n, v in {asked}.fixed.items() if n != {self.name!r}}}"
        free = f"tuple(sorted({{*{asked}.free, {self.name!r}}}))"
        return f"replace({asked}, fixed={fixed}, free={free})"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"name": self.name}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Free:
        """What :meth:`to_dict` gave."""
        return Free(str(data["name"]))


@final
@dataclass(frozen=True)
class Bound:
    """Bounds of a parameter, in SI units."""

    name: str
    low: float
    high: float

    @property
    def title(self) -> str:
        """In a few words."""
        return f"bounds of {self.name}"

    def question(self, fit: Fit) -> Identification:
        """What is to be solved after a fit."""
        asked = fit.question
        return replace(asked, bounds={**asked.bounds, self.name: (self.low, self.high)})

    def code(self, fit: str) -> str:
        """The same as an expression, for a fit of that name."""
        asked = f"{fit}.question"
        pair = f"({self.low!r}, {self.high!r})"
        return f"replace({asked}, bounds={{**{asked}.bounds, {self.name!r}: {pair}}})"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"name": self.name, "low": self.low, "high": self.high}

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Bound:
        """What :meth:`to_dict` gave."""
        return Bound(str(data["name"]), _number(data["low"]), _number(data["high"]))


@final
@dataclass(frozen=True, eq=False)
class Adopt:
    """What a search has found: a model with its free parameters, begun from the values it had.

    A search that was cut short cannot be repeated; a solution from its values can.
    """

    model: Model
    free: tuple[str, ...]
    values: Mapping[str, float]

    @property
    def title(self) -> str:
        """In a few words."""
        return "find all"

    def question(self, fit: Fit) -> Identification:
        """What is to be solved after a fit."""
        return replace(fit.question.with_model(self.model), free=self.free)

    def start(self, _: Fit) -> Values:
        """Where it begins."""
        from piezo_opt.values import Values

        return Values(self.values)

    def code(self, fit: str) -> str:
        """The same as an expression, for a fit of that name."""
        effects = ", ".join(constructed(one) for _, one in self.model)
        return f"replace({fit}.question.with_model(po.Model.of({effects})), free={self.free!r})"

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "model": self.model.to_dict(), "free": list(self.free), "values": dict(self.values)
        }  # fmt: skip

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Adopt:
        """What :meth:`to_dict` gave."""
        from piezo_opt.effects.catalogue import model_from_dict

        values = {str(name): _number(value) for name, value in data["values"].items()}
        return Adopt(model_from_dict(data["model"]), tuple(map(str, data["free"])), values)


Edit: TypeAlias = Add | Remove | Exchange | Fix | Free | Bound | Adopt

_KINDS: Final = {k.__name__.lower(): k for k in (Add, Remove, Exchange, Fix, Free, Bound, Adopt)}


def begin(edit: Edit, fit: Fit) -> Values:
    """Where the solution of an edit begins: at the fit before it, or where a search ended."""
    return edit.start(fit) if isinstance(edit, Adopt) else fit.values


def begin_code(edit: Edit, fit: str) -> str:
    """The same as an expression."""
    return repr(dict(edit.values)) if isinstance(edit, Adopt) else fit


def edit_to_dict(edit: Edit) -> dict[str, Any]:
    """An edit as plain data."""
    return {"do": type(edit).__name__.lower(), **edit.to_dict()}


def edit_from_dict(data: Mapping[str, Any]) -> Edit:
    """What :func:`edit_to_dict` gave.

    Raises:
        InputError: it is something else.
    """
    kind = _KINDS.get(str(data.get("do"))) if isinstance(data, Mapping) else None
    if kind is None:
        raise InputError(f"There is no such step: there are {', '.join(_KINDS)}.")
    try:
        return kind.from_dict(data)
    except PiezoOptError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"The step {data['do']} lacks something or has it wrong: {error}."
        ) from None


def constructed(one: Effect) -> str:
    """An effect as an expression: ``effects.Creep(elements=2)``; usual options are left out."""
    usual = {f.name: f.default for f in fields(one)}  # type: ignore[arg-type]
    said = ", ".join(f"{k}={v!r}" for k, v in one.options.items() if v != usual.get(k))
    return f"effects.{type(one).__name__}({said})"


def _written(one: Effect) -> dict[str, Any]:
    return {"effect": one.name, **one.options}


def _effect(data: object) -> Effect:
    from piezo_opt.effects.catalogue import effect

    if isinstance(data, str):
        return effect(data)
    if not isinstance(data, Mapping) or not isinstance(data.get("effect"), str):
        raise InputError("An effect is named by its name.")
    options = {str(k): v for k, v in data.items() if k != "effect"}
    for option, value in options.items():
        if not isinstance(value, bool | int | float | str) or not _finite(value):
            raise InputError(f"The option {option!r} of {data['effect']} is no number or word.")
    return effect(data["effect"], **options)


def _finite(value: object) -> bool:
    return not isinstance(value, float) or math.isfinite(value)


def _number(value: object) -> float:
    if isinstance(value, bool) or not is_number(value):
        raise InputError(f"{value!r} is no finite number.")
    return float(value)  # type: ignore[arg-type]
