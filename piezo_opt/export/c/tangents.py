"""Derivatives by the parameters, carried along: forward tangents of the scheme itself.

With S = dx/dp the chain rule gives for rates f, jumps g, and the reading y

    d(x')/dp = f_x S + f_p,    dg/dp = g_x S + g_p,    dy/dp = y_x S + y_p.

Every stage of the scheme moves its own tangents, so that the derivatives are those of the numbers
that the code produces.

Source: Griewank & Walther (2008), Evaluating Derivatives, 2nd ed., ch. 3.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Final

from piezo_opt.export.c import naming
from piezo_opt.export.c.pen import Pen, braced
from piezo_opt.export.c.plan import Plan
from piezo_opt.export.c.printer import WIDTH, wrapped
from piezo_opt.export.c.slopes import Partial, Slopes

TANGENTS: Final = "tangents"
"""Name of the struct, behind the prefix."""


def count(pen: Pen) -> str:
    """The number of derivatives, as it stands in C."""
    return f"{pen.name}_parameter_count"


def moved_by(plan: Plan) -> list[naming.Field]:
    """Parameters by which is differentiated: all but those that decide a delay.

    A delay moves the instants at which lines of the input meet the readings, and no state.
    """
    slopes = plan.slopes
    assert slopes is not None
    late = {column for _, column, _ in slopes.delay.by_parameter}
    return [one for one in plan.parameters if one.at not in late]


def each(pen: Pen) -> str:
    """The head of a loop over the parameters."""
    return f"for (int i = 0; i < {count(pen)}; ++i)"


def moving_by(pen: Pen) -> list[str]:
    """What the derivatives of the rates read beside states and parameters."""
    assert pen.plan.slopes is not None
    found = set(pen.plan.graph.leaves([*pen.plan.rates, *pen.plan.slopes.rates.nodes]))
    return [leaf for leaf in pen.moving() if leaf in found]


def rates_by(pen: Pen, slopes: Slopes) -> list[str]:
    """How the rates move with the parameters."""
    plan, n, real = pen.plan, pen.name, pen.real
    if not plan.flowing:
        return []
    rows = {
        one.at + i: name for one in plan.flowing for i, name in enumerate(one.elements)
    }  # fmt: skip
    partial = _rows(slopes.rates, rows)
    lines = _product(
        pen, partial, rows, ("by[i].{}", "rates[i].{} =", "rates[{}].{} += {};"), from_struct=False
    )  # fmt: skip
    given = [f"const {n} *a", f"const {n}_states *x"]
    given += [f"{real} {leaf}" for leaf in moving_by(pen)]
    given += [f"const {n}_states *by", f"{n}_rates *rates"]
    names = ["a", "x", *moving_by(pen), "by"]
    return [
        "/* How the rates move with each parameter, where the states move with it as said. */",
        *wrapped(f"static inline void {n}_rates_by({', '.join(given)})", WIDTH),
        *braced([*_unused(names, lines), *lines]),
        "",
        "/* All tangents along a straight line. */",
        *wrapped(
            f"static inline void {n}_along_by(const {n}_states *by, {real} h, "
            f"const {n}_rates *rates, {n}_states *moved)", WIDTH,
        ),
        *braced([each(pen), f"    {n}_along(&by[i], h, &rates[i], &moved[i]);"]),
        "",
        "/* Sums of their rates. */",
        *wrapped(
            f"static inline void {n}_gather_by({n}_rates *sum, {real} weight, "
            f"const {n}_rates *rates)", WIDTH,
        ),
        *braced([each(pen), f"    {n}_gather(&sum[i], weight, &rates[i]);"]),
    ]  # fmt: skip


def jump_by(pen: Pen, slopes: Slopes) -> list[str]:
    """How the states behind a jump move with the parameters; asked before the jump."""
    plan, n = pen.plan, pen.name
    if plan.jumps is None:
        return []
    rows = {
        one.at + i: name
        for one in plan.states
        for i, (name, k) in enumerate(
            zip(one.elements, plan.nodes(one, plan.jumps), strict=True)
        )
        if plan.graph.nodes[k].name != f"x->{name}"
    }  # fmt: skip
    body = _product(
        pen, _rows(slopes.jumps, rows), rows, ("before.{}", "t->by[i].{} =", "t->by[{}].{} += {};"),
        first=[f"const {n}_states before = t->by[i];"], from_struct=True,
    )  # fmt: skip
    return [
        "/* The tangents behind a jump, while the states are still before it. */",
        f"static void {n}_jump_by(const {n} *a, {n}_{TANGENTS} *t)",
        *braced([*_unused(["a"], body), *body]),
    ]


def start_by(pen: Pen, slopes: Slopes) -> list[str]:
    """How the states at rest move with the parameters."""
    plan, n = pen.plan, pen.name
    rows = {one.at + i: name for one in plan.states for i, name in enumerate(one.elements)}
    lines = _product(
        pen, _rows(slopes.start, rows), rows, ("", "t->by[i].{} =", "t->by[{}].{} += {};"),
        from_struct=True,
    )  # fmt: skip
    if "time" in plan.graph.leaves(slopes.start.nodes):
        # The time of a start.
        lines = [line for line in lines if line != f"const {pen.real} time = a->time;"]
        lines.insert(0, f"const {pen.real} time = {pen.number(0.0)};")
    if not rows:
        lines = ["t->none = 0;"]
    return [
        f"void {n}_start_{SENSITIVITIES}(const {n} *a, {n}_{TANGENTS} *t)",
        *braced([*_unused(["a"], lines), *lines]),
    ]


SENSITIVITIES: Final = "sensitivities"
"""What the functions that a program calls end with."""


def output_by(pen: Pen, slopes: Slopes) -> list[str]:
    """How the reading moves with the parameters."""
    n = pen.name
    partial = slopes.reading
    lines = _product(
        pen, partial, {0: ""}, ("t->by[i].{}", "by[i]{} =", "by[{}]{} += {};"), from_struct=True
    )  # fmt: skip
    given = f"const {n} *a, const {n}_{TANGENTS} *t, {pen.real} *by"
    return [
        *wrapped(f"void {n}_output_{SENSITIVITIES}({given})", WIDTH),
        *braced([*_unused(["a", "t"], lines), *lines]),
    ]


def _rows(partial: Partial, rows: dict[int, str]) -> Partial:
    """Only some rows."""
    by_state, by_parameter = (
        tuple(e for e in of if e[0] in rows) for of in (partial.by_state, partial.by_parameter)
    )
    return Partial(by_state, by_parameter)


def _product(
    pen: Pen,
    partial: Partial,
    rows: dict[int, str],
    how: tuple[str, str, str],
    *,
    from_struct: bool,
    first: Sequence[str] = (),
) -> list[str]:
    """Lines that multiply derivatives with tangents, for each parameter, and add its own.

    Args:
        pen: what writes.
        partial: the derivatives.
        rows: name of each row in C.
        how: the tangent of a state, where a row goes, and how a parameter's own part is added.
        from_struct: whether states and inputs are those of the struct.
        first: lines at the head of the loop.
    """
    plan = pen.plan
    columns = [name for one in plan.states for name in one.elements]
    parameters = [one.name for one in plan.parameters]
    tangent, target, own = how
    wanted = {one.at for one in moved_by(plan)}
    mine = tuple(entry for entry in partial.by_parameter if entry[1] in wanted)
    results: list[tuple[str, int]] = []
    said: dict[tuple[int, str], str] = {}
    for entries, of in ((partial.by_state, columns), (mine, parameters)):
        for row, column, k in entries:
            node = plan.graph.nodes[k]
            if node.kind == "number":
                said[row, of[column]] = pen.number(node.value)
                continue
            name = f"{_word(rows[row]) or 'reading'}_by_{_word(of[column])}"
            results.append((f"const {pen.real} {name} =", k))
            said[row, of[column]] = name
    lines = pen.written(results, from_struct=from_struct) if results else []
    inside = [*first]
    for row, name in rows.items():
        terms = [
            _times(said[row, columns[c]], tangent.format(columns[c]), pen)
            for r, c, _ in partial.by_state if r == row
        ]  # fmt: skip
        sum_of = " + ".join(terms).replace("+ -", "- ") or pen.number(0.0)
        inside += wrapped(f"{target.format(name)} {sum_of};", WIDTH - 8)
    if inside:
        lines += [f"{each(pen)} {{", *(f"    {line}" for line in inside), "}"]
    for row, column, _ in mine:
        which = f"{pen.name}_by_{parameters[column]}"
        lines += wrapped(own.format(which, rows[row], said[row, parameters[column]]))
    return lines


def _per(unit: str, other: str) -> str:
    """A unit over another one."""
    if other == "1":
        return unit
    return f"{unit}/({other})" if set(other) & set("*/") else f"{unit}/{other}"


def _times(factor: str, tangent: str, pen: Pen) -> str:
    if factor == pen.number(1.0):
        return tangent
    return f"-{tangent}" if factor == pen.number(-1.0) else f"{factor} * {tangent}"


def _word(name: str) -> str:
    """A state's element as part of a name."""
    return re.sub(r"\W+", "_", name).strip("_")


