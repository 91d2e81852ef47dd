"""What a board is to the measurement: tools, flags, a program around the code, and its runner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, final

WRITE: Final = """
static void {n}_write(uint32_t v)
{{
    int i;
    for (i = 28; i >= 0; i -= 4) put("0123456789abcdef"[(v >> i) & 15]);
    put('\\n');
}}
"""

RUN: Final = """
int main(void)
{{
    uint32_t begun, took;
    int i;
    begin();
    {n}_init(&one, {first});
    show({n}_output(&one));
    for (i = 1; i < {rows}; ++i) {{
        const float interval = at(i, 0){inputs};
        float reading;
        begun = now();
        reading = {n}_step(&one, interval{names});
        took = now() - begun;
        show(reading);
        {n}_write(took);
    }}
    {n}_write(deepest());
    end();
    return 0;
}}
"""
"""The record's rows through the code: for each the bits of its reading, and how long it took."""

LEAST: Final = """
static {n} one;
volatile float in, out;
int main(void)
{{
    {n}_init(&one, {volatile});
    for (;;) out = {n}_step(&one, in, {volatile});
}}
"""
"""The smallest program with one actuator: what it takes is what the code takes."""


@final
@dataclass(frozen=True)
class Board:
    """A processor, the tools that build for it, and the simulator that runs the result.

    Attributes:
        name: what the option calls it.
        told: what it is, in words.
        counts: what the simulator counts, ``"cycles"`` or ``"instructions"``.
        packages: of the Debian distribution that bring the tools.
        compiler, size: names of the tools.
        flags: of the compiler.
        startup: text that any program needs before it begins.
        around: text before the program that is run: what ``begin``, ``now``, ``put``, ``show``,
            ``deepest``, ``end`` and the table ``at`` mean here.
        table: how the table of inputs is declared.
        support: further files, name and text.
        linked: flags of a whole program.
        runner: command that runs a program; the program's path is appended.
    """

    name: str
    told: str
    counts: str
    packages: tuple[str, ...]
    compiler: str
    size: str
    flags: tuple[str, ...]
    startup: str
    around: str
    table: str
    support: tuple[tuple[str, str], ...]
    linked: tuple[str, ...]
    runner: tuple[str, ...]
