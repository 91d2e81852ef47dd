"""The functions of all effects, compiled once into one library, and those of a user's own effect.

The library of the catalogue is built where its functions are asked for first: a form of an effect
is a few small functions, written out in several texts that are compiled side by side. It is kept
by the hash of all that it follows from, and holds the description of its functions itself. Forms
that are in no catalogue (an own effect, an unusual number of elements) get a small library each.
"""

from __future__ import annotations

import ctypes
import json
import platform
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import metadata, resources
from typing import Any, Final, final

import casadi as ca

from piezo_opt.assembly import ORIGIN
from piezo_opt.effects.base import Effect, Place
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.keeping import digest
from piezo_opt.simulation.compiler import find_compiler, load
from piezo_opt.simulation.compose import PRODUCT, QUOTIENT, SIGN, SUMS, WEIGHTS
from piezo_opt.simulation.exponential import weights
from piezo_opt.simulation.forms import (
    Form,
    Part,
    Term,
    Written,
    changeable,
    common,
    with_slopes,
    written,
)
from piezo_opt.simulation.functions import c_functions
from piezo_opt.simulation.powers import POWERS
from piezo_opt.symbolic import one_at_a_time

WRITERS: Final = (
    "core.h", "core.c", "machine.h", "assembler.h", "exponential.py", "forms.py",
    "functions.py", "instructions.py", "emit.py", "powers.py", "library.py",
)  # fmt: skip
"""Files of this folder that a library follows from."""
_NAMELESS: Final = "po_nameless_"
"""Begins the symbols of a library while its text, of which its name is made, is not known yet."""
_TEXT: Final = 60_000
"""Letters of one text: some tenths of a second of a compiler."""

MACHINE: Final = platform.machine() in ("x86_64", "AMD64") and sys.platform != "win32"
"""Whether machine code can be made of whole sub-steps (see machine.h)."""
_EFFORTS: Final = ("O1", "O2")
"""Of the compiler, for effects and core, where machine code is made: the functions themselves are
called but once a run then, and two thirds of its time are saved."""

Address = tuple[int, int, int]
"""Of a function's preparation, of the function, and of its words."""


@final
@dataclass(frozen=True, eq=False)
class Functions:
    """Functions in memory.

    Attributes:
        form: the form that they are of.
        addresses: of the two functions of every symbol, without and with derivatives.
    """

    form: Form
    addresses: Mapping[str, tuple[Address, Address]]


@final
class Library:
    """A loaded library of functions, with the forms that they are of."""

    def __init__(self, loaded: ctypes.CDLL) -> None:
        self.loaded = loaded
        text = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(loaded, "po_forms")))
        self._told: dict[str, Any] = json.loads(text)
        self._functions: dict[str, Functions] = {}

    def __contains__(self, key: str) -> bool:
        return key in self._told

    def functions(self, key: str) -> Functions:
        """Those of a form."""
        if key not in self._functions:
            form = _form(self._told[key])
            found = {p.symbol: self.address(p.symbol) for p in form.parts.values()}
            self._functions[key] = Functions(form, found)
        return self._functions[key]

    def address(self, symbol: str) -> tuple[Address, Address]:
        """Where a function is."""
        return addresses(self.loaded, symbol)


def addresses(loaded: ctypes.CDLL, symbol: str) -> tuple[Address, Address]:
    """Where the two functions of a symbol are, without and with derivatives."""
    three = ctypes.c_void_p * 3
    plain, moved = (three.in_dll(loaded, f"{symbol}_{end}_f") for end in "pm")
    return (
        (plain[0] or 0, plain[1] or 0, plain[2] or 0),
        (moved[0] or 0, moved[1] or 0, moved[2] or 0),
    )


def catalogue() -> Library | None:
    """The library of all effects of the catalogue; None where it cannot be built."""
    compiler = find_compiler()
    return None if compiler is None else _catalogue_of(compiler)


@cache
def _catalogue_of(_compiler: str) -> Library | None:
    loaded = load(origin(), _write_catalogue, _Progress().say)
    return None if loaded is None else Library(loaded)


