"""The C text of a plan: one header, one source, in the order in which they are read."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from typing import Final, final

from piezo_opt.export.c import naming
from piezo_opt.export.c.plan import Plan
from piezo_opt.export.c.printer import WIDTH, Precision, Printer, wrapped

NEWLINE: Final = "\n   "
_SLACK: Final = {"double": 1e-6, "float": 1e-4}
"""What rounding of time stamps may add to a number of sub-steps without adding one."""
_MOST: Final = 1e6
"""Sub-steps of one interval at most, so that a slip does not hang the program."""
_HELPERS: Final = {
    "sign": ("a", "({R})((a > {0}) - (a < {0}))"),
    "smaller": ("a, b", "a < b ? a : b"),
    "larger": ("a, b", "a > b ? a : b"),
}  # fmt: skip
_MISSING: Final = {
    "log1p": "const {R} u = {1} + a;\n    return u == {1} ? a : {log}(u) * a / (u - {1});",
    "expm1": (
        "const {R} u = {exp}(a), less = u - {1};\n"
        "    return less == {0} ? a : less == -{1} ? less : less * a / {log}(u);"
    ),
}  # fmt: skip
"""Functions of C99 that the library of 8-bit processors lacks (Kahan's way, Higham 2002, 1.14)."""


@final
class Writer:
    """Writes the header and the source of a plan.

    Args:
        plan: the equations.
        precision: type of the numbers.
    """

    def __init__(self, plan: Plan, precision: Precision) -> None:
        self.plan = plan
        self.precision = precision
        self.name = plan.prefix
        self.real = precision.name
        self._called: set[str] = set()
        self._compensated = precision.is_float and bool(plan.flowing)

    # -- the header ------------------------------------------------------------------------------

    def header(self) -> str:
        """The .h: structs with units, and the functions that a program calls."""
        plan, n, real = self.plan, self.name, self.real
        guard = f"{n.upper()}_H"
        out = [
            *self._title(),
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif",
            "",
        ]
        if plan.parameters:
            out += self._struct("parameters", plan.parameters, "What can be changed between calls.")
        if plan.states:
            out += self._struct("states", plan.states, "What the actuator remembers.")
        if plan.flowing:
            out += self._struct("rates", plan.flowing, "How fast the states move.", per="/s")
        if plan.derived:
            out += [
                f"/* What follows from the parameters alone: {n}_prepare() computes it. */",
                "typedef struct {",
                *(f"    {real} {name};" for name in plan.derived),
                f"}} {n}_derived;",
                "",
            ]
        out += ["typedef struct {"]
        if plan.parameters:
            out += [f"    {n}_parameters parameters;"]
        if plan.derived:
            out += [f"    {n}_derived derived;"]
        if plan.states:
            out += [f"    {n}_states states;"]
        if self._compensated:
            out += [self._field(f"{n}_rates lost;", "what rounding took from the states")]
        members = [(f"{real} {plan.input};", f"at the end of the last step [{self._drive_unit}]")]
        members += [(f"{real} {plan.input}_rate;", f"during it [{self._drive_unit}/s]")]
        for channel in plan.channels:
            members += [(f"{real} {channel};", "further input, SI unit")]
            members += [(f"{real} {channel}_rate;", "its rate [1/s]")]
        if plan.timed:
            members += [(f"{real} time;", "since the start [s]")]
            if self._timed_lost:
                members += [(f"{real} time_lost;", "what rounding took from it [s]")]
        if plan.flowing or plan.jumps:
            members += [(f"{real} longest_substep;", "[s]")]
            members += [
                (f"{real} largest_move;", f"of the input in a sub-step [{self._drive_unit}]")
            ]
        out += [self._field(code, words) for code, words in members]
        out += [f"}} {n};", ""]
        inputs = self._inputs()
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
            f"   line. Returns the reading at its end [{self._reading_unit}]. */",
            f"{real} {n}_step({n} *a, {real} interval, {inputs});",
            "",
            f"/* The reading now [{self._reading_unit}]. */",
            f"{real} {n}_output(const {n} *a);",
            "",
            "#ifdef __cplusplus",
            "}",
            "#endif",
            "",
            "#endif",
            "",
        ]
        return "\n".join(out)

    @property
    def _drive_unit(self) -> str:
        record = self.plan.given.record
        return "V" if record is None else naming.plain(record.drive_unit)

    @property
    def _reading_unit(self) -> str:
        record = self.plan.given.record
        return "m" if record is None else naming.plain(record.position_unit)

    @property
    def _timed_lost(self) -> bool:
        return self.precision.is_float and self.plan.timed

    def _title(self) -> list[str]:
        model = " + ".join(self.plan.given.model.names)
        told = naming.plain(self.plan.given.told)
        return comment(
            f"{self.name}: {model}.",
            f"From {told}, written by piezo_opt {version('piezo_opt')}. SI units.",
        )

    def _field(self, code: str, words: str) -> str:
        return f"    {code:<34} /* {words} */" if words else f"    {code}"

    def _struct(
        self, kind: str, fields: Sequence[naming.Field], words: str, per: str = ""
    ) -> list[str]:
        return [
            f"/* {words} */",
            "typedef struct {",
            *(
                self._field(
                    f"{self.real} {one.declared};",
                    naming.plain(f"{'' if per else one.meaning} [{one.unit}{per}]"),
                )
                for one in fields
            ),
            f"}} {self.name}_{kind};",
            "",
        ]

    def _inputs(self) -> str:
        return ", ".join(f"{self.real} {one}" for one in (self.plan.input, *self.plan.channels))

    # -- the source ------------------------------------------------------------------------------

    def source(self) -> str:
        """The .c: the equations, the sub-step, and what a program calls."""
        parts = [self._output(), self._rates(), self._jump(), self._substep(), self._prepare()]
        parts += [self._start(), self._init(), self._step()]
        body = [line for part in parts if part for line in (*part, "")]
        head = [*self._title(), f'#include "{self.name}.h"', ""]
        if self._called - {"fabs", "sign", "smaller", "larger"} or "fabs" in self._called:
            head += ["#include <math.h>", ""]
        head += self._helpers()
        return "\n".join([*head, *body]).rstrip() + "\n"

    def _printer(self) -> Printer:
        plan = self.plan
        return Printer(plan.graph, self.precision, self.name, plan.names, plan.given.model.names)

    def _written(
        self, results: Sequence[tuple[str, int]], *, from_struct: bool, derived: bool = True
    ) -> list[str]:
        """Results with the locals that name what they read from the struct."""
        plan, printer = self.plan, self._printer()
        known = {k: f"d->{name}" for name, k in plan.derived.items()} if derived else {}
        lines = printer.statements(results, known)
        self._called |= printer.called
        text = "\n".join(lines)
        aliases = []
        for short, kind, field in (
            ("p", "parameters", "parameters"), ("d", "derived", "derived"),
            ("x", "states", "states"),
        ):  # fmt: skip
            if f"{short}->" in text and (short != "x" or from_struct):
                aliases.append(f"const {self.name}_{kind} *const {short} = &a->{field};")
        if from_struct:
            leaves = set(plan.graph.leaves([k for _, k in results]))
            aliases += [
                f"const {self.real} {leaf} = a->{leaf};"
                for leaf in self._moving() if leaf in leaves
            ]  # fmt: skip
        return [*aliases, *lines]

    def _moving(self) -> list[str]:
        """Names of all that moves from outside, as they stand in equations and in the struct."""
        both = [n for one in (self.plan.input, *self.plan.channels) for n in (one, f"{one}_rate")]
        return ["time", *both]

    def _number(self, value: float) -> str:
        return self.precision.number(value)

    def _call(self, function: str) -> str:
        self._called.add(function)
        return self.precision.call(function)

    def _output(self) -> list[str]:
        lines = self._written([("return", self.plan.reading)], from_struct=True)
        unused = [] if any("a->" in line for line in lines) else ["(void)a;"]
        return [
            f"{self.real} {self.name}_output(const {self.name} *a)",
            *braced([*unused, *lines]),
        ]

    def _arguments(self) -> list[str]:
        """What the rates read beside states and parameters."""
        found = set(self.plan.graph.leaves(self.plan.rates))
        return [leaf for leaf in self._moving() if leaf in found]

    def _rates(self) -> list[str]:
        plan, n = self.plan, self.name
        if not plan.flowing:
            return []
        results = [
            (f"rates.{name} =", k)
            for one in plan.flowing
            for name, k in zip(one.elements, plan.nodes(one, plan.rates), strict=True)
        ]
        lines = self._written(results, from_struct=False)
        unused = [
            f"(void){short};"
            for short, sign in (("a", "a->"), ("x", "x->"))
            if not any(sign in line for line in lines)
        ]
        given = [f"const {n} *a", f"const {n}_states *x"]
        given += [f"{self.real} {leaf}" for leaf in self._arguments()]
        said = [
            f"{effect}: {'; '.join(naming.plain(line) for line in kind.equation.splitlines())}"
            for effect, kind in plan.given.model
        ]
        return [
            *comment("How fast the states move at one instant.", *said),
            *wrapped(f"static {n}_rates {n}_rates_at({', '.join(given)})", WIDTH),
            *braced([f"{n}_rates rates;", *unused, *lines, "return rates;"]),
            "",
            "/* States along a straight line. */",
            *wrapped(
                f"static {n}_states {n}_along(const {n}_states *x, {self.real} h, "
                f"const {n}_rates *rates)", WIDTH,
            ),
            *braced([
                f"{n}_states moved = *x;",
                *(f"moved.{name} += h * rates->{name};" for name in self._flowing()),
                "return moved;",
            ]),
        ]  # fmt: skip

    def _flowing(self) -> list[str]:
        return [name for one in self.plan.flowing for name in one.elements]

    def _jump(self) -> list[str]:
        plan = self.plan
        if plan.jumps is None:
            return []
        jumping = [
            (f"after.{name} =", k)
            for one in plan.states
            for name, k in zip(one.elements, plan.nodes(one, plan.jumps), strict=True)
            if plan.graph.nodes[k].name != f"x->{name}"
        ]
        lines = self._written(jumping, from_struct=True)
        return [
            "/* What remembers turns: its value after a stretch of the drive in one direction. */",
            f"static void {self.name}_jump({self.name} *a)",
            *braced([
                f"{self.name}_states after = a->states;", *lines, "a->states = after;",
            ]),
        ]  # fmt: skip

    def _substep(self) -> list[str]:
        plan, n, real = self.plan, self.name, self.real
        if not (plan.flowing or plan.jumps):
            return []
        lines: list[str] = []
        extra: list[str] = []
        if plan.flowing:
            half = self._number(0.5)
            lines += [f"const {real} half = {half} * h;"]
            for k, (before, by) in enumerate((("", ""), ("1", "half"), ("2", "half"), ("3", "h"))):
                at = "&a->states" if not k else f"&x{k + 1}"
                if k:
                    lines += [
                        f"const {n}_states x{k + 1} = {n}_along(&a->states, {by}, &k{before});"
                    ]
                given = ["a", at, *(self._at(leaf, by) for leaf in self._arguments())]
                lines += wrapped(f"const {n}_rates k{k + 1} = {n}_rates_at({', '.join(given)});")
            lines += [f"const {real} sixth = h * {self._number(1.0 / 6.0)};"]
            two = self._number(2.0)
            for name in self._flowing():
                moved = f"sixth * (k1.{name} + {two} * (k2.{name} + k3.{name}) + k4.{name})"
                if self._compensated:
                    said = f"{n}_add(&a->states.{name}, &a->lost.{name}, {moved});"
                else:
                    said = f"a->states.{name} += {moved};"
                lines += wrapped(said)
        if plan.timed:
            lines += [
                f"{n}_add(&a->time, &a->time_lost, h);" if self._timed_lost else "a->time += h;"
            ]
        for one in (plan.input, *plan.channels):
            lines += [f"a->{one} += a->{one}_rate * h;"]
        if plan.jumps is not None:
            lines += [f"{n}_jump(a);"]
        if self._compensated or self._timed_lost:
            extra = [
                "/* A sum that remembers what rounding took from it (Kahan 1965); it needs a",
                "   compiler that does not reorder additions. */",
                f"static void {n}_add({real} *sum, {real} *lost, {real} more)",
                *braced([
                    f"const {real} whole = more - *lost;",
                    f"const {real} next = *sum + whole;",
                    "*lost = (next - *sum) - whole;",
                    "*sum = next;",
                ]),
                "",
            ]  # fmt: skip
        scheme = "the classical Runge-Kutta scheme of order four" if plan.flowing else "exact"
        return [
            *extra,
            f"/* A sub-step h [s]: {scheme}. */",
            f"static void {n}_substep({n} *a, {real} h)",
            *braced(lines),
        ]

    def _at(self, leaf: str, by: str) -> str:
        """A moving input some way into a sub-step."""
        if not by or leaf.endswith("_rate"):
            return f"a->{leaf}"
        if leaf == "time":
            return f"a->time + {by}"
        return f"a->{leaf} + a->{leaf}_rate * {by}"

    def _prepare(self) -> list[str]:
        plan, n = self.plan, self.name
        if not plan.derived:
            return []
        results = [(f"d->{name} =", k) for name, k in plan.derived.items()]
        lines = self._written(results, from_struct=False, derived=False)
        alias = f"{n}_derived *const d = &a->derived;"
        lines = [alias, *(line for line in lines if "*const d =" not in line)]
        return [f"void {n}_prepare({n} *a)", *braced(lines)]

    def _start(self) -> list[str]:
        plan, n = self.plan, self.name
        zero = self._number(0.0)
        lines: list[str] = []
        for one in (plan.input, *plan.channels):
            lines += [f"a->{one} = {one};", f"a->{one}_rate = {zero};"]
        if plan.timed:
            lines += [f"a->time = {zero};"]
            if self._timed_lost:
                lines += [f"a->time_lost = {zero};"]
        if self._compensated:
            lines += [f"a->lost.{name} = {zero};" for name in self._flowing()]
        if plan.derived:
            lines += [f"{n}_prepare(a);"]
        results = [
            (f"a->states.{name} =", k)
            for one in plan.states
            for name, k in zip(one.elements, plan.nodes(one, plan.start), strict=True)
        ]
        if results:
            # A time that is asked for is that of the start.
            lines += self._written(results, from_struct=False)
            if "time" in plan.graph.leaves(plan.start):
                lines.insert(0, f"const {self.real} time = {zero};")
        aliases = [line for line in lines if "*const" in line]
        return [
            f"void {n}_start({n} *a, {self._inputs()})",
            *braced([*aliases, *(line for line in lines if line not in aliases)]),
        ]

    def _init(self) -> list[str]:
        plan, n = self.plan, self.name
        lines = [
            f"a->parameters.{one.name} = {self._number(plan.given.values[one.full])};"
            for one in plan.parameters
        ]
        if plan.flowing or plan.jumps:
            for field, value in (
                ("longest_substep", plan.substeps.longest),
                ("largest_move", plan.substeps.largest_move),
            ):
                # A limit that is none, written so that it needs no header.
                lines += [f"a->{field} = {self._number(min(value, 1e30))};"]
        inputs = ", ".join(("a", plan.input, *plan.channels))
        return [
            f"void {n}_init({n} *a, {self._inputs()})",
            *braced([*lines, f"{n}_start({inputs});"]),
        ]

    def _step(self) -> list[str]:
        plan, n, real = self.plan, self.name, self.real
        one, slack = self._number(1.0), self._number(_SLACK[real])
        inputs = (plan.input, *plan.channels)
        lines = [f"if (!(interval > {self._number(0.0)})) return {n}_output(a);"]
        if plan.flowing or plan.jumps:
            size, up = self._call("fabs"), self._call("ceil")
            lines += [
                f"const {real} by_time = interval / a->longest_substep;",
                f"const {real} by_move = {size}({plan.input} - a->{plan.input}) / a->largest_move;",
                f"const {real} wanted = {up}((by_time > by_move ? by_time : by_move) - {slack});",
                f"const long most = {int(_MOST)};",
                f"const long count = !(wanted > {one}) ? 1 : "
                f"wanted > ({real})most ? most : (long)wanted;",
                f"const {real} h = interval / ({real})count;",
            ]
        lines += [f"a->{one}_rate = ({one} - a->{one}) / interval;" for one in inputs]
        if plan.flowing or plan.jumps:
            lines += [f"for (long i = 0; i < count; ++i) {n}_substep(a, h);"]
        elif plan.timed:
            said = f"{n}_add(&a->time, &a->time_lost, interval);"
            lines += [said if self._timed_lost else "a->time += interval;"]
        lines += [f"a->{one} = {one};" for one in inputs]
        return [
            f"{real} {n}_step({n} *a, {real} interval, {self._inputs()})",
            *braced([*lines, f"return {n}_output(a);"]),
        ]

    def _helpers(self) -> list[str]:
        out: list[str] = []
        words = {
            "R": self.real, "0": self._number(0.0), "1": self._number(1.0),
            "log": self.precision.call("log"), "exp": self.precision.call("exp"),
        }  # fmt: skip

        def filled(text: str) -> str:
            for key, value in words.items():
                text = text.replace(f"{{{key}}}", value)
            return text

        for name, (arguments, said) in _HELPERS.items():
            if name in self._called:
                typed = ", ".join(f"{self.real} {one}" for one in arguments.split(", "))
                out += [
                    f"static {self.real} {self.name}_{name}({typed})",
                    "{", f"    return {filled(said)};", "}", "",
                ]  # fmt: skip
        missing = [name for name in _MISSING if name in self._called]
        if missing:
            out += ["#ifdef __AVR__", "/* The library of this processor lacks these. */"]
            for name in missing:
                function = self.precision.call(name)
                out += [
                    f"static {self.real} {self.name}_{name}({self.real} a)",
                    "{", f"    {filled(_MISSING[name])}", "}",
                    f"#define {function} {self.name}_{name}",
                ]  # fmt: skip
            out += ["#endif", ""]
        return out


def braced(lines: Sequence[str]) -> list[str]:
    """The body of a function."""
    return ["{", *(f"    {line}" for line in lines), "}"]


def comment(*said: str) -> list[str]:
    """Sentences as one comment."""
    lines: list[str] = []
    for sentence in said:
        line = ""
        for word in sentence.split():
            if len(line) + len(word) + 4 > WIDTH:
                lines.append(line)
                line = "  "
            line = f"{line} {word}" if line else word
        lines.append(line)
    return f"/* {NEWLINE.join(lines)} */".split("\n")
