"""What every part of the text is written with: names, numbers, and results as statements."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from typing import Final, final

from piezo_opt.export.c import naming
from piezo_opt.export.c.plan import Plan
from piezo_opt.export.c.printer import WIDTH, Precision, Printer

NEWLINE: Final = "\n   "


@final
class Pen:
    """Writes results of a plan as statements, and remembers which functions they call.

    Args:
        plan: the equations.
        precision: type of the numbers.
    """

    def __init__(self, plan: Plan, precision: Precision) -> None:
        self.plan = plan
        self.precision = precision
        self.name = plan.prefix
        self.real = precision.name
        self.called: set[str] = set()
        self.compensated = precision.is_float and bool(plan.flowing)

    def printer(self) -> Printer:
        """A printer for one function."""
        plan = self.plan
        return Printer(plan.graph, self.precision, self.name, plan.names, plan.given.model.names)

    def written(
        self, results: Sequence[tuple[str, int]], *, from_struct: bool, derived: bool = True
    ) -> list[str]:
        """Results with the locals that name what they read from the struct."""
        plan, printer = self.plan, self.printer()
        known = {k: f"d->{name}" for name, k in plan.derived.items()} if derived else {}
        lines = printer.statements(results, known)
        self.called |= printer.called
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
                for leaf in self.moving() if leaf in leaves
            ]  # fmt: skip
        return [*aliases, *lines]

    def moving(self) -> list[str]:
        """Names of all that moves from outside, as they stand in equations and in the struct."""
        both = [n for one in (self.plan.input, *self.plan.channels) for n in (one, f"{one}_rate")]
        return ["time", *both]

    def number(self, value: float) -> str:
        """A literal."""
        return self.precision.number(value)

    def call(self, function: str) -> str:
        """The name of a function of libm, which is remembered."""
        self.called.add(function)
        return self.precision.call(function)

    def flowing(self) -> list[str]:
        """Every element of a state that has a rate."""
        return [name for one in self.plan.flowing for name in one.elements]

    def names(self) -> tuple[str, ...]:
        """The inputs: the drive, and further channels."""
        return (self.plan.input, *self.plan.channels)

    def inputs(self) -> str:
        """The inputs as arguments."""
        return ", ".join(f"{self.real} {one}" for one in self.names())

    @property
    def drive_unit(self) -> str:
        """Unit of the input."""
        record = self.plan.given.record
        return "V" if record is None else naming.plain(record.drive_unit)

    @property
    def reading_unit(self) -> str:
        """Unit of the reading."""
        record = self.plan.given.record
        return "m" if record is None else naming.plain(record.position_unit)

    @property
    def timed_lost(self) -> bool:
        """Whether the time remembers its rounding."""
        return self.precision.is_float and self.plan.timed

    def title(self) -> list[str]:
        """The first comment of a file."""
        model = " + ".join(self.plan.given.model.names)
        told = naming.plain(self.plan.given.told)
        return comment(
            f"{self.name}: {model}.",
            f"From {told}, written by piezo_opt {version('piezo_opt')}. SI units.",
        )


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