def functions_of(effect: Effect, runtime: frozenset[str]) -> Functions | None:
    """The functions of an effect; None where they cannot be had.

    Args:
        effect: with its options.
        runtime: fixed parameters that have to be changeable.

    Raises:
        ModelError: as :func:`piezo_opt.simulation.forms.written`.
    """
    library = catalogue()
    if library is None:
        return None
    form = common(effect)
    wanted = runtime & changeable(form)
    known = type(form)
    if CATALOGUE.get(form.name) is known:
        for some in _choices(form):
            if wanted <= some and (key := _key(form, some)) in library:
                return library.functions(key)
    own = _own(form, wanted)
    return None if own is None else own.functions("own")


@lru_cache(maxsize=512)
@one_at_a_time
def _own(form: Effect, runtime: frozenset[str]) -> Library | None:
    """A small library of one form."""
    text = _texts({"own": (form, runtime)}, {}, _NAMELESS)
    # Every library has symbols of its own: a model may hold effects of several.
    known = digest("".join(text.values()).encode())[:16]
    text = {name: said.replace(_NAMELESS, f"po_{known}_") for name, said in text.items()}
    loaded = load("".join(text.values()), lambda _: text)
    return None if loaded is None else Library(loaded)


def _key(form: Effect, runtime: frozenset[str]) -> str:
    # Equations that have been replaced are not those of the catalogue.
    code = type(form).equations.__code__.co_code
    return f"{form!r} {sorted(runtime)} {digest(code)}"


def _choices(form: Effect) -> list[frozenset[str]]:
    """Sets of fixed parameters that a form of the catalogue can have changed; smallest first.

    All of a force but its times are one, for a spring without mass: a time makes a force follow the
    velocity, which that does not hold.
    """
    every = changeable(form)
    found = {frozenset[str](), every, *(frozenset([one]) for one in every)}
    if form.place is Place.MOTION:
        found.add(frozenset(k for k in every if form.parameters[k].unit != "s"))
    return sorted(found, key=lambda some: (len(some), sorted(some)))


def _catalogue_forms() -> Iterator[tuple[str, tuple[Effect, frozenset[str]]]]:
    """Every form that a search tries, and the finer ones that it goes on to."""
    seen: set[Effect] = set()
    for kind in CATALOGUE.values():
        plain: Any = kind
        forms: list[Effect] = [plain(), *(plain(**options) for options in kind.variants)]
        for form in list(forms):
            values = {name: p.nominal for name, p in form.parameters.items()}
            forms.append(form.finer(values)[0])
        for form in map(common, forms):
            if form not in seen:
                seen.add(form)
                for some in _choices(form):
                    yield _key(form, some), (form, some)


@one_at_a_time
def _write_catalogue(_: str) -> Mapping[str, str]:
    return _texts(dict(_catalogue_forms()), _shared())


def _texts(
    forms: Mapping[str, tuple[Effect, frozenset[str]]],
    shared: Mapping[str, Written],
    prefix: str = "po_",
) -> dict[str, str]:
    """C texts of forms by file name, the head that they include among them."""
    told: dict[str, Any] = {}
    pieces: list[str] = []
    for number, (key, (effect, runtime)) in enumerate(forms.items()):
        form, functions = written(effect, runtime)
        parts: dict[str, Part] = {}
        for kind, function in functions.items():
            symbol = f"{prefix}{number}_{len(parts)}"
            text, kept = c_functions(symbol, function)
            pieces.append(text)
            parts[kind] = replace(form.parts[kind], symbol=symbol, kept=kept)
        told[key] = _told(replace(form, parts=parts))
    pieces += [
        c_functions(symbol, function, symbol == SIGN)[0] for symbol, function in shared.items()
    ]
    units = {f"unit_{i}.c": '#include "head.h"\n' + text for i, text in enumerate(_packed(pieces))}
    known = json.dumps(json.dumps(told, separators=(",", ":")))
    units["forms.c"] = f"const char po_forms[] = {known};\n"
    if shared:
        units["core.c"] = _effort(1) + _file("core.c")
        units |= {name: _file(name) for name in ("machine.h", "assembler.h")}
    return {**head(), **dict(sorted(units.items()))}


