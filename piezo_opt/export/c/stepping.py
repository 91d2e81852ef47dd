"""How time passes: the start, the sub-step, and the interval between two calls."""

from __future__ import annotations

from piezo_opt.export.c.cutting import cut
from piezo_opt.export.c.delayed import delayed_lines
from piezo_opt.export.c.equations import arguments
from piezo_opt.export.c.pen import Pen, braced
from piezo_opt.export.c.printer import WIDTH, wrapped
from piezo_opt.export.c.tangents import SENSITIVITIES, TANGENTS, count, moving_by


def adder(pen: Pen) -> list[str]:
    """The sum that remembers its rounding, for numbers of four bytes."""
    if not (pen.compensated or pen.timed_lost):
        return []
    real = pen.real
    return [
        "/* A sum that remembers what rounding took from it (Kahan 1965); it needs a",
        "   compiler that does not reorder additions. */",
        f"static void {pen.name}_add({real} *sum, {real} *lost, {real} more)",
        *braced([
            f"const {real} whole = more - *lost;",
            f"const {real} next = *sum + whole;",
            "*lost = (next - *sum) - whole;",
            "*sum = next;",
        ]),
    ]  # fmt: skip


def substep(pen: Pen, moved: bool = False) -> list[str]:
    """A sub-step: the scheme, and what jumps behind it.

    Args:
        pen: what writes.
        moved: whether the tangents move along.
    """
    plan, n, real = pen.plan, pen.name, pen.real
    if not (plan.flowing or plan.jumps):
        return []
    lines: list[str] = []
    if plan.flowing:
        lines += [
            f"const {real} half = {pen.number(0.5)} * h;",
            f"{n}_rates sum, k;",
            f"{n}_states x;",
        ]
        if moved:
            each_one = count(pen)
            lines += [
                f"{n}_rates sum_by[{each_one}], k_by[{each_one}];",
                f"{n}_states x_by[{each_one}];",
            ]
        lines += stage(pen, "&a->states", "", "sum", moved)
        for by, before, weight in (("half", "sum", 2.0), ("half", "k", 2.0), ("h", "k", 1.0)):
            lines += [f"{n}_along(&a->states, {by}, &{before}, &x);"]
            if moved:
                lines += [f"{n}_along_by(t->by, {by}, {before}_by, x_by);"]
            lines += [
                *stage(pen, "&x", by, "k", moved),
                f"{n}_gather(&sum, {pen.number(weight)}, &k);",
            ]
            if moved:
                lines += [f"{n}_gather_by(sum_by, {pen.number(weight)}, k_by);"]
        lines += [f"const {real} sixth = h * {pen.number(1.0 / 6.0)};"]
        for name in pen.flowing():
            if pen.compensated:
                said = f"{n}_add(&a->states.{name}, &a->lost.{name}, sixth * sum.{name});"
            else:
                said = f"a->states.{name} += sixth * sum.{name};"
            lines += wrapped(said)
        if moved:
            lines += [f"{n}_along_by(t->by, sixth, sum_by, t->by);"]
    if plan.timed:
        lines += [f"{n}_add(&a->time, &a->time_lost, h);" if pen.timed_lost else "a->time += h;"]
    for one in (plan.input, *plan.channels):
        lines += [f"a->{one} += a->{one}_rate * h;"]
    if plan.jumps is not None:
        lines += [f"{n}_jump_by(a, t);"] if moved else []
        lines += [f"{n}_jump(a);"]
    scheme = "the classical Runge-Kutta scheme of order four" if plan.flowing else "exact"
    head = f"{n}_inline void {n}_substep({n} *a, {real} h)"
    if moved:
        head = f"static inline void {n}_substep_by({n} *a, {n}_{TANGENTS} *t, {real} h)"
        return ["/* The same, and the tangents move along. */", head, *braced(lines)]
    return [f"/* A sub-step h [s]: {scheme}. */", head, *braced(lines)]


def stage(pen: Pen, states: str, by: str, into: str, moved: bool = False) -> list[str]:
    """The rates at some states, some way into a sub-step."""
    given = ["a", states, *(inside(leaf, by) for leaf in arguments(pen)), f"&{into}"]
    lines = wrapped(f"{pen.name}_rates_at({', '.join(given)});")
    if moved:
        tangents = "x_by" if by else "t->by"
        given = ["a", states, *(inside(leaf, by) for leaf in moving_by(pen))]
        lines += wrapped(f"{pen.name}_rates_by({', '.join((*given, tangents, f'{into}_by'))});")
    return lines


def inside(leaf: str, by: str) -> str:
    """A moving input some way into a sub-step."""
    if not by or leaf.endswith("_rate"):
        return f"a->{leaf}"
    if leaf == "time":
        return f"a->time + {by}"
    return f"a->{leaf} + a->{leaf}_rate * {by}"


