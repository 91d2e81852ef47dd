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
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.diagnosis.entering import Quantity
from piezo_opt.effects.base import Chain, Effect, Equations, Parameter, Place
from piezo_opt.errors import InputError
from piezo_opt.symbolic import Expression, abs_, cos, sin, sqrt, tanh
from piezo_opt.units import show

FloatArray = NDArray[np.float64]

_CORNER: Final = 1e-3
"""Signal over its scale below which roots are rounded: their slope is infinite at 0."""
_STEEP: Final = 50.0
"""Steepness of a sign, likewise."""


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

    def numbers(self, q: FloatArray) -> FloatArray:
        """Values on numbers."""
        return np.asarray(_write(self, q, _NUMBERS), dtype=float)

    def symbols(self, q: Expression) -> Expression:
        """The same as an expression."""
        return _write(self, q, _SYMBOLS)


@final
@dataclass(frozen=True)
class _Words:
    absolute: Callable[[Any], Any]
    root: Callable[[Any], Any]
    sine: Callable[[Any], Any]
    cosine: Callable[[Any], Any]
    soft: Callable[[Any], Any]


_NUMBERS: Final = _Words(np.abs, np.sqrt, np.sin, np.cos, np.tanh)
_SYMBOLS: Final = _Words(abs_, sqrt, sin, cos, tanh)


def _write(shape: Shape, q: Any, words: _Words) -> Any:
    if shape is Shape.LINEAR:
        return q
    if shape is Shape.SQUARE:
        return q * q
    if shape is Shape.CUBE:
        return q * q * q
    if shape is Shape.SIZE:
        return words.absolute(q)
    if shape is Shape.SIGN:
        return words.soft(_STEEP * q)
    if shape is Shape.SIGNED_SQUARE:
        return q * words.absolute(q)
    if shape is Shape.SINE:
        return words.sine(q)
    if shape is Shape.COSINE:
        return words.cosine(q)
    # (q^2 + corner^2)^(1/4) is the root of |q| with its corner rounded.
    root = words.root(words.root(q * q + _CORNER**2))
    return root if shape is Shape.ROOT else q / root


@final
@dataclass(frozen=True)
class Factor:
    """A shape of one signal over its scale (SI)."""

    quantity: Quantity
    shape: Shape
    scale: float

    def __str__(self) -> str:
        if self.shape.is_wave:
            length = show(2.0 * np.pi * self.scale, self.quantity.unit)
            return f"{self.shape.name.lower()[:3]}(2 pi {self.quantity.value}/({length}))"
        return self.shape.value.format(self.letter)

    @property
    def letter(self) -> str:
        """Sign of the signal over its scale."""
        return self.quantity.value.upper()


@final
@dataclass(frozen=True)
class Term:
    """A product of factors."""

    factors: tuple[Factor, ...]

    def __str__(self) -> str:
        return " ".join(str(f) for f in self.factors)

    @property
    def unknowns(self) -> int:
        """Numbers that the term costs."""
        return 1 + sum(f.shape.is_wave for f in self.factors)

    def along(self, signals: Mapping[Quantity, FloatArray]) -> FloatArray:
        """Values (N,) along a trajectory."""
        first = next(iter(signals.values()))
        value = np.ones_like(first)
        for factor in self.factors:
            value = value * factor.shape.numbers(signals[factor.quantity] / factor.scale)
        return value


