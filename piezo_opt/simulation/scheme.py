"""One sub-step of the integration scheme, and its forward sensitivities, as expressions.

The classical Runge-Kutta scheme of order four. The drive is a straight line within a sub-step,
so every corner of the drive lies on a boundary and the scheme keeps its order.

Sensitivities S = dx/d(direction) are differentiated through the scheme itself: they are exact for
the numbers that the scheme produces, not for the differential equation. Only entries that can
ever be non-zero are carried.

Linear blocks may be moved by their exponential instead (:mod:`.exponential`): their stages are
those of the exponential scheme of the same order, which is this one where a block is zero.

Source: Hairer, Norsett & Wanner (1993), Solving Ordinary Differential Equations I, II.1 and I.14;
Cox & Matthews (2002), Journal of Computational Physics 176, 430-455 (ETD4RK).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from piezo_opt.assembly import System
from piezo_opt.errors import ModelError
from piezo_opt.simulation.exponential import Weights, linear_part, weights
from piezo_opt.symbolic import one_at_a_time

INITIAL = "initial."

INPUTS = ("p", "h", "du", "dc", "hT", "t", "x", "S", "u", "c", "uT", "tT", "cT")
"""Inputs of sub-step and reading, in order; see :class:`Scheme`."""
START_INPUTS = ("p", "t", "u", "c", "deviation")
"""Inputs of the start, in order."""


@final
@dataclass(frozen=True, eq=False)
class Scheme:
    """Start, sub-step and reading as CasADi functions, the last two of the same thirteen inputs.

    Inputs: parameters p, sub-step h, slopes of drive and channels du, dc, derivative of the
    sub-step by the delay hT, then what moves: time t, states x, non-zeros of S, drive u, channels
    c, and the derivatives of drive, time and channels by the delay.

    Attributes:
        start: ``(p, t, u, c, deviation) -> (x, S)`` at rest plus the deviation.
        step: ``inputs -> (x, S)`` after the sub-step.
        reading: ``inputs -> (y, dy/d(directions))`` at the end of a sub-step.
        directions: names of the sensitivity columns.
        rows: state index of each carried entry of S.
        columns: direction index of each carried entry of S.
    """

    system: System
    start: ca.Function
    step: ca.Function
    reading: ca.Function
    directions: tuple[str, ...]
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]


@one_at_a_time
def scheme(system: System, directions: Sequence[str] = (), exact: bool = False) -> Scheme:
    """Runge-Kutta sub-step of a system with sensitivities in the named directions.

    Args:
        system: assembled model.
        directions: parameter names, or ``"initial." + state`` for the state's initial value.
        exact: whether linear blocks are moved by their exponential.

    Raises:
        ModelError: a direction is no run-time parameter and no state of the model.
    """
    directions = tuple(directions)
    nx, np_ = len(system.state_names), len(system.parameter_names)
    nc, nd = len(system.channel_names), len(directions)
    _known(system, directions)
    pattern = _pattern(system, directions)
    rows, columns = np.nonzero(pattern)
    p, x, s = ca.SX.sym("p", np_), ca.SX.sym("x", nx), ca.SX.sym("S", rows.size)
    t, h, u, du = (ca.SX.sym(n) for n in ("t", "h", "u", "du"))
    c, dc = ca.SX.sym("c", nc), ca.SX.sym("dc", nc)
    ht, ut, tt = ca.SX.sym("hT"), ca.SX.sym("uT"), ca.SX.sym("tT")
    ct = ca.SX.sym("cT", nc)
    inputs = [p, h, du, dc, ht, t, x, s, u, c, ut, tt, ct]
    start = _start(system, directions, rows, columns)

    after = _sub_step(system, exact, p, h, t, x, (u, du), (c, dc))
    y = system.reading(t, x, u, du, c, dc, p)
    if nd == 0:
        after = ca.cse(after)
        return Scheme(
            system, start,
            ca.Function("po_step", inputs, [after, ca.SX(0, 1)], list(INPUTS), ["xn", "Sn"]),
            ca.Function("po_read", inputs, [y, ca.SX(0, 1)], list(INPUTS), ["y", "J"]),
            (), rows, columns,
        )  # fmt: skip

    delays = _delay_directions(system, directions)
    seed_p, _ = _own(system, directions)
    seed_x = ca.SX(nx, nd)
    for index, (row, column) in enumerate(zip(rows, columns, strict=True)):
        seed_x[int(row), int(column)] = s[index]
    moving = ca.SX(1, nd)
    for shifted in delays:
        moving[0, shifted] = 1.0
    seed = ca.vertcat(seed_x, seed_p, moving * ht, moving * ut, moving * tt, ca.mtimes(ct, moving))
    at = ca.vertcat(x, p, h, u, t, c)
    grown = ca.densify(ca.jtimes(after, at, seed))
    slope = ca.densify(ca.jtimes(y, at, seed))
    carried = ca.vertcat(*(grown[int(r), int(k)] for r, k in zip(rows, columns, strict=True)))
    if rows.size == 0:
        carried = ca.SX(0, 1)
    after, carried = ca.cse([after, carried])
    y, slope = ca.cse([y, slope.T])
    return Scheme(
        system, start,
        ca.Function("po_step", inputs, [after, carried], list(INPUTS), ["xn", "Sn"]),
        ca.Function("po_read", inputs, [y, slope], list(INPUTS), ["y", "J"]),
        directions, rows, columns,
    )  # fmt: skip


def _sub_step(
    system: System,
    exact: bool,
    p: ca.SX,
    h: ca.SX,
    t: ca.SX,
    x: ca.SX,
    drive: tuple[ca.SX, ca.SX],
    channels: tuple[ca.SX, ca.SX],
) -> ca.SX:
    """The states after a sub-step, and what becomes of them there."""
    part = linear_part(system, exact)
    (u, du), (c, dc) = drive, channels
    matrix = part.matrix(p)
    of = [weights(matrix[list(block), list(block)], h) for block in part.blocks]
    plain = [i for i in range(x.numel()) if not any(i in block for block in part.blocks)]

    def rest(at: ca.SX, state: ca.SX) -> ca.SX:
        return part.rest(t + at, state, u + du * at, du, c + dc * at, dc, p)

    def moved(block_moves: Callable[[list[int], Weights], ca.SX], others: ca.SX) -> ca.SX:
        state = ca.SX(x)
        for i in plain:
            state[i] = others[i]
        for block, by in zip(part.blocks, of, strict=True):
            state[list(block)] = block_moves(list(block), by)
        return state

    half = h * 0.5
    n1 = rest(ca.SX(0.0), x)
    a = moved(lambda k, by: by.half @ x[k] + by.half_input @ n1[k], x + half * n1)
    n2 = rest(half, a)
    b = moved(lambda k, by: by.half @ x[k] + by.half_input @ n2[k], x + half * n2)
    n3 = rest(half, b)
    e = moved(lambda k, by: by.half @ a[k] + by.half_input @ (2.0 * n3[k] - n1[k]), x + h * n3)
    n4 = rest(h, e)

    def whole(k: list[int], by: Weights) -> ca.SX:
        if _alike([n1[k], n2[k], n3[k], n4[k]]):
            return by.whole @ x[k] + (by.first + 2.0 * by.middle + by.last) @ n1[k]
        return by.whole @ x[k] + by.first @ n1[k] + by.middle @ (n2[k] + n3[k]) + by.last @ n4[k]

    after = moved(whole, x + (h * (1.0 / 6.0)) * (n1 + 2.0 * (n2 + n3) + n4))
    if system.becomes is not None:
        after = system.becomes(t + h, after, u + du * h, du, c + dc * h, p)
    return ca.densify(after)


def _alike(stages: Sequence[ca.SX]) -> bool:
    """Whether the inputs of all stages are the same: nothing that they follow moves."""
    shared = ca.cse(list(stages))
    return all(
        ca.is_equal(first, other)
        for stage in shared[1:]
        for first, other in zip(ca.vertsplit(shared[0]), ca.vertsplit(stage), strict=True)
    )


def _known(system: System, directions: Sequence[str]) -> None:
    for name in directions:
        if name not in system.parameter_names and name.removeprefix(INITIAL) not in (
            system.state_names
        ):
            raise ModelError(
                f"'{name}' is neither a free parameter nor an initial state of the model; "
                f"parameters: {', '.join(system.parameter_names)}."
            )


def _own(system: System, directions: Sequence[str]) -> tuple[ca.DM, ca.DM]:
    """Which parameter, and which state's start, each direction moves: two selections."""
    by_parameter = ca.DM(len(system.parameter_names), len(directions))
    by_start = ca.DM(len(system.state_names), len(directions))
    for column, name in enumerate(directions):
        if name in system.parameter_names:
            by_parameter[system.parameter_names.index(name), column] = 1.0
        else:
            by_start[system.state_names.index(name.removeprefix(INITIAL)), column] = 1.0
    return by_parameter, by_start


