"""What the laws share: their files' frames, and how they refuse what is no number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

from piezo_opt.control import Limits
from piezo_opt.export.c.printer import Precision

FAR: Final = 1e30
"""A limit that is none [V]."""


@final
@dataclass(frozen=True)
class Written:
    """C of one law.

    Attributes:
        title: what it is, in a line.
        header, source: the files' text.
        inputs: what ``act`` takes at every sample, with units.
        call: how a program calls it on ``row``.
        output: what it gives, with its unit.
    """

    title: str
    header: str
    source: str
    inputs: tuple[str, ...]
    call: str
    output: str


_HEADER: Final = """\
/* {n}: {title}
{about}   Call {n}_init once, then {n}_act every {period} s. Nothing is allocated; every call
   takes the same steps. SI units. */
#ifndef {guard}_H
#define {guard}_H

#ifdef __cplusplus
extern "C" {{
#endif

/* What {n}_act says in the member status: a sum of these. The answer is a number in any
   case, and within the limits. */
enum {{
    {n}_LIMITED = 1, /* the limits were met */
    {n}_MISSED = 2{comma}  /* what was given is no number, or leads to none: passed over */
{states}}};

{before}typedef struct {{
{members}    int status;                    /* of the last call */
}} {n};

/* The state before the first sample. */
void {n}_init({n} *c);

/* {act} */
{real} {n}_act({n} *c, {arguments});
{after}
#ifdef __cplusplus
}}
#endif

#endif
"""

_SOURCE: Final = """\
/* {n}: {title} */
#include "{n}.h"

#include <float.h>
#include <math.h>

/* Whether a is a number: neither infinite nor none. */
static int {n}_is_number({real} a)
{{
    return {fabs}(a) <= {largest};
}}

{body}"""

WITHIN: Final = """\
static {real} {n}_within({real} a, {real} low, {real} high)
{{
    const {real} b = a < low ? low : a;
    return b > high ? high : b;
}}

"""

LIMITS: Final = """\
    const {real} low = {n}_within(c->drive - c->move, c->low, c->high);
    const {real} high = {n}_within(c->drive + c->move, c->low, c->high);
"""
"""As :meth:`piezo_opt.control.Limits.around` has them: the range goes before the slew rate."""

LIMIT_MEMBERS: Final = (
    ("low", "lowest drive [V]"),
    ("high", "highest drive [V]"),
    ("move", "largest change of the drive in a period [V]"),
)


def numbers(limits: Limits, period: float) -> dict[str, float]:
    """Values of the members of limits."""
    return {
        "low": max(limits.low, -FAR), "high": min(limits.high, FAR),
        "move": min(limits.slew * period, FAR),
    }  # fmt: skip


def members(precision: Precision, pairs: tuple[tuple[str, str], ...]) -> str:
    """Lines of a struct: a name and its meaning each."""
    lines = []
    for name, meaning in pairs:
        declared = f"    {precision.name} {name};"
        lines.append(f"{declared:<34} /* {meaning} */\n")
    return "".join(lines)


def framed(
    name: str, precision: Precision, title: str, about: str, period: float, fields: str, act: str,
    arguments: str, body: str, *, before: str = "", states: str = "", after: str = "",
) -> tuple[str, str]:  # fmt: skip
    """Header and source around a body; what else is declared before, as a status, and after."""
    words = {
        "n": name, "guard": name.upper(), "real": precision.name, "title": title,
        "about": "".join(f"   {line}\n" for line in about.splitlines()), "period": f"{period:g}",
        "members": fields, "act": act, "arguments": arguments,
        "fabs": precision.call("fabs"), "largest": "FLT_MAX" if precision.is_float else "DBL_MAX",
        "body": body, "before": before, "states": states, "after": after,
        "comma": "," if states else " ",
    }  # fmt: skip
    return _HEADER.format(**words), _SOURCE.format(**words)
