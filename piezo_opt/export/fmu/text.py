"""The C around a model that makes it a unit: what both versions of the standard share.

The interface is that of the FMI standard (Modelica Association, 2.0.4 and 3.0.2); its names and
numbers are facts of the standard, declared here as far as they are used.
"""

from __future__ import annotations

from collections.abc import Sequence

from piezo_opt.export.c.plan import Plan
from piezo_opt.export.fmu.variables import INPUT, PARAMETER, RATE, STATE, Variable


def shared(plan: Plan, variables: Sequence[Variable], token: str, exchange: bool) -> str:
    """An instance, and how its variables are read, set, started and moved."""
    n = plan.prefix
    inputs = (plan.input, *plan.channels)
    own = [v for v in variables if v.place and v.role != RATE]
    places = "\n".join(f"    case {v.reference}: return &m->{v.place};" for v in own)
    settable = [v for v in variables if v.role in (PARAMETER, INPUT)]
    settable += [v for v in variables if exchange and v.role == STATE]
    cases = "".join(f" case {v.reference}:" for v in settable)
    parameters = [v.reference for v in variables if v.role == PARAMETER]
    prepare = f"    if (a_parameter(r)) {n}_prepare(&m->one);\n" if plan.derived else ""
    known = (
        f"static int a_parameter(unsigned r) {{ return r <= {max(parameters)}u; }}\n"
        if plan.derived else ""
    )  # fmt: skip
    start_values = "\n".join(
        f"    m->wanted.{name} = {293.15 if full == 'temperature' else 0.0!r};"
        for name, full in zip(inputs, ("", *plan.system.channel_names), strict=True)
    )
    held = ", ".join(f"m->wanted.{name}" for name in inputs)
    moved = ", ".join(
        f"m->rated.{name} ? m->wanted.{name} + m->rate.{name} * h : m->wanted.{name}"
        for name in inputs
    )
    clear = "\n".join(f"    m->rated.{name} = 0;" for name in inputs)
    numbers = "\n".join(f"    double {name};" for name in inputs)
    flags = "\n".join(f"    int {name};" for name in inputs)
    begin = ", ".join(f"m->one.{name}" for name in inputs) if exchange else held
    passing = (
        "" if exchange else f"""
/* An interval passes: each input goes along a straight line, to where its rate leads from what was
   set, or else to what was set. */
static void pass(unit *m, double h)
{{
    {n}_step(&m->one, h, {moved});
{clear}
}}
"""
    )  # fmt: skip
    return f"""\
/* Made of {n}.c, whose own functions it calls. */
#include "{n}.c"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#define TOKEN "{token}"

typedef struct {{
{numbers}
}} numbers;

typedef struct {{
{flags}
}} flags;

typedef struct {{
    {n} one;
    numbers wanted;                    /* inputs, as they were set last */
    numbers rate;                      /* their rates, where they were told */
    flags rated;
    double begun;                      /* time at the start [s] */
    int initialising;
}} unit;

/* Where a variable stands; NULL where it is computed. */
static double *place(unit *m, unsigned r)
{{
    switch (r) {{
{places}
    default: return NULL;
    }}
}}

static int settable(unsigned r)
{{
    switch (r) {{
   {cases} return 1;
    default: return 0;
    }}
}}

{known}{_reading(plan, variables, exchange)}
static void restart(unit *m)
{{
    memset(m, 0, sizeof *m);
{start_values}
    {n}_init(&m->one, {held});
}}

/* The states at rest under the inputs as they are. */
static void rest(unit *m)
{{
    {n}_start(&m->one, {begin});
}}

static int set(unit *m, unsigned r, double value)
{{
    if (!settable(r)) return 0;
    *place(m, r) = value;
{prepare}    return 1;
}}
{passing}"""


def _reading(plan: Plan, variables: Sequence[Variable], exchange: bool) -> str:
    """How a variable is read."""
    n = plan.prefix
    output = next(v.reference for v in variables if v.role == "output")
    text = """\
static int get(unit *m, unsigned r, double *value)
{
    double *at = place(m, r);
"""
    if exchange and plan.flowing:
        rates = "\n".join(
            f"    case {v.reference}: *value = k.{v.place.removeprefix('k.')}; return 1;"
            for v in variables if v.role == RATE
        )  # fmt: skip
        text = _rates(plan) + text
        body = f"""\
    {n}_rates k;
    if (at) {{
        *value = *at;
        return 1;
    }}
    if (r == {output}u) {{
        *value = {n}_output(&m->one);
        return 1;
    }}
    rates_now(m, &k);
    switch (r) {{
{rates}
    default: return 0;
    }}
}}
"""
        return text + body
    return (
        text
        + f"""\
    if (at) *value = *at;
    else if (r == {output}u) *value = {n}_output(&m->one);
    else return 0;
    return 1;
}}
"""
    )


def _rates(plan: Plan) -> str:
    n = plan.prefix
    leaves = set(plan.graph.leaves(plan.rates))
    both = [x for one in (plan.input, *plan.channels) for x in (one, f"{one}_rate")]
    given = ["&m->one", "&m->one.states", *(f"m->one.{x}" for x in ("time", *both) if x in leaves)]
    return f"""\
static void rates_now(unit *m, {n}_rates *k)
{{
    {n}_rates_at({", ".join(given)}, k);
}}

"""
