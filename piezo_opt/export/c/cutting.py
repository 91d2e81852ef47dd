"""How a stretch of time is cut into sub-steps."""

from __future__ import annotations

from typing import Final

from piezo_opt.export.c.pen import Pen
from piezo_opt.export.c.printer import wrapped

_SLACK: Final = {"double": 1e-6, "float": 1e-4}
"""What rounding of time stamps may add to a number of sub-steps without adding one."""
_MOST: Final = 1e6
"""Sub-steps of one interval at most, so that a slip does not hang the program."""


def cut(pen: Pen, length: str, moved: str) -> list[str]:
    """The number of sub-steps of a stretch, and their length h."""
    real = pen.real
    slack = pen.number(_SLACK[real])
    size, up = pen.call("fabs"), pen.call("ceil")
    # The usual stretch is one sub-step, and takes no division.
    whole = pen.number(1.0 + _SLACK[real])
    return [
        "long count = 1;",
        f"{real} h = {length};",
        *wrapped(
            f"if ({length} > {whole} * a->longest_substep || {size}({moved}) > {whole} "
            "* a->largest_move) {"
        ),
        f"    const {real} by_time = {length} / a->longest_substep;",
        f"    const {real} by_move = {size}({moved}) / a->largest_move;",
        f"    const {real} wanted = {up}((by_time > by_move ? by_time : by_move) - {slack});",
        f"    const long most = {int(_MOST)};",
        f"    count = wanted > ({real})most ? most : (long)wanted;",
        f"    h = {length} / ({real})count;",
        "}",
    ]