def _start(
    system: System,
    directions: Sequence[str],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
) -> ca.Function:
    """The start and the carried entries of its sensitivities."""
    p, d = ca.SX.sym("p", len(system.parameter_names)), ca.SX.sym("d", len(system.state_names))
    t, u, c = ca.SX.sym("t"), ca.SX.sym("u"), ca.SX.sym("c", len(system.channel_names))
    x = ca.densify(system.start(t, u, c, p, d))
    slopes = ca.SX(0, 1)
    if rows.size:
        by_parameter, by_start = _own(system, directions)
        dense = ca.jtimes(x, ca.vertcat(p, d), ca.vertcat(by_parameter, by_start))
        slopes = ca.vertcat(*(dense[int(r), int(k)] for r, k in zip(rows, columns, strict=True)))
    outputs = ca.cse([x, ca.densify(slopes)])
    return ca.Function("po_start", [p, t, u, c, d], outputs, list(START_INPUTS), ["x", "S"])


def _delay_directions(system: System, directions: Sequence[str]) -> list[int]:
    """Columns whose parameter moves the clock of the whole chain."""
    if system.delay is None:
        return []
    moves = np.array(system.delay.jac_sparsity(0, 0).T.row(), dtype=int)
    names = {system.parameter_names[i] for i in moves}
    return [k for k, name in enumerate(directions) if name in names]