@final
@dataclass(frozen=True)
class Formula:
    """A proposed law of the correction, in the unit of its place.

    Attributes:
        place: where it enters.
        terms: what it is made of.
        coefficients: of each term, in the place's unit.
        share: of what the noise does not explain, the part it explains, 0..1.
        rivals: other first terms that explain as much to within 2 %.
    """

    place: Place
    terms: tuple[Term, ...]
    coefficients: tuple[float, ...]
    share: float
    rivals: tuple[str, ...] = ()

    def __str__(self) -> str:
        parts = []
        for k, (c, term) in enumerate(zip(self.coefficients, self.terms, strict=True)):
            sign = "-" if c < 0 else ("+" if k else "")
            parts.append(f"{sign} {abs(c):.3g} {term}".strip())
        scaled = dict.fromkeys(
            f"{f.letter} = {f.quantity.value}/({show(f.scale, f.quantity.unit)})"
            for term in self.terms
            for f in term.factors
            if not f.shape.is_wave
        )
        where = f", {', '.join(scaled)}" if scaled else ""
        return f"w [{self.place.unit}] = {' '.join(parts)}{where}"

    def as_effect(self, name: str = "suspect") -> Effect:
        """The formula as an effect, to be added to a model: ``model + formula.as_effect()``.

        The gate ``size`` is the first coefficient (null 0); further terms keep their ratio to it
        in free parameters, wavelengths are free, scales are fixed.

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
    keys = _keys(formula)

    def equations(_: Effect, chain: Chain, __: Any, p: Any) -> Equations:
        total: Expression = 0.0
        for k, term in enumerate(formula.terms):
            value: Expression = p.size if k == 0 else p.size * getattr(p, f"ratio_{k + 1}")
            for factor in term.factors:
                scaled = _read(chain, formula.place, factor.quantity) / getattr(
                    p, keys[_scale_of(factor)]
                )
                value = value * factor.shape.symbols(scaled)
            total = total + value
        before = chain.incoming.value if formula.place.is_line else 0.0
        return Equations(gives=before + total)

    size = formula.coefficients[0]
    body: dict[str, Any] = {
        "__doc__": f"Proposed by the correction force.\n\n    {formula}\n",
        "__module__": "made_at_run_time",  # it stands in no file and in no catalogue
        "__reduce__": lambda _: (_effect, (formula, name)),
        "place": formula.place,
        "requires": {Place.LOOP: ("loop",), Place.MOTION: ("motion",)}.get(formula.place, ()),
        "equations": equations,
        "size": Parameter(
            formula.place.unit, "size of the first term", nominal=size,
            typical=(0.3 * size, 3.0 * size) if size > 0 else (3.0 * size, 0.3 * size), null=0.0,
        ),
    }  # fmt: skip
    for k, c in enumerate(formula.coefficients[1:], start=2):
        ratio = c / size
        body[f"ratio_{k}"] = Parameter(
            "1", f"term {k} over the first", nominal=ratio,
            typical=(min(0.3 * ratio, 3.0 * ratio), max(0.3 * ratio, 3.0 * ratio)),
        )  # fmt: skip
    for factor in (f for term in formula.terms for f in term.factors):
        wave, scale = factor.shape.is_wave, factor.scale
        body[keys[_scale_of(factor)]] = Parameter(
            factor.quantity.unit,
            "wavelength over 2 pi" if wave else f"scale of {factor.quantity.value}",
            nominal=scale, bounds=(0.5 * scale, 2.0 * scale) if wave else (1e-30, 1e30),
            typical=(0.9 * scale, 1.1 * scale) if wave else None, fixed=not wave,
        )  # fmt: skip
    title = "".join(part.capitalize() for part in name.split("_"))
    kind: Any = dataclass(frozen=True)(type(title, (Effect,), body))
    made: Effect = kind()
    return made


def _scale_of(factor: Factor) -> tuple[Quantity, bool, float]:
    return factor.quantity, factor.shape.is_wave, factor.scale


def _keys(formula: Formula) -> dict[tuple[Quantity, bool, float], str]:
    """A name for the parameter of each different scale: ``scale_drive``, ``length_position_2``."""
    keys: dict[tuple[Quantity, bool, float], str] = {}
    for scale in (_scale_of(f) for term in formula.terms for f in term.factors):
        if scale not in keys:
            quantity, wave, _ = scale
            stem = f"{'length' if wave else 'scale'}_{quantity.name.lower()}"
            taken = sum(name.startswith(stem) for name in keys.values())
            keys[scale] = stem if not taken else f"{stem}_{taken + 1}"
    return keys


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
