"""A PID as C, the law of :class:`piezo_opt.control.PID`."""

from __future__ import annotations

from typing import Final

from piezo_opt.control import PID, Limits
from piezo_opt.export.c.printer import Precision
from piezo_opt.export.laws import written
from piezo_opt.export.laws.written import Written

_TITLE: Final = "a PID with a filtered derivative and an integral that does not wind up."
_ABOUT: Final = """\
   u = kp e + I + kd s,   I += ki T e,   s' = (e' - s) / tau,   e = reference - reading
Astrom & Hagglund (2006), Advanced PID Control, chs. 2, 3 and 13."""
_MEMBERS: Final = (
    ("kp", "[V/m]"),
    ("ki", "[V/(m s)]"),
    ("kd", "[V s/m]"),
    ("tau", "time constant of the derivative's filter [s]"),
    ("period", "of the sampling [s]"),
    ("largest", "error beyond which it is cut [m]"),
    *written.LIMIT_MEMBERS,
    ("integral", "[V]"),
    ("slope", "filtered derivative of the error [m/s]"),
    ("error", "of the last sample [m]"),
    ("drive", "of the last sample [V]"),
)
_BODY: Final = """\
void {n}_init({n} *c)
{{
{assigned}    c->integral = c->slope = c->error = c->drive = {zero};
    c->begun = c->status = 0;
}}

{real} {n}_act({n} *c, {real} reference, {real} reading)
{{
{limits}    const {real} off = reference - reading;
    /* More than the largest error is a fault of the sensor, which the integral would remember. */
    const {real} error = {n}_is_number(off) ? {n}_within(off, -c->largest, c->largest) : off;
    const {real} last = c->begun ? c->error : error;
    const {real} slope = (c->tau * c->slope + (error - last)) / (c->tau + c->period);
    const {real} gained = c->ki * c->period * (error + last) / {two};
    {real} wanted = c->kp * error + (c->integral + gained) + c->kd * slope;
    c->status = 0;
    if ({n}_is_number(wanted)) {{
        const {real} spilt = wanted - {n}_within(wanted, low, high);
        /* The integral gives back what the drive could not follow, no more than it gained. */
        const {real} back = gained > {zero} ? {n}_within(spilt, {zero}, gained)
                                      : {n}_within(spilt, gained, {zero});
        c->integral += gained - back;
        c->slope = slope;
        c->error = error;
        c->begun = 1;
    }} else {{
        /* The error stays what it was, and nothing is integrated. */
        c->status = {n}_MISSED;
        wanted = c->kp * c->error + c->integral + c->kd * c->slope;
    }}
    c->drive = {n}_within(wanted, low, high);
    if (c->drive < wanted || c->drive > wanted) c->status |= {n}_LIMITED;
    return c->drive;
}}
"""


def pid(law: PID, name: str, precision: Precision, period: float, limits: Limits) -> Written:
    """Header and source of a PID.

    Args:
        law: its gains.
        name: prefix of every symbol.
        precision: type of the numbers.
        period: of the sampling [s].
        limits: of the drive.
    """
    values = {
        "kp": law.kp, "ki": law.ki, "kd": law.kd, "tau": law.tau, "period": period,
        "largest": min(law.largest, written.FAR), **written.numbers(limits, period),
    }  # fmt: skip
    words = {
        "n": name, "real": precision.name, "zero": precision.number(0.0),
        "two": precision.number(2.0),
        "assigned": "".join(f"    c->{k} = {precision.number(v)};\n" for k, v in values.items()),
    }  # fmt: skip
    words["limits"] = written.LIMITS.format(**words)
    fields = written.members(precision, _MEMBERS)
    fields += "    int begun;                     /* whether there was a sample */\n"
    header, source = written.framed(
        name, precision, _TITLE, _ABOUT, period, fields,
        "The drive [V] for a reference and a reading [m].",
        f"{precision.name} reference, {precision.name} reading",
        written.WITHIN.format(**words) + _BODY.format(**words),
    )  # fmt: skip
    return Written(
        _TITLE, header, source, ("reference [m]", "reading [m]"),
        f"{name}_act(&one, ({precision.name})row[0], ({precision.name})row[1])", "drive [V]",
    )  # fmt: skip
