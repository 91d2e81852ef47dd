"""A law proposed for a correction, as text and as an effect.

    w = c_1 f_1 + c_2 f_2 + ...

each f a power, a root, a sign or a wave of one signal over its scale, or a product of two. How
the terms are found is told in ``propose``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from math import pi, prod
from types import SimpleNamespace
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.entering import Quantity, made_effect
from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.errors import InputError
from piezo_opt.symbolic import Expression, cos, sin, sqrt, tanh
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

_CORNER: Final = 0.01
"""Signal over its scale at which a sign is rounded, and the value of a root at 0: a solver needs a
slope there, and of a signal spread evenly over its scale one sample in a hundred is as near."""


class Shape(Enum):
    """A function of a signal over its scale, q."""

    LINEAR = "{0}"
    SQUARE = "{0}^2"
    CUBE = "{0}^3"
    SIZE = "|{0}|"
    SIGN = "sign({0})"
    SIGNED_SQUARE = "{0}|{0}|"
    ROOT = "|{0}|^0.5"
    SIGNED_ROOT = "sign({0})|{0}|^0.5"
    SINE = "sin({0})"
    COSINE = "cos({0})"

    @property
    def is_wave(self) -> bool:
        """Whether the scale is a wavelength over 2 pi, to be estimated."""
        return self in (Shape.SINE, Shape.COSINE)

    def of(self, q: Any, words: Any) -> Any:
        """Its value.

        Args:
            q: numbers (N,), or an expression.
            words: where its functions are: numpy, or those of ``piezo_opt.symbolic``.
        """
        return _LAWS[self](q, words)


_SYMBOLIC: Final = SimpleNamespace(sqrt=sqrt, tanh=tanh, sin=sin, cos=cos)


def _root(q: Any, words: Any) -> Any:
    return words.sqrt(words.sqrt(q * q + _CORNER**4))


_LAWS: Final[Mapping[Shape, Callable[[Any, Any], Any]]] = {
    Shape.LINEAR: lambda q, _: q,
    Shape.SQUARE: lambda q, _: q * q,
    Shape.CUBE: lambda q, _: q * q * q,
    Shape.SIZE: lambda q, _: abs(q),
    Shape.SIGN: lambda q, words: words.tanh(q / _CORNER),
    Shape.SIGNED_SQUARE: lambda q, _: q * abs(q),
    Shape.ROOT: _root,
    Shape.SIGNED_ROOT: lambda q, words: q / _root(q, words),
    Shape.SINE: lambda q, words: words.sin(q),
    Shape.COSINE: lambda q, words: words.cos(q),
}


@final
@dataclass(frozen=True)
class Factor:
    """A shape of one signal over its scale (SI)."""

    quantity: Quantity
    shape: Shape
    scale: float

    def __str__(self) -> str:
        if self.shape.is_wave:
            length = show(2.0 * pi * self.scale, self.quantity.unit)
            return self.shape.value.format(f"2 pi {self.quantity.value}/({length})")
        return self.shape.value.format(self.quantity.value.upper())


@final
@dataclass(frozen=True)
class Term:
    """A product of factors."""

    factors: tuple[Factor, ...]

    def __str__(self) -> str:
        return " ".join(str(f) for f in self.factors)

    @property
    def wave(self) -> Factor | None:
        """The factor whose scale is to be estimated; one at most."""
        return next((f for f in self.factors if f.shape.is_wave), None)

    def along(self, signals: Mapping[Quantity, FloatArray]) -> FloatArray:
        """Values (N,) along a trajectory."""
        values = (f.shape.of(signals[f.quantity] / f.scale, np) for f in self.factors)
        return np.asarray(prod(values), dtype=float)


@final
@dataclass(frozen=True)
class Formula:
    """A proposed law of the correction, in the unit of its place.

    Attributes:
        place: where it enters.
        terms: what it is made of.
        coefficients: of each term, in the place's unit.
        share: of what the noise does not explain, the part it explains, 0..1.
        rivals: other first terms that explain as much to within a standard error.
    """

    place: Place
    terms: tuple[Term, ...]
    coefficients: tuple[float, ...]
    share: float
    rivals: tuple[str, ...] = ()

    def __str__(self) -> str:
        sums = "".join(
            f" {'-' if c < 0 else '+'} {abs(c):.3g} {term}"
            for c, term in zip(self.coefficients, self.terms, strict=True)
        )
        scaled = dict.fromkeys(
            f", {f.quantity.value.upper()} = {f.quantity.value}/({show(f.scale, f.quantity.unit)})"
            for term in self.terms for f in term.factors if not f.shape.is_wave
        )  # fmt: skip
        return f"w [{self.place.unit}] = {sums.removeprefix(' + ').strip()}{''.join(scaled)}"

    def as_effect(self, name: str = "suspect") -> Effect:
        """The formula as an effect, to be added to a model: ``model + formula.as_effect()``.

        The gate ``size`` is the first coefficient (null 0); further terms keep their ratio to it
        in free parameters, wavelengths are free, scales are constants.

        Args:
            name: snake_case name of the effect.

        Raises:
            InputError: the name is no snake_case name.
        """
        if not name.isidentifier() or name != name.lower():
            raise InputError(f"'{name}' is no name of an effect: write it in snake_case.")
        return _effect(self, name)


@lru_cache(maxsize=64)
def _effect(formula: Formula, name: str) -> Effect:
    size, terms = formula.coefficients[0], tuple(enumerate(formula.terms, start=1))
    parameters = {"size": _near(formula.place.unit, "size of the first term", size, 3.0, null=0.0)}
    for k, term in terms:
        if k > 1:
            ratio = formula.coefficients[k - 1] / size
            parameters[f"ratio_{k}"] = _near("1", f"term {k} over the first", ratio, 3.0)
        if (wave := term.wave) is not None:
            parameters[_length(k, wave)] = _near(
                wave.quantity.unit, "wavelength over 2 pi", wave.scale, 1.1,
                bounds=(0.5 * wave.scale, 2.0 * wave.scale),
            )  # fmt: skip

    def equations(_: Effect, chain: Chain, __: Any, p: Any) -> Equations:
        total: Expression = chain.incoming.value if formula.place.is_line else 0.0
        for k, term in terms:
            value = p.size if k == 1 else p.size * getattr(p, f"ratio_{k}")
            for factor in term.factors:
                scale = getattr(p, _length(k, factor)) if factor.shape.is_wave else factor.scale
                signal = _read(chain, formula.place, factor.quantity)
                value = value * factor.shape.of(signal / scale, _SYMBOLIC)
            total = total + value
        return Equations(gives=total)

    return made_effect(
        "".join(part.capitalize() for part in name.split("_")), formula.place, parameters,
        __doc__=f"Proposed by the correction force.\n\n    {formula}\n",
        __reduce__=lambda _: (_effect, (formula, name)), equations=equations,
    )  # fmt: skip


def _length(k: int, wave: Factor) -> str:
    """Name of the wavelength of term k."""
    return f"length_{wave.quantity.name.lower()}" + f"_{k}" * (k > 1)


def _near(unit: str, meaning: str, value: float, factor: float, **more: Any) -> Parameter:
    """A parameter that is looked for within a factor of its value."""
    low, high = sorted((value / factor, value * factor))
    return Parameter(unit, meaning, nominal=value, typical=(low, high), **more)


def _read(chain: Chain, place: Place, quantity: Quantity) -> Expression:
    """A signal of the chain as an effect at this place reads it."""
    drive = chain.incoming if place is Place.INPUT else chain.drive
    return {
        Quantity.DRIVE: lambda: drive.value,
        Quantity.DRIVE_RATE: lambda: drive.rate,
        Quantity.HYSTERESIS: lambda: chain.hysteresis,
        Quantity.POSITION: lambda: chain.position.value,
        Quantity.VELOCITY: lambda: chain.position.rate,
        Quantity.TIME: lambda: chain.time,
    }[quantity]()
