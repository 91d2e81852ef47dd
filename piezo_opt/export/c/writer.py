"""The C text of a plan: one header, one source, in the order in which they are read."""

from __future__ import annotations

from piezo_opt.export.c.delayed import follow, late
from piezo_opt.export.c.equations import jump, output, prepare, rates
from piezo_opt.export.c.header import header
from piezo_opt.export.c.lacking import lacking
from piezo_opt.export.c.pen import Pen
from piezo_opt.export.c.plan import Plan
from piezo_opt.export.c.printer import Precision
from piezo_opt.export.c.stepping import adder, init, start, step, substep
from piezo_opt.export.c.tangents import EQUATIONS, TANGENTS, start_by


def source(pen: Pen) -> str:
    """The .c: the equations, the sub-step, and what a program calls."""
    parts = [output(pen), rates(pen), jump(pen), adder(pen), substep(pen), prepare(pen)]
    parts += [*late(pen), start(pen), init(pen), step(pen)]
    if (slopes := pen.plan.slopes) is not None:
        parts += [write(pen, slopes) for write in EQUATIONS]
        parts += [substep(pen, moved=True), follow(pen, f"{pen.name}_{TANGENTS}")]
        parts += [start_by(pen, slopes), step(pen, moved=True)]
    body = [line for part in parts if part for line in (*part, "")]
    head = [*pen.title(), f'#include "{pen.name}.h"', ""]
    if pen.called - {"fabs", "sign", "smaller", "larger"} or "fabs" in pen.called:
        head += ["#include <math.h>", ""]
    head += [
        "#ifdef __GNUC__",
        f"#define {pen.name}_inline static inline __attribute__((always_inline))",
        "#else",
        f"#define {pen.name}_inline static inline",
        "#endif",
        "",
    ]
    head += lacking(pen.called, pen.name, pen.precision)
    return "\n".join([*head, *body]).rstrip() + "\n"


def text(plan: Plan, precision: Precision) -> tuple[str, str]:
    """Header and source of a plan."""
    pen = Pen(plan, precision)
    return header(pen), source(pen)
