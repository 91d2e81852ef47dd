"""What an effect of a user's own has to keep, looked at before it is used.

The catalogue keeps it by its tests; an effect from elsewhere is looked at once, when a model with
it is assembled first.
"""

from __future__ import annotations

import inspect
import traceback
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from piezo_opt.effects.base import Chain, Effect, Equations, Symbols
from piezo_opt.effects.model import Model
from piezo_opt.effects.motion.second_order import SecondOrder
from piezo_opt.effects.strain.bouc_wen import BoucWen
from piezo_opt.effects.strain.piezo_gain import PiezoGain
from piezo_opt.errors import InputError, ModelError, PiezoOptError
from piezo_opt.units import to_si

INSTANTS: Final = 8
CLOSE: Final = 1e-9
SIZES: Final = {"m": 1e-5, "m/s": 1e-2, "V": 30.0}
"""Sizes of states by their unit; others are of size one."""


class Assembled(Protocol):
    """What is asked of a model as functions of one instant."""

    @property
    def parameter_names(self) -> tuple[str, ...]: ...
    @property
    def state_names(self) -> tuple[str, ...]: ...
    @property
    def state_units(self) -> tuple[str, ...]: ...
    @property
    def channel_names(self) -> tuple[str, ...]: ...
    @property
    def rate(self) -> Any: ...
    @property
    def reading(self) -> Any: ...


def equations_of(name: str, effect: Effect, chain: Chain, x: Symbols, p: Symbols) -> Equations:
    """The equations of an effect; whatever goes wrong in them is one sentence with the line.

    Raises:
        ModelError: its own code raised, or returned something else than `Equations`.
    """
    if not callable(effect.equations):
        raise ModelError(
            f"{name}: {first_line(effect)}: equations is {_kind(effect.equations)}: write a "
            "method, def equations(self, chain, x, p)."
        )
    try:
        with warnings.catch_warnings():
            # Of numpy's functions on symbols, which still work.
            warnings.simplefilter("ignore", FutureWarning)
            said: object = effect.equations(chain, x, p)
    except PiezoOptError as error:
        raise ModelError(f"{name}: {error} ({_line_of(effect, error)})") from error
    except (Exception, SystemExit) as error:  # whatever a user's own code raises
        raise ModelError(f"{name}: {_line_of(effect, error)}: {in_words(error)}") from error
    if not isinstance(said, Equations):
        raise ModelError(
            f"{name}: {first_line(effect)}: equations() returned {_kind(said)}: "
            "return Equations(gives=...)."
        )
    for part in ("moves", "starts", "becomes"):
        if not isinstance(getattr(said, part), Mapping):
            raise ModelError(
                f"{name}: {first_line(effect)}: equations() returned "
                f"{_kind(getattr(said, part))} as {part}: give expressions by state, "
                f"{part}={{'z': ...}}."
            )
    return said


def check_promises(effect: Effect, assembled: Callable[[Model], Assembled]) -> None:
    """Refuse an effect whose units do not exist or that does not vanish at its null.

    Args:
        effect: one of the user's own.
        assembled: makes a model's functions, of every parameter.

    Raises:
        ModelError: names what is not kept, with the line of the effect's own file.
    """
    where = f"{effect.name}: {first_line(effect)}"
    for need in (effect.requires,) if isinstance(effect.requires, str) else effect.requires:
        if isinstance(effect.requires, str) or not _is_need(need):
            raise ModelError(
                f"{where}: requires is {effect.requires!r}: write a tuple of 'loop', 'hysteresis', "
                "'motion' or 'channel:NAME', such as ('motion',)."
            )
    for name, unit in (
        *((k, p.unit) for k, p in effect.parameters.items()),
        *((k, s.unit) for k, s in effect.declared_states.items()),
    ):
        _check_unit(where, name, unit)
    gate = effect.gate
    if gate is None:
        return
    plain = PiezoGain() + BoucWen() + SecondOrder()
    model = plain + effect
    whole, less = assembled(model), assembled(plain)
    null = effect.parameters[gate].null
    assert null is not None
    shared = [whole.state_names.index(name) for name in less.state_names]
    random = np.random.default_rng(0)
    nominal = {name: p.nominal for name, p in model.parameters.items()}
    for _ in range(INSTANTS):
        own = {
            f"{model.names[-1]}.{k}": null if k == gate else _drawn(random, p)
            for k, p in effect.parameters.items()
        }
        values = {**nominal, **own}
        x = np.array([SIZES.get(u, 1.0) for u in whole.state_units])
        x *= random.standard_normal(x.size)
        warm = 293.15 + 10.0 * random.standard_normal(len(whole.channel_names))
        instant = (random.uniform(0.0, 10.0), 30.0 * random.standard_normal())
        pair = []
        for system, states, channels in ((whole, x, warm), (less, x[shared], warm[:0])):
            p = np.array([values[name] for name in system.parameter_names])
            given = (instant[0], states, instant[1], 1e4, channels, 0.0 * channels, p)
            rate, reading = (f(*given).full().ravel() for f in (system.rate, system.reading))
            pair.append(np.append(rate[shared] if system is whole else rate, reading))
        told = (*(f"the rate of {n}" for n in less.state_names), "the reading")
        _compare(where, told, f"{gate} = {null:g}", *pair)


