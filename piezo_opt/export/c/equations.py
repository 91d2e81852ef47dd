"""The equations as functions of C: reading, rates, jumps, and what follows from parameters."""

from __future__ import annotations

from piezo_opt.export.c import naming
from piezo_opt.export.c.pen import Pen, braced, comment
from piezo_opt.export.c.printer import WIDTH, wrapped


def output(pen: Pen) -> list[str]:
    """The reading of the struct as it is."""
    lines = pen.written([("return", pen.plan.reading)], from_struct=True)
    unused = [] if any("a->" in line for line in lines) else ["(void)a;"]
    n, real = pen.name, pen.real
    return [
        f"static inline {real} {n}_reading(const {n} *a)",
        *braced([*unused, *lines]),
        "",
        f"{real} {n}_output(const {n} *a)",
        *braced([f"return {n}_reading(a);"]),
    ]


def arguments(pen: Pen) -> list[str]:
    """What the rates read beside states and parameters."""
    found = set(pen.plan.graph.leaves(pen.plan.rates))
    return [leaf for leaf in pen.moving() if leaf in found]


def rates(pen: Pen) -> list[str]:
    """How fast the states move; and what a scheme does with that."""
    plan, n = pen.plan, pen.name
    if not plan.flowing:
        return []
    results = [
        (f"rates->{name} =", k)
        for one in plan.flowing
        for name, k in zip(one.elements, plan.nodes(one, plan.rates), strict=True)
    ]
    lines = pen.written(results, from_struct=False)
    unused = [
        f"(void){short};"
        for short, sign in (("a", "a->"), ("x", "x->"))
        if not any(sign in line for line in lines)
    ]
    given = [f"const {n} *a", f"const {n}_states *x"]
    given += [f"{pen.real} {leaf}" for leaf in arguments(pen)]
    said = [
        f"{effect}: {'; '.join(naming.plain(line) for line in kind.equation.splitlines())}"
        for effect, kind in plan.given.model
    ]
    return [
        *comment("How fast the states move at one instant.", *said),
        *wrapped(f"static inline void {n}_rates_at({', '.join(given)}, {n}_rates *rates)", WIDTH),
        *braced([*unused, *lines]),
        "",
        "/* States along a straight line. */",
        *wrapped(
            f"static inline void {n}_along(const {n}_states *x, {pen.real} h, "
            f"const {n}_rates *rates, {n}_states *moved)", WIDTH,
        ),
        *braced([
            "*moved = *x;",
            *(f"moved->{name} += h * rates->{name};" for name in pen.flowing()),
        ]),
        "",
        "/* A sum of rates. */",
        f"static inline void {n}_gather({n}_rates *sum, {pen.real} weight, const {n}_rates *rates)",
        *braced([f"sum->{name} += weight * rates->{name};" for name in pen.flowing()]),
    ]  # fmt: skip


def jump(pen: Pen) -> list[str]:
    """What becomes of states that jump."""
    plan = pen.plan
    if plan.jumps is None:
        return []
    jumping = [
        (f"after.{name} =", k)
        for one in plan.states
        for name, k in zip(one.elements, plan.nodes(one, plan.jumps), strict=True)
        if plan.graph.nodes[k].name != f"x->{name}"
    ]
    lines = pen.written(jumping, from_struct=True)
    return [
        "/* What remembers turns: its value after a stretch of the drive in one direction. */",
        f"static void {pen.name}_jump({pen.name} *a)",
        *braced([
            f"{pen.name}_states after = a->states;", *lines, "a->states = after;",
        ]),
    ]  # fmt: skip


def prepare(pen: Pen) -> list[str]:
    """What follows from the parameters alone."""
    plan, n = pen.plan, pen.name
    if not plan.derived:
        return []
    results = [(f"d->{name} =", k) for name, k in plan.derived.items()]
    lines = pen.written(results, from_struct=False, derived=False)
    alias = f"{n}_derived *const d = &a->derived;"
    lines = [alias, *(line for line in lines if "*const d =" not in line)]
    return [f"void {n}_prepare({n} *a)", *braced(lines)]
