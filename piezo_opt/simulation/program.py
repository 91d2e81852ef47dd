"""The C program of a scheme: the time loop around its straight-line step.

Two exported functions: ``po_start`` gives states and sensitivities at rest, ``po_run`` walks over
the segments of a schedule. Everything that depends on parameters alone is computed once, what
depends on the length of a sub-step as well whenever that changes, and what depends on the segment
once a segment. Where drive and channels stand still, only what moves by itself is moved.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from piezo_opt.simulation.emit import Block, emit
from piezo_opt.simulation.exponential import LENGTHS, linear_part
from piezo_opt.simulation.powers import POWERS
from piezo_opt.simulation.scheme import START_INPUTS, Outline
from piezo_opt.simulation.tangents import TYPES, Carried, Lanes, Tangents

RUN: Final = "po_run"
START: Final = "po_start"

_SHORTER: Final = 0.85
"""Statements of a sub-step while the drive stands still, over those of any, up to which it is worth
its place in the program."""
LEVELS: Final = {
    "p": 0, "h": 1, "hT": 1, "du": 2, "dc": 2, "t": 3, "x": 3, "S": 3, "u": 3, "c": 3, "uT": 3,
    "tT": 3, "cT": 3,
}  # fmt: skip

FLUSH: Final = """
/* Within a function that says PO_FLUSH what is smaller than the smallest normal number is zero: a
   derivative by where a state began fades to there and stays, and a processor may take far longer
   over such numbers. Caller's habits are restored wherever the function ends. Its header would take
   longer to read than these lines. */
#if defined(__SSE2__)
static inline unsigned po_flush(void)
{
    const unsigned kept = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(kept | 0x8040u); /* results, and operands */
    return kept;
}
static inline void po_restore(const unsigned *const kept) { __builtin_ia32_ldmxcsr(*kept); }
#define PO_FLUSH const unsigned po_kept __attribute__((cleanup(po_restore))) = po_flush();
#else
#define PO_FLUSH
#endif
"""

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
   (row-major) and, if XO is not null, the states at the readings. If M is not null the run ends,
   its results unfinished, as soon as the sum of squares of the readings minus M exceeds MOST or is
   none; entries of M that are NaN do not count. */
void po_run(const long n, const double *restrict H, const int *restrict NSUB,
            const double *restrict T, const double *restrict U, const double *restrict DU,
            const double *restrict C, const double *restrict DC, const double *restrict HT,
            const double *restrict UT, const double *restrict TT, const double *restrict CT,
            const int *restrict OBS, const double *restrict P, double *restrict X,
            double *restrict S, double *restrict Y, double *restrict J, double *restrict XO,
            const double *restrict M, const double MOST)
{
    PO_FLUSH
"""