def _pattern(system: System, directions: Sequence[str]) -> NDArray[np.bool_]:
    """Which entries of S can ever be non-zero: the closure of S <- S0 + A S + B."""
    nx, nd = len(system.state_names), len(directions)

    def dense(function: ca.Function, out: int, into: int) -> NDArray[np.bool_]:
        sparsity = function.jac_sparsity(out, into)
        return np.asarray(ca.DM(sparsity, 1).full() != 0)

    if nx == 0 or nd == 0:
        return np.zeros((nx, nd), dtype=bool)
    a, b = dense(system.rate, 0, 1), dense(system.rate, 0, 6)
    start_p, start_x = dense(system.start, 0, 3), dense(system.start, 0, 4)
    if system.becomes is not None:
        a |= dense(system.becomes, 0, 1)
        b |= dense(system.becomes, 0, 5)
    pattern = np.zeros((nx, nd), dtype=bool)
    delays = _delay_directions(system, directions)
    for column, name in enumerate(directions):
        if name in system.parameter_names:
            index = system.parameter_names.index(name)
            pattern[:, column] = b[:, index] | start_p[:, index]
        else:
            index = system.state_names.index(name.removeprefix(INITIAL))
            pattern[:, column] = start_x[:, index]
            pattern[index, column] = True
        if column in delays:
            pattern[:, column] = True
    reach = a | np.eye(nx, dtype=bool)
    while True:
        grown = (reach.astype(int) @ pattern.astype(int)) > 0
        if (grown == pattern).all():
            return pattern
        pattern = grown
