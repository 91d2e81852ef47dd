"""The C program of a scheme: the time loop around its straight-line step.

Two exported functions: ``po_start`` gives states and sensitivities at rest, ``po_run`` walks over
the segments of a schedule. Everything that depends on parameters alone is computed once,
everything that depends on the segment once a segment.
"""

from __future__ import annotations

from typing import Final

from piezo_opt.simulation.emit import Block, emit
from piezo_opt.simulation.scheme import START_INPUTS, Scheme

RUN: Final = "po_run"
START: Final = "po_start"

_LEVELS: Final = {
    "p": 0, "h": 1, "du": 1, "dc": 1, "hT": 1, "t": 2, "x": 2, "S": 2, "u": 2, "c": 2, "uT": 2,
    "tT": 2, "cT": 2,
}  # fmt: skip

_START_HEAD: Final = """\
#include <math.h>

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


def source(scheme: Scheme) -> str:
    """The C text that simulates the scheme."""
    names = [scheme.step.name_in(i) for i in range(scheme.step.n_in())]
    levels = [_LEVELS[n] for n in names]
    step = emit(scheme.step, names, levels, "a", 3)
    reading = emit(scheme.reading, names, levels, "b", 3)
    np_, nx = scheme.step.numel_in(0), scheme.step.numel_in(6)
    ns, nc = scheme.step.numel_in(7), scheme.step.numel_in(9)
    nd = len(scheme.directions)
    delayed = scheme.system.delay is not None and nd > 0
    places = [int(r) * nd + int(k) for r, k in zip(scheme.rows, scheme.columns, strict=True)]
    out: list[str] = [_START_HEAD]

    def line(depth: int, text: str) -> None:
        out.append("    " * depth + text + "\n")

    def block(depth: int, piece: Block, at: int) -> None:
        for text in piece.levels[at]:
            line(depth, text)

    start = emit(scheme.start, START_INPUTS, [0] * len(START_INPUTS), "s", 1)
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
    for i, text in zip(places, start.outputs[1] if ns else (), strict=True):
        line(1, f"S[{i}] = {text};")
    out.append("}\n\n")

    out.append(_RUN_HEAD)
    for i in range(np_):
        line(1, f"const double p_{i} = P[{i}];")
    for i in range(nx):
        line(1, f"double x_{i} = X[{i}];")
    for i, place in enumerate(places):
        line(1, f"double S_{i} = S[{place}];")
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
    elif nd:
        line(2, "const double hT_0 = 0.0, uT_0 = 0.0, tT_0 = 0.0;")
        for i in range(nc):
            line(2, f"const double cT_{i} = 0.0;")
        line(2, "(void)hT_0; (void)uT_0; (void)tT_0;")
    block(2, step, 1)
    block(2, reading, 1)
    line(2, "for (int i = 0; i < m; ++i) {")
    block(3, step, 2)
    for i, text in enumerate(step.outputs[0]):
        line(3, f"const double xn_{i} = {text};")
    for i, text in enumerate(step.outputs[1] if ns else ()):
        line(3, f"const double Sn_{i} = {text};")
    for i in range(nx):
        line(3, f"x_{i} = xn_{i};")
    for i in range(ns):
        line(3, f"S_{i} = Sn_{i};")
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
    for i, text in enumerate(reading.outputs[1] if nd else ()):
        line(3, f"J[k * {nd} + {i}] = {text};")
    if nx:
        line(3, "if (XO) {")
        for i in range(nx):
            line(4, f"XO[k * {nx} + {i}] = x_{i};")
        line(3, "}")
    line(2, "}")
    line(1, "}")
    for i in range(nx):
        line(1, f"X[{i}] = x_{i};")
    for i, place in enumerate(places):
        line(1, f"S[{place}] = S_{i};")
    out.append("}\n")
    return "".join(out)
