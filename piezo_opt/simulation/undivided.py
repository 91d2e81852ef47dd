"""A model as one function, for what cannot be computed one effect after the other.

The velocity of a spring without mass follows from the derivative of the whole force balance: no
order of the effects finds it computed. Such a model is written and compiled by itself, as if it
were one effect, and runs like any other from then on.
"""

from __future__ import annotations

import ctypes
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, final

import casadi as ca
import numpy as np

from piezo_opt.assembly import System
from piezo_opt.simulation.compiler import load
from piezo_opt.simulation.compose import WEIGHTS, Block, Composition, NotComposable, Operation
from piezo_opt.simulation.exponential import linear_part
from piezo_opt.simulation.forms import Written, with_slopes
from piezo_opt.simulation.functions import c_functions
from piezo_opt.simulation.library import Address, addresses, head, origin
from piezo_opt.symbolic import one_at_a_time

_RATE, _READ, _JUMP, _START, _MATRIX = (
    "po_whole_rate", "po_whole_read", "po_whole_jump", "po_whole_start", "po_whole_matrix"
)  # fmt: skip
_FORMS: Final = "po_forms"


@final
@dataclass(frozen=True, eq=False)
class Undivided:
    """A model as one function.

    Attributes:
        composition: its lists of operations.
        addresses: of the functions, by symbol.
        kept: numbers that their preparations keep.
        library: what holds them in memory.
    """

    composition: Composition
    addresses: Mapping[str, tuple[Address, Address]]
    kept: Mapping[str, tuple[int, int]]
    library: ctypes.CDLL


def undivided(system: System, exact: bool) -> Undivided | None:
    """A system as one function, compiled unless it was before; None where that cannot be.

    Args:
        system: assembled model.
        exact: whether linear blocks are taken out.

    Raises:
        NotComposable: it lags by a formula of its parameters.
        NotImplementedError: an operation has no C text.
        ModelError: signals depend on themselves.
    """
    composition = _composition(system, exact)
    loaded = load(f"{origin()}\n{system.recipe}\n{exact=}", lambda _: _text(system, exact))
    if loaded is None:
        return None
    told = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(loaded, _FORMS)))
    kept = {symbol: (few, many) for symbol, (few, many) in json.loads(told).items()}
    found = {symbol: addresses(loaded, symbol) for symbol in kept}
    return Undivided(composition, found, kept, loaded)


@one_at_a_time
def _text(system: System, exact: bool) -> dict[str, str]:
    texts, kept = [], {}
    for symbol, function in _functions(system, exact).items():
        text, kept[symbol] = c_functions(symbol, function)
        texts.append(text)
    told = json.dumps(json.dumps(kept))
    return {**head(), "unit.c": "".join(
        ['#include "head.h"\n', *texts, f"const char {_FORMS}[] = {told};\n"]
    )}  # fmt: skip


def _functions(system: System, exact: bool) -> dict[str, Written]:
    p, x = ca.SX.sym("p", len(system.parameter_names)), ca.SX.sym("x", len(system.state_names))
    t, u, du = (ca.SX.sym(name) for name in ("t", "u", "du"))
    c, dc = (ca.SX.sym(name, len(system.channel_names)) for name in ("c", "dc"))
    d = ca.SX.sym("d", x.numel())
    now = ca.vertcat(t, x, u, du, c, dc)
    found = {
        _RATE: (system.rate(t, x, u, du, c, dc, p), now),
        _READ: (system.reading(t, x, u, du, c, dc, p), now),
        _START: (system.start(t, u, c, p, d), ca.vertcat(t, u, c, d)),
    }
    if system.becomes is not None:
        found[_JUMP] = (system.becomes(t, x, u, du, c, p), ca.vertcat(t, x, u, du, c))
    part = linear_part(system, exact)
    if part.blocks:
        matrix = part.matrix(p)
        entries = [matrix[i, j] for block in part.blocks for i in block for j in block]
        found[_MATRIX] = (ca.vertcat(*entries), ca.SX(0, 1))
    return {symbol: with_slopes(ca.densify(out), p, z) for symbol, (out, z) in found.items()}


def _composition(system: System, exact: bool) -> Composition:
    n, channels = len(system.state_names), len(system.channel_names)
    first: dict[str, int] = {}
    count = 0

    def room(name: str, size: int) -> tuple[int, ...]:
        nonlocal count
        first[name] = count
        count += size
        return tuple(range(first[name], count))

    t, u, du = (room(name, 1) for name in ("time", "drive", "slope"))
    c, dc = room("channel", channels), room("channel_slope", channels)
    x, p = room("state", n), room("parameter", len(system.parameter_names))
    d, length = room("deviation", n), room("length", 1)
    rates, read, becomes = room("rates", n), room("reading", 1), room("becomes", n)
    part = linear_part(system, exact)
    now, weights = (*t, *x, *u, *du, *c, *dc), []
    matrix = room("matrix", sum(len(block) ** 2 for block in part.blocks))
    blocks, at = [], 0
    room("weights", 0)
    for block, heard in zip(part.blocks, part.heard, strict=True):
        size = len(block)
        own = matrix[at : at + size**2]
        at += size**2
        blocks.append(Block(block, own, (False,) * size, heard, True))
        outputs = room(f"weights of {block}", 6 * size**2)
        weights.append(Operation(WEIGHTS[size - 1], (*own, *length, *outputs), size**2 + 1))

    def one(symbol: str, inputs: tuple[int, ...], outputs: tuple[int, ...]) -> Operation:
        return Operation(symbol, (*p, *inputs, *outputs), len(p) + len(inputs))

    jumps = system.becomes is not None
    lists = {
        "once": (one(_MATRIX, (), matrix),) if blocks else (),
        "weigh": tuple(weights),
        "stage": (one(_RATE, now, rates),),
        "reading": (one(_READ, now, read),),
        "jump": (one(_JUMP, (*t, *x, *u, *du, *c), becomes),) if jumps else (),
        "start": (one(_START, (*t, *u, *c, *d), x),),
    }
    clocks, delay = _delay(system)
    names = ("time", "drive", "slope", "channel", "channel_slope", "state", "parameter",
             "deviation", "length", "weights")  # fmt: skip
    return Composition(
        {name: first[name] for name in names}, count, {}, lists, dict(enumerate(rates)),
        dict(enumerate(becomes)) if jumps else {}, tuple(blocks), read[0], clocks, delay,
    )  # fmt: skip


def _delay(system: System) -> tuple[tuple[str, ...], float | None]:
    """Parameters that the chain lags by, and the number beside them."""
    if system.delay is None:
        return (), None
    none = np.zeros(len(system.parameter_names))
    clocks = []
    for i, name in enumerate(system.parameter_names):
        unit = none.copy()
        unit[i] = 1.0
        grown = float(system.delay(unit)) - float(system.delay(none))
        if grown not in (0.0, 1.0):
            raise NotComposable("the chain lags by a formula")
        if grown:
            clocks.append(name)
    return tuple(clocks), float(system.delay(none))
