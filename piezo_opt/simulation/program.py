"""The C program of a scheme: the time loop around its straight-line step.

Two exported functions: ``po_start`` gives states and sensitivities at rest, ``po_run`` walks over
the segments of a schedule. Everything that depends on parameters alone is computed once,
everything that depends on the segment once a segment.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from piezo_opt.simulation.emit import Block, emit
from piezo_opt.simulation.powers import POWERS
from piezo_opt.simulation.scheme import START_INPUTS, Outline
from piezo_opt.simulation.tangents import TYPES, Carried, Lanes, Tangents

RUN: Final = "po_run"
START: Final = "po_start"

_LEVELS: Final = {
    "p": 0, "h": 1, "du": 1, "dc": 1, "hT": 1, "t": 2, "x": 2, "S": 2, "u": 2, "c": 2, "uT": 2,
    "tT": 2, "cT": 2,
}  # fmt: skip

_START_HEAD: Final = """
/* States X and their sensitivities S (row-major, zeroed by the caller) at rest at time T under
   drive U and channels C, plus the deviation D. */
void po_start(const double *restrict T, const double *restrict U, const double *restrict C,
              const double *restrict P, const double *restrict D, double *restrict X,
              double *restrict S)
{
"""

_RUN_HEAD: Final = """\
/* n segments: length H [s], sub-steps NSUB, start time T, drive U with slope DU, channels C with
   slopes DC (row-major), derivatives by the delay HT, UT, TT, CT; OBS is the index of the reading
   taken at the segment's end, or -1. X and S hold the state and its sensitivities (row-major) at
   the start on entry and at the end on return; Y, J, XO take readings, their sensitivities
   (row-major) and, if XO is not null, the states at the readings. */
void po_run(const long n, const double *restrict H, const int *restrict NSUB,
            const double *restrict T, const double *restrict U, const double *restrict DU,
            const double *restrict C, const double *restrict DC, const double *restrict HT,
            const double *restrict UT, const double *restrict TT, const double *restrict CT,
            const int *restrict OBS, const double *restrict P, double *restrict X,
            double *restrict S, double *restrict Y, double *restrict J, double *restrict XO)
{
"""


def source(plan: Outline) -> str:
    """The C text that simulates a scheme and the sensitivities that it carries along."""
    names = [plan.step.name_in(i) for i in range(plan.step.n_in())]
    levels = [_LEVELS[n] for n in names]
    lanes = Lanes.of([tuple(column) for column in plan.pattern.T.tolist()])
    seeds, moved = _seeds(plan, lanes, names)
    step = emit(plan.step, names, levels, "a", 3, Tangents(lanes, seeds, "va"))
    reading = emit(plan.reading, names, levels, "b", 3, Tangents(lanes, seeds, "vb"))
    np_, nx = plan.step.numel_in(0), plan.step.numel_in(6)
    nc, nd = plan.step.numel_in(9), len(plan.directions)
    delayed = bool(plan.clocks)
    places = [int(r) * nd + int(k) for r, k in zip(*np.nonzero(plan.pattern), strict=True)]
    out: list[str] = ["#include <math.h>\n\n", TYPES, POWERS, _START_HEAD]

    def line(depth: int, text: str) -> None:
        out.append("    " * depth + text + "\n")

    def block(depth: int, piece: Block, at: int) -> None:
        for text in piece.levels[at]:
            line(depth, text)

    start = emit(plan.start, START_INPUTS, [0] * len(START_INPUTS), "s", 1)
    for i in range(np_):
        line(1, f"const double p_{i} = P[{i}];")
    line(1, "const double t_0 = T[0], u_0 = U[0];")
    for i in range(nc):
        line(1, f"const double c_{i} = C[{i}];")
    for i in range(nx):
        line(1, f"const double deviation_{i} = D[{i}];")
    block(1, start, 0)
    for i, text in enumerate(start.outputs[0] if nx else ()):
        line(1, f"X[{i}] = {text};")
    for i, text in zip(places, start.outputs[1] if places else (), strict=True):
        line(1, f"S[{i}] = {text};")
    out.append("}\n\n")

    out.append(_RUN_HEAD)
    for i in range(np_):
        line(1, f"const double p_{i} = P[{i}];")
    for i in range(nx):
        line(1, f"double x_{i} = X[{i}];")
    for i, group in moved:
        columns = lanes.groups[group]
        held = lanes.literal(group, [f"S[{i * nd + k}]" for k in columns])
        line(1, f"{lanes.kind(group)} S_{i}_{group} = {held};")
    block(1, step, 0)
    block(1, reading, 0)
    line(1, "for (long j = 0; j < n; ++j) {")
    line(2, "const int m = NSUB[j];")
    line(2, "const double h_0 = m > 0 ? H[j] / m : 0.0, du_0 = DU[j];")
    line(2, "double t_0 = T[j], u_0 = U[j];")
    for i in range(nc):
        line(2, f"const double dc_{i} = DC[j * {nc} + {i}];")
        line(2, f"double c_{i} = C[j * {nc} + {i}];")
    if delayed:
        line(2, "const double hT_0 = m > 0 ? HT[j] / m : 0.0;")
        line(2, "double uT_0 = UT[j], tT_0 = TT[j];")
        for i in range(nc):
            line(2, f"double cT_{i} = CT[j * {nc} + {i}];")
    block(2, step, 1)
    block(2, reading, 1)
    line(2, "for (int i = 0; i < m; ++i) {")
    block(3, step, 2)
    for i, text in enumerate(step.outputs[0]):
        line(3, f"const double xn_{i} = {text};")
    for i, group in moved:
        still = lanes.literal(group, ["0.0"])
        line(3, f"const {lanes.kind(group)} Sn_{i}_{group} = "
                f"{step.tangents[0][i][group] or still};")  # fmt: skip
    for i in range(nx):
        line(3, f"x_{i} = xn_{i};")
    for i, group in moved:
        line(3, f"S_{i}_{group} = Sn_{i}_{group};")
    line(3, "t_0 += h_0; u_0 += du_0 * h_0;")
    for i in range(nc):
        line(3, f"c_{i} += dc_{i} * h_0;")
    if delayed:
        line(3, "tT_0 += hT_0; uT_0 += du_0 * hT_0;")
        for i in range(nc):
            line(3, f"cT_{i} += dc_{i} * hT_0;")
    line(2, "}")
    line(2, "const long k = OBS[j];")
    line(2, "if (k >= 0) {")
    block(3, reading, 2)
    line(3, f"Y[k] = {reading.outputs[0][0]};")
    for group, columns in enumerate(lanes.groups):
        slope = reading.tangents[0][0][group] or lanes.literal(group, ["0.0"])
        line(3, f"const {lanes.kind(group)} J_{group} = {slope};")
        for lane, k in enumerate(columns):
            line(3, f"J[k * {nd} + {k}] = {lanes.entry(group, f'J_{group}', lane)};")
    if nx:
        line(3, "if (XO) {")
        for i in range(nx):
            line(4, f"XO[k * {nx} + {i}] = x_{i};")
        line(3, "}")
    line(2, "}")
    line(1, "}")
    for i in range(nx):
        line(1, f"X[{i}] = x_{i};")
    for i, group in moved:
        for lane, k in enumerate(lanes.groups[group]):
            line(1, f"S[{i * nd + k}] = {lanes.entry(group, f'S_{i}_{group}', lane)};")
    out.append("}\n")
    return "".join(out)


def _seeds(
    plan: Outline, lanes: Lanes, names: Sequence[str]
) -> tuple[dict[tuple[int, int], tuple[Carried | None, ...]], list[tuple[int, int]]]:
    """Tangents of all inputs, and which state has one in which group."""
    place = {name: i for i, name in enumerate(names)}

    def ones(wanted: Sequence[int], by: str = "", level: int = 0) -> tuple[Carried | None, ...]:
        """1 in the wanted directions, times what moves them."""
        found: list[Carried | None] = []
        for group, columns in enumerate(lanes.groups):
            chosen = ["1.0" if k in wanted else "0.0" for k in columns]
            unit = lanes.literal(group, chosen)
            some = "1.0" in chosen
            found.append(Carried(f"({unit} * {by})" if by else unit, level) if some else None)
        return tuple(found)

    seeds: dict[tuple[int, int], tuple[Carried | None, ...]] = {}
    for i, name in enumerate(plan.system.parameter_names):
        wanted = [k for k, direction in enumerate(plan.directions) if direction == name]
        seeds[place["p"], i] = ones(wanted)
    if plan.clocks:
        moving = [("h", "hT_0", 1), ("u", "uT_0", 2), ("t", "tT_0", 2)]
        for name, by, level in moving:
            seeds[place[name], 0] = ones(plan.clocks, by, level)
        for i in range(len(plan.system.channel_names)):
            seeds[place["c"], i] = ones(plan.clocks, f"cT_{i}", 2)
    moved = [
        (i, group)
        for i in range(len(plan.system.state_names))
        for group, columns in enumerate(lanes.groups)
        if plan.pattern[i, list(columns)].any()
    ]
    for i in range(len(plan.system.state_names)):
        seeds[place["x"], i] = tuple(
            Carried(f"S_{i}_{group}", 2) if (i, group) in moved else None
            for group in range(len(lanes.groups))
        )
    return seeds, moved
