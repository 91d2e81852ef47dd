"""What stands beside the code: a program to try it with, a build file, and how to use it."""

from __future__ import annotations

from textwrap import fill
from typing import Any, Final

from piezo_opt.export.c.plan import Plan
from piezo_opt.export.c.printer import WIDTH, Precision
from piezo_opt.export.c.tangents import moved_by

_MAIN: Final = """\
/* Reads rows of {columns} from standard input, separated by commas, and writes
   time and reading{more}: a line that does not begin with a number is passed over. */
#include "{n}.h"

#include <stdio.h>
#include <stdlib.h>

#define COLUMNS {count}

int main(void)
{{
    char line[1024];
    {n} one;
{tangents}    double before = 0.0;
    int begun = 0;
    {title}
    while (fgets(line, sizeof line, stdin)) {{
        double row[COLUMNS];
        char *at = line;
        int found = 0;
        {real} reading;
        while (found < COLUMNS) {{
            char *end = at;
            row[found] = strtod(at, &end);
            if (end == at) break;
            ++found;
            at = *end == ',' ? end + 1 : end;
        }}
        if (found == 0) continue;
        if (found < COLUMNS) {{
            fprintf(stderr, "%d numbers instead of %d: %s", found, COLUMNS, line);
            return 1;
        }}
        if (begun) {{
            reading = {n}_step{step}, {interval}, {inputs}{by});
        }} else {{
            {n}_init(&one, {inputs});
            reading = {n}_output(&one);
{begin}            begun = 1;
        }}
        before = row[0];
        {shown}
    }}
    return 0;
}}
"""

_ALONE: Final = {
    "more": "", "tangents": "", "step": "(&one", "by": "", "begin": "",
    "shown": 'printf("%.17g,%.{digits}g\\n", row[0], {wide}reading);',
}  # fmt: skip
"""The places of the program where nothing is differentiated."""
_MOVED: Final = {
    "more": ", and derivatives",
    "tangents": "    {n}_tangents tangents;\n    {real} by[{n}_parameter_count];\n    int i;\n",
    "step": "_sensitivities(\n                &one, &tangents", "by": ", by",
    "begin": (
        "            {n}_start_sensitivities(&one, &tangents);\n"
        "            {n}_output_sensitivities(&one, &tangents, by);\n"
    ),
    "shown": (
        'printf("%.17g,%.{digits}g", row[0], {wide}reading);\n'
        '        for (i = 0; i < {n}_parameter_count; ++i) printf(",%.{digits}g", {wide}by[i]);\n'
        "        putchar('\\n');"
    ),
}  # fmt: skip
"""The same where derivatives are carried along."""

BUILD: Final = """\
cmake_minimum_required(VERSION 3.10)
project({n} C)
set(CMAKE_C_STANDARD 99)
set(CMAKE_C_EXTENSIONS OFF)
if(NOT CMAKE_BUILD_TYPE)
    set(CMAKE_BUILD_TYPE Release)
endif()
add_library({n} STATIC {n}.c {n}.h)
if(CMAKE_C_COMPILER_ID STREQUAL "GNU")
    # A chain of operations that wait for one another is no faster in pairs.
    target_compile_options({n} PRIVATE -fno-tree-slp-vectorize)
endif()
target_include_directories({n} PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
if(UNIX)
    target_link_libraries({n} PUBLIC m)
endif()
add_executable({n}_replay main.c)
target_link_libraries({n}_replay PRIVATE {n})
"""

_README: Final = """\
# {n}

{model}. From {told}. Numbers are `{real}`; units are SI.{pruned}

```c
#include "{n}.h"

{n} one;
{n}_init(&one, {first});
for (;;) {reading} = {n}_step(&one, {interval}, {inputs});
```

`{n}_init` takes the values of the fit and puts the states at rest. `{n}_step` moves the {input}
to its new value along a straight line and returns the reading at the end of the interval, which may
differ from call to call. Parameters are members of `one.parameters`; `{n}_start` begins anew with
them{prepare}.{slopes} There is no allocation and no global state: as many actuators as you like.

{scheme}

{replay}

Build and try it:

```sh
cc -std=c99 -O2 {n}.c main.c -lm -o replay
./replay < drive.csv > reading.csv
```

`drive.csv` holds {columns}. `CMakeLists.txt` builds the same.{caution}
"""


def program(plan: Plan, precision: Precision, unit: str) -> str:
    """main.c."""
    inputs = [f"row[{k}]" for k in range(1, 2 + len(plan.channels))]
    cast, wide = ("(float)", "(double)") if precision.is_float else ("", "")
    interval, digits, n = "row[0] - before", 9 if cast else 17, plan.prefix
    moved = _MOVED if plan.slopes is not None else _ALONE
    more = [f"by {one.full}" for one in moved_by(plan)] if plan.slopes is not None else []
    first = f"time [s],reading [{unit}]"
    words: dict[str, Any] = {
        "n": n, "real": precision.name, "digits": digits, "wide": wide,
        "columns": _columns(plan), "count": len(inputs) + 1,
        "interval": f"(float)({interval})" if cast else interval,
        "inputs": ", ".join(f"{cast}{one}" for one in inputs),
        # In pieces of one line each.
        "title": "\n    ".join(
            [f'fputs("{first}", stdout);', *(f'fputs(",{one}", stdout);' for one in more),
             "putchar('\\n');"] if more else [f'puts("{first}");']
        ),
    }  # fmt: skip
    return _MAIN.format(**{key: text.format(**words) for key, text in moved.items()}, **words)


def build_file(plan: Plan) -> str:
    """CMakeLists.txt."""
    return BUILD.format(n=plan.prefix)


def read_me(plan: Plan, precision: Precision, scheme: str, replay: str) -> str:
    """README.md."""
    pruned = plan.given.pruned
    inputs = ", ".join((plan.input, *plan.channels))
    gone = f" {' and '.join(pruned)} did nothing at these values and is left out." if pruned else ""
    text = _README.format(
        n=plan.prefix, model=" + ".join(plan.given.model.names), told=plan.given.told,
        real=precision.name, pruned=gone,
        first=inputs, inputs=inputs, input=plan.input, interval="interval", reading="reading",
        slopes=(
            f" `{plan.prefix}_step_sensitivities` carries the derivatives of the reading by every "
            f"parameter along, in the order of `{plan.prefix}_by_...`, from "
            f"`{plan.prefix}_start_sensitivities` on." if plan.slopes is not None else ""
        ),
        prepare=f", `{plan.prefix}_prepare` goes on with them" if plan.derived else "",
        scheme=scheme, replay=replay, columns=_columns(plan),
        caution=(
            " Do not compile with\n`-ffast-math`: sums that remember their rounding would be taken "
            "apart." if precision.is_float else ""
        ),
    )  # fmt: skip
    # Paragraphs are filled anew; code stands between fences.
    blocks = text.split("```")
    blocks[::2] = ["\n\n".join(map(_filled, block.split("\n\n"))) for block in blocks[::2]]
    return "```".join(blocks)


def _filled(paragraph: str) -> str:
    """A paragraph in lines of equal length; what begins or ends it stays."""
    words = paragraph.strip("\n")
    return paragraph.replace(words, fill(words, WIDTH)) if words else paragraph


def _columns(plan: Plan) -> str:
    return ", ".join((f"time [s], {plan.input}", *plan.channels))