def start(pen: Pen) -> list[str]:
    """The states at rest."""
    plan, n = pen.plan, pen.name
    zero = pen.number(0.0)
    lines: list[str] = []
    for one in (plan.input, *plan.channels):
        lines += [f"a->{one} = {one};", f"a->{one}_rate = {zero};"]
    if plan.delay is not None:
        lines += [f"{n}_still(a, {plan.input});"]
    if plan.timed:
        lines += [f"a->time = {zero};"]
        if pen.timed_lost:
            lines += [f"a->time_lost = {zero};"]
    if pen.compensated:
        lines += [f"a->lost.{name} = {zero};" for name in pen.flowing()]
    if plan.derived:
        lines += [f"{n}_prepare(a);"]
    results = [
        (f"a->states.{name} =", k)
        for one in plan.states
        for name, k in zip(one.elements, plan.nodes(one, plan.start), strict=True)
    ]
    if results:
        # A time that is asked for is that of the start.
        lines += pen.written(results, from_struct=False)
        if "time" in plan.graph.leaves(plan.start):
            lines.insert(0, f"const {pen.real} time = {zero};")
    aliases = [line for line in lines if "*const" in line]
    return [
        f"void {n}_start({n} *a, {pen.inputs()})",
        *braced([*aliases, *(line for line in lines if line not in aliases)]),
    ]


def init(pen: Pen) -> list[str]:
    """The values of the fit, then the start."""
    plan, n = pen.plan, pen.name
    lines = [
        f"a->parameters.{one.name} = {pen.number(plan.given.values[one.full])};"
        for one in plan.parameters
    ]
    if plan.flowing or plan.jumps:
        for field, value in (
            ("longest_substep", plan.substeps.longest),
            ("largest_move", plan.substeps.largest_move),
        ):
            # A limit that is none, written so that it needs no header.
            lines += [f"a->{field} = {pen.number(min(value, 1e30))};"]
    inputs = ", ".join(("a", plan.input, *plan.channels))
    return [
        f"void {n}_init({n} *a, {pen.inputs()})",
        *braced([*lines, f"{n}_start({inputs});"]),
    ]


def step(pen: Pen, moved: bool = False) -> list[str]:
    """An interval between two calls, cut into sub-steps.

    Args:
        pen: what writes.
        moved: whether the tangents move along.
    """
    n, real = pen.name, pen.real
    inner = _interval(pen, moved)
    if not moved:
        return [
            "/* An interval; within a loop of many the actuator may then stay in registers. */",
            f"{n}_inline {real} {n}_advance({n} *a, {real} interval, {pen.inputs()})",
            *braced([
                f"if (!(interval > {pen.number(0.0)})) return {n}_reading(a);", *inner,
                f"return {n}_reading(a);",
            ]),
            "",
            f"{real} {n}_step({n} *a, {real} interval, {pen.inputs()})",
            *braced([f"return {n}_advance(a, interval, {', '.join(pen.names())});"]),
            "",
            *_run(pen),
        ]  # fmt: skip
    given = f"{n} *a, {n}_{TANGENTS} *t, {real} interval, {pen.inputs()}, {real} *by"
    unused = [] if any("(a, t" in line for line in inner) else ["(void)t;"]
    return [
        *wrapped(f"{real} {n}_step_{SENSITIVITIES}({given})", WIDTH),
        *braced([
            *unused,
            f"if (interval > {pen.number(0.0)}) {{", *(f"    {line}" for line in inner), "}",
            f"{n}_output_{SENSITIVITIES}(a, t, by);",
            f"return {n}_reading(a);",
        ]),
    ]  # fmt: skip


def run_arguments(pen: Pen) -> str:
    """What the loop over many intervals is given."""
    real = pen.real
    rows = ", ".join(f"const {real} *{one}" for one in pen.names())
    return f"{pen.name} *a, {real} interval, long count, {rows}, {real} *reading"


def _run(pen: Pen) -> list[str]:
    """Many intervals of equal length."""
    n = pen.name
    now = ", ".join(f"{one}[i]" for one in pen.names())
    # A ring is no good in registers.
    own = pen.plan.delay is None
    of = "&one" if own else "a"
    said = f"for (long i = 0; i < count; ++i) reading[i] = {n}_advance({of}, interval, {now});"
    lines = wrapped(said)
    return [
        *wrapped(f"void {n}_run({run_arguments(pen)})", WIDTH),
        *braced([f"{n} one = *a;", *lines, "*a = one;"] if own else lines),
    ]


def _interval(pen: Pen, moved: bool) -> list[str]:
    """What happens between two calls."""
    plan, n = pen.plan, pen.name
    if plan.delay is not None:
        return delayed_lines(pen, f"{n}_follow_by(a, t, length)" if moved
                             else f"{n}_follow(a, length)")  # fmt: skip
    inputs = (plan.input, *plan.channels)
    lines: list[str] = []
    if plan.flowing or plan.jumps:
        lines += cut(pen, "interval", f"{plan.input} - a->{plan.input}")
    lines += [f"a->{one}_rate = ({one} - a->{one}) / interval;" for one in inputs]
    if plan.flowing or plan.jumps:
        by = f"{n}_substep_by(a, t, h)" if moved else f"{n}_substep(a, h)"
        lines += [f"for (long i = 0; i < count; ++i) {by};"]
    elif plan.timed:
        said = f"{n}_add(&a->time, &a->time_lost, interval);"
        lines += [said if pen.timed_lost else "a->time += interval;"]
    return lines + [f"a->{one} = {one};" for one in inputs]