def head() -> dict[str, str]:
    """What the texts of functions include, by file name."""
    return {"core.h": _file("core.h"), "head.h": _effort(0) + declarations()}


def declarations() -> str:
    """C text of what the functions are written with."""
    return _file("core.h") + POWERS


def _packed(pieces: Iterable[str]) -> Iterator[str]:
    """Texts of some length each."""
    text = ""
    for piece in pieces:
        text += piece
        if len(text) > _TEXT:
            yield text
            text = ""
    if text:
        yield text


def _shared() -> dict[str, Written]:
    """The weights of linear blocks as functions of their matrix and the length of a sub-step, and
    the sign of a number."""
    one = ca.SX.sym("z")
    found = {SIGN: with_slopes(ca.sign(one), ca.SX(0, 1), one)}
    for size, symbol in enumerate(WEIGHTS, start=1):
        entries, h = ca.SX.sym("L", size * size), ca.SX.sym("h")
        matrix = ca.reshape(entries, size, size).T
        by = weights(matrix, h)
        parts = (by.half, by.half_input, by.whole, by.first, by.middle, by.last)
        column = ca.vertcat(*(ca.reshape(part.T, -1, 1) for part in map(ca.densify, parts)))
        found[symbol] = with_slopes(column, ca.SX(0, 1), ca.vertcat(entries, h))
    return found


def _told(form: Form) -> dict[str, Any]:
    """A form as plain data."""

    def term(one: Term) -> list[Any]:
        return [one.kind, one.name, one.value, one.index]

    def columns(of: Mapping[str, Sequence[Term]]) -> dict[str, Any]:
        return {k: [term(one) for one in terms] for k, terms in of.items()}

    def part(one: Part) -> list[Any]:
        linear = [{n: term(t) for n, t in of.items()} for of in one.linear]
        return [one.inputs, one.outputs, one.needs, linear, one.bends, one.symbol, one.kept]

    parts = {k: part(one) for k, one in form.parts.items()}
    single = {k: term(getattr(form, k)) for k in _SINGLE}
    many = {k: columns(getattr(form, k)) for k in _COLUMNS}
    return {"parts": parts, **single, **many, "settled": form.settled}


_SINGLE: Final = ("gives", "rate", "inertia", "delays")
_COLUMNS: Final = ("moves", "starts", "becomes", "massless")


def _form(told: Mapping[str, Any]) -> Form:
    """The form of such data."""
    parts = {
        k: Part(
            tuple(inputs), outputs, tuple(tuple(one) for one in needs),
            tuple({n: Term(*t) for n, t in one.items()} for one in linear),
            tuple(tuple(one) for one in bends), symbol, tuple(kept),
        )
        for k, (inputs, outputs, needs, linear, bends, symbol, kept) in told["parts"].items()
    }  # fmt: skip
    gives, rate, inertia, delays = (Term(*told[k]) for k in _SINGLE)
    moves, starts, becomes, massless = (
        {n: tuple(Term(*t) for t in terms) for n, terms in told[k].items()} for k in _COLUMNS
    )
    settled = bool(told["settled"])
    return Form(parts, gives, rate, moves, starts, becomes, massless, inertia, delays, settled)


def _file(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text()


def _effort(which: int) -> str:
    return f'#pragma GCC optimize ("{_EFFORTS[which]}")\n' if MACHINE else ""


@cache
def origin() -> str:
    """All that the library of the catalogue follows from."""
    texts = "".join(_file(name) for name in WRITERS)
    return f"{metadata.version('casadi')} {ORIGIN} {digest(texts.encode())}"


@final
class _Progress:
    """A line on a terminal about the one thing that takes long."""

    def __init__(self) -> None:
        self._began = time.monotonic()

    def say(self, done: int, every: int) -> None:
        if sys.stderr.isatty():
            spent = time.monotonic() - self._began
            end = "\n" if done == every else ""
            sys.stderr.write(
                f"\rCompiling the effects, once for this machine: {done} of {every} "
                f"({spent:.0f} s){end}"
            )
            sys.stderr.flush()


GENERIC: Final = (*SUMS.values(), PRODUCT, QUOTIENT)
"""Functions of the core itself."""
