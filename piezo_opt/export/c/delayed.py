"""A delay: lines of the input wait in a ring of fixed size, and the actuator follows them later.

The chain runs on the clock of its input, as in the library: what it reads at a time t is what the
input has done until t - T. A call hands over one line of the input, and the actuator follows what
is older than T, line by line, so that every corner is met where it is.
"""

from __future__ import annotations

from piezo_opt.export.c.cutting import cut
from piezo_opt.export.c.pen import Pen, braced


def late(pen: Pen) -> list[list[str]]:
    """The delay, the ring at rest, and how a stretch of a line is followed."""
    plan, n, real = pen.plan, pen.name, pen.real
    if plan.delay is None:
        return []
    u, zero = plan.input, pen.number(0.0)
    lag = pen.written([("return", plan.delay)], from_struct=True)
    unused = [] if any("a->" in line for line in lag) else ["(void)a;"]
    return [
        [
            "/* By how much the actuator lags its input [s]. */",
            f"static {real} {n}_lag(const {n} *a)",
            *braced([*unused, *lag]),
        ],
        [
            "/* An input that has been still for as long as matters. */",
            f"static void {n}_still({n} *a, {real} {u})",
            *braced([
                f"const {n}_line still = {{{n}_lag(a), {zero}, {u}}};",
                "a->lines[0] = still;", "a->oldest = 0;", "a->waiting = 1;",
                f"a->last_{u} = {u};",
            ]),
        ],
        follow(pen, ""),
    ]  # fmt: skip


def follow(pen: Pen, tangents: str) -> list[str]:
    """A stretch of the oldest line.

    Args:
        pen: what writes.
        tangents: type of the struct that moves along; empty where none does.
    """
    plan, n, real = pen.plan, pen.name, pen.real
    if plan.delay is None:
        return []
    u = plan.input
    if plan.flowing or plan.jumps:
        by = f"{n}_substep_by(a, t, h)" if tangents else f"{n}_substep(a, h)"
        lines = [
            *cut(pen, "length", f"a->{u}_rate * length"),
            f"for (long i = 0; i < count; ++i) {by};",
        ]
    else:
        lines = [f"a->{one} += a->{one}_rate * length;" for one in (u, *plan.channels)]
        if plan.timed:
            lines += [
                f"{n}_add(&a->time, &a->time_lost, length);" if pen.timed_lost
                else "a->time += length;"
            ]  # fmt: skip
        lines += ["(void)t;"] if tangents else []
    along = f"_by({n} *a, {tangents} *t, {real} length)" if tangents else f"({n} *a, {real} length)"
    return [
        "/* A stretch of the oldest line. */",
        f"static void {n}_follow{along}",
        *braced(lines),
    ]


def delayed_lines(pen: Pen, follows: str) -> list[str]:
    """An interval between two calls in a chain with a delay, which is longer than nothing.

    Args:
        pen: what writes.
        follows: the call that follows a stretch of the oldest line.
    """
    plan, n, real, zero = pen.plan, pen.name, pen.real, pen.number(0.0)
    u, most = plan.input, f"{n.upper()}_LINES"
    return [
        f"const {n}_line line = {{interval, ({u} - a->last_{u}) / interval, {u}}};",
        f"{real} ahead = -{n}_lag(a);",
        f"if (a->waiting == {most}) {{",
        "    /* Too many wait: the two oldest ones become one. */",
        f"    const {n}_line first = a->lines[a->oldest];",
        f"    a->oldest = (a->oldest + 1) % {most};",
        f"    {n}_line *const joint = &a->lines[a->oldest];",
        "    joint->length += first.length;",
        f"    joint->rate = (joint->end - a->{u}) / joint->length;",
        "    --a->waiting;",
        "}",
        f"a->lines[(a->oldest + a->waiting) % {most}] = line;",
        "++a->waiting;",
        f"a->last_{u} = {u};",
        f"for (int i = 0; i < a->waiting; ++i) ahead += a->lines[(a->oldest + i) % {most}].length;",
        *(
            f"a->{one}_rate = ahead > {zero} ? ({one} - a->{one}) / ahead : {zero};"
            for one in plan.channels
        ),
        f"while (ahead > {zero} && a->waiting > 0) {{",
        f"    {n}_line *const old = &a->lines[a->oldest];",
        f"    const {real} length = old->length < ahead ? old->length : ahead;",
        f"    a->{u}_rate = old->rate;",
        f"    {follows};",
        "    ahead -= length;",
        "    old->length -= length;",
        f"    if (!(old->length > {zero})) {{",
        f"        a->{u} = old->end;",
        f"        a->oldest = (a->oldest + 1) % {most};",
        "        --a->waiting;",
        "    }",
        "}",
        *(f"a->{one} = {one};" for one in plan.channels),
    ]