def _unused(names: Sequence[str], lines: Sequence[str]) -> list[str]:
    """A word for the compiler about arguments that a model does not need."""
    text = "\n".join(lines)
    return [f"(void){one};" for one in names if not re.search(rf"\b{one}\b", text)]


def declared(pen: Pen) -> list[str]:
    """What the header says of it."""
    plan, n, real = pen.plan, pen.name, pen.real
    own = moved_by(plan)
    names = [f"{n}_by_{one.name}" for one in own]
    unit = pen.reading_unit
    says = [
        f"    {name + ('' if k else ' = 0') + ',':<34} /* [{naming.plain(_per(unit, one.unit))}] */"
        for k, (name, one) in enumerate(zip(names, own, strict=True))
    ]
    held = f"    {n}_states by[{count(pen)}];" if plan.states else "    char none;"
    return [
        "/* Derivatives by the parameters: the place of each, and its unit in the reading. */",
        "enum {",
        *says,
        f"    {count(pen)}",
        "};",
        "",
        "/* How the states move with each parameter. */",
        "typedef struct {",
        held,
        f"}} {n}_{TANGENTS};",
        "",
        f"/* The tangents at rest: right behind {n}_init() or {n}_start(). */",
        f"void {n}_start_{SENSITIVITIES}(const {n} *a, {n}_{TANGENTS} *t);",
        "",
        f"/* As {n}_step(), and the derivative of the reading by each parameter to by[]. */",
        *wrapped(
            f"{real} {n}_step_{SENSITIVITIES}({n} *a, {n}_{TANGENTS} *t, {real} interval, "
            f"{pen.inputs()}, {real} *by);", WIDTH,
        ),
        "",
        "/* The derivatives of the reading now. */",
        *wrapped(
            f"void {n}_output_{SENSITIVITIES}(const {n} *a, const {n}_{TANGENTS} *t, {real} *by);",
            WIDTH,
        ),
        "",
    ]  # fmt: skip


Write = Callable[[Pen, Slopes], list[str]]
EQUATIONS: Final[tuple[Write, ...]] = (output_by, rates_by, jump_by)
"""What stands before the sub-step."""
