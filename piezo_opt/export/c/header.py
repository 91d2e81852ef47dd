"""The .h: structs with units, and the functions that a program calls."""

from __future__ import annotations

from collections.abc import Sequence

from piezo_opt.export.c import naming
from piezo_opt.export.c.pen import Pen
from piezo_opt.export.c.printer import WIDTH, wrapped
from piezo_opt.export.c.stepping import run_arguments
from piezo_opt.export.c.tangents import declared


def header(pen: Pen) -> str:
    """The text of the header."""
    plan, n, real = pen.plan, pen.name, pen.real
    guard = f"{n.upper()}_H"
    out = [
        *pen.title(),
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        "#ifdef __cplusplus",
        'extern "C" {',
        "#endif",
        "",
    ]
    if plan.parameters:
        out += struct(pen, "parameters", plan.parameters, "What can be changed between calls.")
    if plan.states:
        out += struct(pen, "states", plan.states, "What the actuator remembers.")
    if plan.flowing:
        out += struct(pen, "rates", plan.flowing, "How fast the states move.", per="/s")
    if plan.derived:
        out += [
            f"/* What follows from the parameters alone: {n}_prepare() computes it. */",
            "typedef struct {",
            *(f"    {real} {name};" for name in plan.derived),
            f"}} {n}_derived;",
            "",
        ]
    if plan.delay is not None:
        out += [
            "/* Lines of the input that wait for the delay: more, for a longer delay or a shorter",
            "   interval. When there are too many the two oldest ones become one. */",
            f"#ifndef {n.upper()}_LINES",
            f"#define {n.upper()}_LINES {plan.corners}",
            "#endif",
            "",
            "typedef struct {",
            field(f"{real} length;", "what is left of it [s]"),
            field(f"{real} rate;", f"of the input [{pen.drive_unit}/s]"),
            field(f"{real} end;", f"its end [{pen.drive_unit}]"),
            f"}} {n}_line;",
            "",
        ]
    out += ["typedef struct {"]
    if plan.parameters:
        out += [f"    {n}_parameters parameters;"]
    if plan.derived:
        out += [f"    {n}_derived derived;"]
    if plan.states:
        out += [f"    {n}_states states;"]
    if pen.compensated:
        out += [field(f"{n}_rates lost;", "what rounding took from the states")]
    now = "where the actuator is" if plan.delay is not None else "at the end of the last step"
    members = [(f"{real} {plan.input};", f"{now} [{pen.drive_unit}]")]
    members += [(f"{real} {plan.input}_rate;", f"during it [{pen.drive_unit}/s]")]
    for channel in plan.channels:
        members += [(f"{real} {channel};", "further input, SI unit")]
        members += [(f"{real} {channel}_rate;", "its rate [1/s]")]
    if plan.timed:
        members += [(f"{real} time;", "since the start [s]")]
        if pen.timed_lost:
            members += [(f"{real} time_lost;", "what rounding took from it [s]")]
    if plan.flowing or plan.jumps:
        members += [(f"{real} longest_substep;", "[s]")]
        members += [(f"{real} largest_move;", f"of the input in a sub-step [{pen.drive_unit}]")]
    if plan.delay is not None:
        members += [(f"{real} last_{plan.input};", f"that was given [{pen.drive_unit}]")]
        members += [(f"{n}_line lines[{n.upper()}_LINES];", "a ring")]
        members += [("int oldest;", "line in it"), ("int waiting;", "how many wait")]
    out += [field(code, words) for code, words in members]
    out += [f"}} {n};", ""]
    inputs = pen.inputs()
    out += [
        "/* The values of the fit, and the states at rest under a constant input. */",
        f"void {n}_init({n} *a, {inputs});",
        "",
        "/* The states at rest under a constant input, with the parameters as they are. */",
        f"void {n}_start({n} *a, {inputs});",
        "",
    ]
    if plan.derived:
        out += [
            "/* To be called after a parameter has been changed. */",
            f"void {n}_prepare({n} *a);",
            "",
        ]
    out += [
        "/* An interval [s] passes, in which the input goes to its new value along a straight",
        f"   line. Returns the reading at its end [{pen.reading_unit}]. */",
        f"{real} {n}_step({n} *a, {real} interval, {inputs});",
        "",
        "/* Many intervals [s] of equal length: as so many calls of the same, and faster. */",
        *wrapped(f"void {n}_run({run_arguments(pen)});", WIDTH),
        "",
        f"/* The reading now [{pen.reading_unit}]. */",
        f"{real} {n}_output(const {n} *a);",
        "",
        *(declared(pen) if plan.slopes is not None else ()),
        "#ifdef __cplusplus",
        "}",
        "#endif",
        "",
        "#endif",
        "",
    ]
    return "\n".join(out)


def field(code: str, words: str) -> str:
    """A member of a struct with its comment."""
    return f"    {code:<34} /* {words} */" if words else f"    {code}"


def struct(
    pen: Pen, kind: str, fields: Sequence[naming.Field], words: str, per: str = ""
) -> list[str]:
    """A struct of numbers with their meanings and units."""
    return [
        f"/* {words} */",
        "typedef struct {",
        *(
            field(
                f"{pen.real} {one.declared};",
                naming.plain(f"{'' if per else one.meaning} [{one.unit}{per}]"),
            )
            for one in fields
        ),
        f"}} {pen.name}_{kind};",
        "",
    ]
