"""State feedback with an observer as C, the law of :class:`piezo_opt.control.LQG`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from piezo_opt.control import LQG, Limits
from piezo_opt.export.c.printer import Precision
from piezo_opt.export.laws import written
from piezo_opt.export.laws.written import Written

_TITLE: Final = "a linear-quadratic regulator on the estimate of a Kalman filter."
_ABOUT: Final = """\
   v = y - y_0 - C x,   x+ = x + L v,   d+ = d + l v
   u = N (r - y_0) - K x+ - d+,   x = A x+ + B (u + d+)
r: reference, y: reading, d: disturbance of the drive, which takes the offset.
Franklin, Powell & Workman (1998), Digital Control of Dynamic Systems, ch. 8."""
_BODY: Final = """\
#define STATES {states}

static const {real} A[STATES][STATES] = {{
{a}
}};
static const {real} B[STATES] = {{{b}}};
static const {real} C[STATES] = {{{c}}};
static const {real} K[STATES] = {{{k}}};
static const {real} L[STATES] = {{{l}}};
static const {real} L_D = {l_d}; /* [V/m] */
static const {real} N = {ahead}; /* [V/m] */
static const {real} Y_0 = {rest}; /* [m] */
static const {real} LARGEST = {largest}; /* surprise beyond which it is cut [m] */

{within}void {n}_init({n} *c)
{{
    int i;
{assigned}    for (i = 0; i < STATES; ++i) c->x[i] = {zero};
    c->disturbance = c->drive = {zero};
    c->status = 0;
}}

/* One sample with a surprise [m] of the reading; whether everything is a number. */
static int {n}_sample({n} *c, {real} reference, {real} surprise, {real} low, {real} high)
{{
    {real} x[STATES], next[STATES], wanted, drive;
    const {real} d = c->disturbance + L_D * surprise;
    int i, j, sound = {n}_is_number(d);
    wanted = N * (reference - Y_0);
    for (i = 0; i < STATES; ++i) {{
        x[i] = c->x[i] + L[i] * surprise;
        wanted -= K[i] * x[i];
    }}
    wanted -= d;
    if (!{n}_is_number(wanted)) {{
        /* Without a reference the drive is held. */
        wanted = c->drive;
        c->status |= {n}_MISSED;
    }}
    drive = {n}_within(wanted, low, high);
    for (i = 0; i < STATES; ++i) {{
        next[i] = {zero};
        for (j = 0; j < STATES; ++j) next[i] += A[i][j] * x[j];
        next[i] += B[i] * (drive + d);
        sound = sound && {n}_is_number(next[i]);
    }}
    if (!sound) return 0;
    for (i = 0; i < STATES; ++i) c->x[i] = next[i];
    c->disturbance = d;
    c->drive = drive;
    if (drive < wanted || drive > wanted) c->status |= {n}_LIMITED;
    return 1;
}}

{real} {n}_act({n} *c, {real} reference, {real} reading)
{{
{limits}    {real} surprise = reading - Y_0;
    int i;
    for (i = 0; i < STATES; ++i) surprise -= C[i] * c->x[i];
    c->status = 0;
    if ({n}_is_number(surprise)) {{
        surprise = {n}_within(surprise, -LARGEST, LARGEST);
        if ({n}_sample(c, reference, surprise, low, high)) return c->drive;
    }}
    /* A reading that is no number, or leads to none, is passed over. */
    c->status = {n}_MISSED;
    if (!{n}_sample(c, reference, {zero}, low, high)) c->drive = {n}_within(c->drive, low, high);
    return c->drive;
}}
"""


def lqg(law: LQG, name: str, precision: Precision, limits: Limits) -> Written:
    """Header and source of state feedback with an observer.

    Args:
        law: its matrices and gains.
        name: prefix of every symbol.
        precision: type of the numbers.
        limits: of the drive.
    """

    def row(values: Iterable[float]) -> str:
        return ", ".join(precision.number(float(v)) for v in values)

    words = {
        "n": name, "real": precision.name, "zero": precision.number(0.0),
        "states": str(law.gain.size),
        "a": ",\n".join(f"    {{{row(one)}}}" for one in law.a), "b": row(law.b),
        "c": row(law.c), "k": row(law.gain), "l": row(law.filter[:-1]),
        "l_d": precision.number(float(law.filter[-1])),
        "ahead": precision.number(law.precompensator), "rest": precision.number(law.rest),
        "largest": precision.number(min(law.largest, written.FAR)),
        "assigned": "".join(
            f"    c->{k} = {precision.number(v)};\n"
            for k, v in written.numbers(limits, law.period).items()
        ),
    }  # fmt: skip
    words["limits"], words["within"] = (
        text.format(**words) for text in (written.LIMITS, written.WITHIN)
    )
    states = f"    {precision.name} x[{law.gain.size}];"
    fields = written.members(precision, written.LIMIT_MEMBERS)
    fields += f"{states:<34} /* expected states, scaled to a volt */\n"
    fields += written.members(
        precision, (("disturbance", "of the drive [V]"), ("drive", "of the last sample [V]"))
    )
    header, source = written.framed(
        name, precision, _TITLE, _ABOUT, law.period, fields,
        "The drive [V] for a reference and a reading [m].",
        f"{precision.name} reference, {precision.name} reading", _BODY.format(**words),
    )  # fmt: skip
    return Written(
        _TITLE, header, source, ("reference [m]", "reading [m]"),
        f"{name}_act(&one, ({precision.name})row[0], ({precision.name})row[1])", "drive [V]",
    )  # fmt: skip
