"""The C program of a model for many sets of parameters at once.

Sets lie side by side in lanes: every state, and everything that follows from parameters alone, is
a small array over the lanes, and every statement of a sub-step stands in a loop over them, which
the compiler turns into vector instructions. Time and drive are the same in all lanes. Within a
set, the operations are those of the scalar program, in the same order; powers are exponentials of
logarithms here, because a table for each lane would not be a vector.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final

from piezo_opt.assembly import System
from piezo_opt.simulation.emit import Block, emit
from piezo_opt.simulation.library import declarations
from piezo_opt.simulation.scheme import START_INPUTS, scheme

RUN: Final = "po_run"
"""Name of the C function."""
LEVELS: Final = {
    "p": 0, "h": 1, "hT": 1, "du": 2, "dc": 2, "t": 3, "x": 3, "S": 3, "u": 3, "c": 3, "uT": 3,
    "tT": 3, "cT": 3,
}  # fmt: skip
"""Loop level at which each input of a scheme is known."""
WIDTH: Final = 16
"""Sets side by side: a sub-step is a chain of operations that wait for one another, and so many
chains keep the arithmetic units busy meanwhile."""

_HEAD: Final = """
/* Sets first .. first + sets - 1 of a model. n segments: length H [s], sub-steps NSUB, start time
   T, drive U with slope DU, channels C with slopes DC (row-major); OBS is the index of the reading
   taken at the segment's end, or -1. Parameter i of set k is P[i][k * PS[i]], the deviation of
   state i at the start is D[i][k * DS[i]]. Y takes the readings, a row of N a set, unless it is
   null; SQ takes the sums of squares of the readings minus M, entries of M that are NaN not
   counted. */