def _compare(where: str, told: tuple[str, ...], gate: str, own: Any, plain: Any) -> None:
    for name, with_it, without in zip(told, own, plain, strict=True):
        if not np.isfinite(with_it):
            raise ModelError(
                f"{where}: {name} is {with_it} at {gate}, the null: an effect must be finite "
                "there; a gate that divides becomes a share, in + share (out - in), and functions "
                "of symbols are those of piezo_opt.symbolic, not of math."
            )
        if abs(with_it - without) > CLOSE * max(abs(with_it), abs(without)):
            raise ModelError(
                f"{where}: the effect does not vanish at its null, {gate}: {name} is {with_it:.6g} "
                f"and without the effect {without:.6g}; multiply what it gives by its gate, and on "
                "a line return chain.incoming.value plus that."
            )


def _is_need(need: object) -> bool:
    return isinstance(need, str) and (
        need in ("loop", "hysteresis", "motion") or need.startswith("channel:")
    )


def _drawn(random: np.random.Generator, parameter: Any) -> float:
    """A number of the range that is typical, or near the nominal one."""
    low, high = parameter.typical or sorted((0.5 * parameter.nominal, 1.5 * parameter.nominal))
    return float(random.uniform(low, high))


def _check_unit(where: str, name: str, unit: object) -> None:
    try:
        si = isinstance(unit, str) and float(to_si(1.0, unit)[0]) == 1.0
    except InputError as error:
        raise ModelError(
            f"{where}: the unit {unit!r} of '{name}' does not exist: {error}"
        ) from error
    if not si:
        raise ModelError(
            f"{where}: the unit {unit!r} of '{name}' is no SI unit: write it of m, s, V, K and "
            "rad, such as 'm/V', or '1' for none."
        )


def in_words(error: BaseException) -> str:
    """Type and text of an error; for what beginners meet first, what to write instead."""
    text = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
    if "truth value" in text or "__bool__" in text:
        return (
            "a Python if, and, or, min or max asks for the value of a symbol, which has none yet: "
            "write where_(condition, then, otherwise), min_ or max_ of piezo_opt.symbolic."
        )
    if isinstance(error, SystemExit):
        return "the file ends the program here: leave out exit()."
    if isinstance(error, AttributeError) and "'Chain' object" in text:
        signals = ", ".join(Chain.__dataclass_fields__)
        return f"{type(error).__name__}: {text}; the chain has {signals}."
    return f"{type(error).__name__}: {text[:300]}" if text else type(error).__name__


def line_of(file: str, error: BaseException) -> str:
    """``FILE, line N``, the last line of a file on the way to an error."""
    if isinstance(error, SyntaxError):
        where = error.filename or file
        return where if error.lineno is None else f"{where}, line {error.lineno}"
    # A traceback may have the whole path where the user gave a relative one.
    own = Path(file).resolve()
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if Path(frame.filename).resolve() == own]
    return f"{file}, line {lines[-1]}" if lines else file


def _line_of(effect: Effect, error: BaseException) -> str:
    return line_of(type(effect).equations.__code__.co_filename, error)


def first_line(effect: Effect) -> str:
    """Where the effect's class begins, or its equations where the source is not at hand."""
    try:
        file, line = inspect.getsourcefile(type(effect)), inspect.getsourcelines(type(effect))[1]
    except (OSError, TypeError):
        code = type(effect).equations.__code__
        file, line = code.co_filename, code.co_firstlineno
    return f"{file}, line {line}"


def _kind(value: object) -> str:
    return "nothing" if value is None else f"a {type(value).__name__}"