def source(plan: Outline) -> str:
    """The C text that simulates a scheme and the sensitivities that it carries along."""
    names = [plan.step.name_in(i) for i in range(plan.step.n_in())]
    levels = [LEVELS[n] for n in names]
    lanes = Lanes.of([tuple(column) for column in plan.pattern.T.tolist()])
    seeds, moved = _seeds(plan, lanes, names)
    step = emit(plan.step, names, levels, "a", 4, Tangents(lanes, seeds, "va"))
    moving, still = step.innermost
    shorter = len(still) <= _SHORTER * len(moving)
    reading = emit(plan.reading, names, levels, "b", 4, Tangents(lanes, seeds, "vb"))
    np_, nx = plan.step.numel_in(0), plan.step.numel_in(6)
    nc, nd = plan.step.numel_in(9), len(plan.directions)
    delayed = bool(plan.clocks)
    places = [int(r) * nd + int(k) for r, k in zip(*np.nonzero(plan.pattern), strict=True)]
    out: list[str] = ["#include <math.h>\n\n", TYPES, POWERS, FLUSH, _START_HEAD]

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
    lengths = {"h_0": "NSUB[j] > 0 ? H[j] / NSUB[j] : 0.0"}
    if delayed:
        lengths["hT_0"] = "NSUB[j] > 0 ? HT[j] / NSUB[j] : 0.0"
    # Exponentials take as long as several sub-steps. They are kept for the last few lengths: a held
    # drive has two by turns, one that is cut by how far it moves has some more.
    matters = linear_part(plan.system, plan.exact).blocks
    again = _kept([*step.levels[1], *reading.levels[1]], _deeper(step) | _deeper(reading))
    if matters:
        line(1, "struct {")
        for name, kind in {**dict.fromkeys(lengths, "double"), **again}.items():
            line(2, f"{kind} {name};")
        line(1, f"}} kept[{LENGTHS}];")
        line(1, "int known = 0, next = 0;")
    line(1, "double squares = 0.0;")
    line(1, "for (long j = 0; j < n;) {")
    for name, said in lengths.items():
        line(2, f"const double {name} = {said};")
    if matters:
        same = " && ".join(f"kept[at].{name} == {name}" for name in lengths)
        line(2, "int at = 0;")
        line(2, f"while (at < known && !({same})) ++at;")
        line(2, "if (at == known) {")
        line(3, f"if (known < {LENGTHS}) ++known;")
        line(3, "else at = next;")
        line(3, f"next = (next + 1) % {LENGTHS};")
        block(3, step, 1)
        block(3, reading, 1)
        for name in (*lengths, *again):
            line(3, f"kept[at].{name} = {name};")
        line(2, "}")
        for name, kind in again.items():
            line(2, f"const {kind} {name} = kept[at].{name};")
    else:
        block(2, step, 1)
        block(2, reading, 1)
    same = " && ".join(f"({said}) == {name}" for name, said in lengths.items())
    line(2, "do {")
    line(3, "const int m = NSUB[j];")
    line(3, "const double du_0 = DU[j];")
    line(3, "double t_0 = T[j], u_0 = U[j];")
    slopes = ["du_0", *(f"dc_{i}" for i in range(nc))]
    for i in range(nc):
        line(3, f"const double dc_{i} = DC[j * {nc} + {i}];")
        line(3, f"double c_{i} = C[j * {nc} + {i}];")
    if delayed:
        line(3, "double uT_0 = UT[j], tT_0 = TT[j];")
        for i in range(nc):
            line(3, f"double cT_{i} = CT[j * {nc} + {i}];")
    block(3, step, 2)
    block(3, reading, 2)

    def sub_steps(output: int) -> None:
        line(4, "for (int i = 0; i < m; ++i) {")
        for text in step.innermost[output]:
            line(5, text)
        for i, text in enumerate(step.outputs[output]):
            line(5, f"const double xn_{i} = {text};")
        for i, group in moved:
            zero = lanes.literal(group, ["0.0"])
            line(5, f"const {lanes.kind(group)} Sn_{i}_{group} = "
                    f"{step.tangents[output][i][group] or zero};")  # fmt: skip
        for i in range(nx):
            line(5, f"x_{i} = xn_{i};")
        for i, group in moved:
            line(5, f"S_{i}_{group} = Sn_{i}_{group};")
        line(5, "t_0 += h_0; u_0 += du_0 * h_0;")
        for i in range(nc):
            line(5, f"c_{i} += dc_{i} * h_0;")
        if delayed:
            line(5, "tT_0 += hT_0; uT_0 += du_0 * hT_0;")
            for i in range(nc):
                line(5, f"cT_{i} += dc_{i} * hT_0;")
        line(4, "}")

    if shorter:
        unmoved = " && ".join(f"{slope} == 0.0" for slope in slopes)
        line(3, f"if ({unmoved}) {{")
        sub_steps(1)
        line(3, "} else")
    line(3, "{")
    sub_steps(0)
    line(3, "}")
    line(3, "const long k = OBS[j];")
    line(3, "if (k >= 0) {")
    block(4, reading, 3)
    line(4, f"Y[k] = {reading.outputs[0][0]};")
    for group, columns in enumerate(lanes.groups):
        slope = reading.tangents[0][0][group] or lanes.literal(group, ["0.0"])
        line(4, f"const {lanes.kind(group)} J_{group} = {slope};")
        for lane, k in enumerate(columns):
            line(4, f"J[k * {nd} + {k}] = {lanes.entry(group, f'J_{group}', lane)};")
    line(4, "if (M && M[k] == M[k]) {")
    line(5, "squares += (Y[k] - M[k]) * (Y[k] - M[k]);")
    line(5, "if (!(squares <= MOST)) return;")
    line(4, "}")
    if nx:
        line(4, "if (XO) {")
        for i in range(nx):
            line(5, f"XO[k * {nx} + {i}] = x_{i};")
        line(4, "}")
    line(3, "}")
    line(3, "++j;")
    line(2, f"}} while (j < n && {same});")
    line(1, "}")
    for i in range(nx):
        line(1, f"X[{i}] = x_{i};")
    for i, group in moved:
        for lane, k in enumerate(lanes.groups[group]):
            line(1, f"S[{i * nd + k}] = {lanes.entry(group, f'S_{i}_{group}', lane)};")
    out.append("}\n")
    return "".join(out)


def _deeper(piece: Block) -> set[str]:
    """Names that are used within the sub-steps and at readings, or once a segment."""
    said = [*piece.levels[2], *piece.levels[3]]
    said += [text for output in piece.outputs for text in output]
    said += [text for output in piece.tangents for one in output for text in one if text]
    return {name for text in said for name in re.findall(r"\w+", text)}


def _kept(lines: Sequence[str], used: set[str]) -> dict[str, str]:
    """Name and type of every declaration whose name is used further in."""
    found: dict[str, str] = {}
    for text in lines:
        _, kind, name, *_ = text.split()
        if name in used:
            found[name] = kind
    return found


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
        moving = [("h", "hT_0", 1), ("u", "uT_0", 3), ("t", "tT_0", 3)]
        for name, by, level in moving:
            seeds[place[name], 0] = ones(plan.clocks, by, level)
        for i in range(len(plan.system.channel_names)):
            seeds[place["c"], i] = ones(plan.clocks, f"cT_{i}", 3)
    moved = [
        (i, group)
        for i in range(len(plan.system.state_names))
        for group, columns in enumerate(lanes.groups)
        if plan.pattern[i, list(columns)].any()
    ]
    for i in range(len(plan.system.state_names)):
        seeds[place["x"], i] = tuple(
            Carried(f"S_{i}_{group}", 3) if (i, group) in moved else None
            for group in range(len(lanes.groups))
        )
    return seeds, moved