"""
_ARGUMENTS: Final = (
    "const long first", "const long sets", "const long n", "const double *restrict H",
    "const int *restrict NSUB", "const double *restrict T", "const double *restrict U",
    "const double *restrict DU", "const double *restrict C", "const double *restrict DC",
    "const int *restrict OBS", "const double *const *P", "const long *PS",
    "const double *const *D", "const long *DS", "const long N", "double *restrict Y",
    "const double *restrict M", "double *restrict SQ",
)  # fmt: skip


def source(system: System) -> str:
    """The C text that simulates a system for sets of parameters in lanes.

    Raises:
        NotImplementedError: an operation that has no C text.
    """
    plan = scheme(system)
    names = [plan.step.name_in(i) for i in range(plan.step.n_in())]
    levels = [LEVELS[n] for n in names]
    step = emit(plan.step, names, levels, "a", 4)
    reading = emit(plan.reading, names, levels, "b", 4)
    start = emit(plan.start, START_INPUTS, [0] * len(START_INPUTS), "s", 1)
    writer = _Writer(len(system.parameter_names), len(system.state_names))
    channels = range(len(system.channel_names))
    deeper = [_said(step, reading, level) for level in range(4)]

    out: list[str] = [declarations(), _HEAD]
    line = out.append
    line(f"void {RUN}({', '.join(_ARGUMENTS)})\n{{\nPO_FLUSH\n")
    line(f"for (long k0 = first; k0 < first + sets; k0 += {WIDTH}) {{\n")
    line(f"const long live = first + sets - k0 < {WIDTH} ? first + sets - k0 : {WIDTH};\n")
    line(writer.declared())
    line(f"double squares[{WIDTH}] = {{0}}, y_[{WIDTH}];\n")
    line("{ const double t_0 = T[0], u_0 = U[0];\n")
    line("".join(f"const double c_{i} = C[{i}];\n" for i in channels))
    line(writer.first(start))
    line("}\n")
    line(writer.level(0, [*step.levels[0], *reading.levels[0]], deeper[0]))
    line("double known = NAN;\n")
    ahead = [*step.levels[1], *reading.levels[1]]
    line(writer.room(ahead, deeper[1]))
    within = [*step.levels[2], *reading.levels[2]]
    line(writer.room(within, deeper[2]))
    line("for (long j = 0; j < n; ++j) {\nconst int m = NSUB[j];\n")
    line("const double h_0 = m > 0 ? H[j] / m : 0.0, hT_0 = 0.0;\n")
    line("if (!(h_0 == known)) {\nknown = h_0;\n")
    line(writer.lanes(ahead, deeper[1]))
    line("}\nconst double du_0 = DU[j];\ndouble t_0 = T[j], u_0 = U[j];\n")
    for i in channels:
        line(f"const double dc_{i} = DC[j * {len(channels)} + {i}];\n")
        line(f"double c_{i} = C[j * {len(channels)} + {i}];\n")
    line(writer.lanes(within, deeper[2]))
    line("for (int i = 0; i < m; ++i) {\n")
    after = [f"x_{i}_[l] = {text};" for i, text in enumerate(step.outputs[0])]
    line(writer.lanes([*step.levels[3], *after], set()))
    line("t_0 += h_0; u_0 += du_0 * h_0;\n")
    line("".join(f"c_{i} += dc_{i} * h_0;\n" for i in channels))
    line("}\nconst long k = OBS[j];\nif (k >= 0) {\n")
    line(writer.lanes([*reading.levels[3], f"y_[l] = {reading.outputs[0][0]};"], set()))
    line("const double aim = M[k];\nif (aim == aim) {\n")
    line(writer.lanes(["squares[l] += (y_[l] - aim) * (y_[l] - aim);"], set()))
    line("}\nif (Y) for (long l = 0; l < live; ++l) Y[(k0 + l) * N + k] = y_[l];\n")
    line("}\n}\nfor (long l = 0; l < live; ++l) SQ[k0 + l] = squares[l];\n}\n}\n")
    return "".join(out)


def _said(step: Block, reading: Block, level: int) -> set[str]:
    """Names that are used further in than a level."""
    texts = [
        text for piece in (step, reading) for deep in piece.levels[level + 1 :] for text in deep
    ]
    texts += [text for piece in (step, reading) for output in piece.outputs for text in output]
    return {name for text in texts for name in re.findall(r"\w+", text)}


class _Writer:
    """Loops over the lanes: what a statement needs is fetched from its array first.

    Args:
        parameters, states: how many there are.
    """

    def __init__(self, parameters: int, states: int) -> None:
        self._parameters = parameters
        self._states = states
        self._kept = {f"p_{i}" for i in range(parameters)} | {f"x_{i}" for i in range(states)}

    def declared(self) -> str:
        """Room for parameters and states."""
        names = [*(f"p_{i}" for i in range(self._parameters)),
                 *(f"x_{i}" for i in range(self._states))]  # fmt: skip
        return "".join(f"double {name}_[{WIDTH}];\n" for name in names)

    def first(self, start: Block) -> str:
        """Parameters fetched, the last set again in lanes that are left over; states at rest."""
        body = ["const long k = k0 + (l < live ? l : live - 1);"]
        for i in range(self._parameters):
            body.append(f"const double p_{i} = P[{i}][k * PS[{i}]]; p_{i}_[l] = p_{i};")
        for i in range(self._states):
            body.append(f"const double deviation_{i} = D[{i}][k * DS[{i}]];")
        body += start.levels[0]
        body += [f"x_{i}_[l] = {text};" for i, text in enumerate(start.outputs[0])]
        return _loop(body, vector=False)

    def level(self, _: int, lines: Sequence[str], used: set[str]) -> str:
        """Room for what is used further in, and the statements."""
        return self.room(lines, used) + self.lanes(lines, used)

    def room(self, lines: Iterable[str], used: set[str]) -> str:
        """Declarations of arrays for what these statements leave for later."""
        return "".join(f"double {name}_[{WIDTH}];\n" for name in _made(lines) if name in used)

    def lanes(self, lines: Sequence[str], used: set[str]) -> str:
        """Statements for all lanes; results that are used further in are kept in their arrays."""
        if not lines:
            return ""
        asked = {name for text in lines for name in re.findall(r"\w+", text)}
        made = _made(lines)
        body = [f"const double {name} = {name}_[l];" for name in sorted(asked & self._kept)]
        body += lines
        kept = [name for name in made if name in used]
        body += [f"{name}_[l] = {name};" for name in kept]
        self._kept |= set(kept)
        return _loop(body)


def _made(lines: Iterable[str]) -> list[str]:
    """Names that statements declare."""
    return [text.split()[2] for text in lines if text.startswith("const double ")]


def _loop(body: Sequence[str], vector: bool = True) -> str:
    """A loop over the lanes; within one nothing waits for another lane."""
    told = "#pragma GCC ivdep\n" if vector else ""
    inside = "\n".join(body)
    return f"{told}for (long l = 0; l < {WIDTH}; ++l) {{\n{inside}\n}}\n"
