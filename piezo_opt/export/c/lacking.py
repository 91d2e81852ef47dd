"""Functions that a C library lacks, written where they are called."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from piezo_opt.export.c.printer import Precision

_OWN: Final = {
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


def lacking(called: Iterable[str], prefix: str, precision: Precision) -> list[str]:
    """Definitions of those of the called functions that a library may lack.

    Args:
        called: names of functions, without the suffix of their type.
        prefix: of every symbol.
        precision: type of the numbers.
    """
    wanted, real = set(called), precision.name
    words = {
        "R": real, "0": precision.number(0.0), "1": precision.number(1.0),
        "log": precision.call("log"), "exp": precision.call("exp"),
    }  # fmt: skip

    def filled(text: str) -> str:
        for key, value in words.items():
            text = text.replace(f"{{{key}}}", value)
        return text

    out: list[str] = []
    for name, (given, said) in _OWN.items():
        if name in wanted:
            typed = ", ".join(f"{real} {one}" for one in given.split(", "))
            out += [
                f"static {real} {prefix}_{name}({typed})",
                "{", f"    return {filled(said)};", "}", "",
            ]  # fmt: skip
    missing = [name for name in _MISSING if name in wanted]
    if missing:
        out += ["#ifdef __AVR__", "/* The library of this processor lacks these. */"]
        for name in missing:
            out += [
                f"static {real} {prefix}_{name}({real} a)",
                "{", f"    {filled(_MISSING[name])}", "}",
                f"#define {precision.call(name)} {prefix}_{name}",
            ]  # fmt: skip
        out += ["#endif", ""]
    return out
