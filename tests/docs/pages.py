"""Pages as programs: the python blocks of a page, and what it says they print.

The python blocks of a page run in order, in one namespace. A ``text`` block that follows one of
them states what it prints: words exactly, spaces freely, numbers to the digits shown, and
``...`` for whatever depends on the machine.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import final

_BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.]*\w)", re.IGNORECASE)
_TOKEN = re.compile(rf"(?P<number>{_NUMBER.pattern})|(?P<any>\.\.\.)|(?P<space>\s+)", re.IGNORECASE)


@final
@dataclass(frozen=True)
class Block:
    """One python block: its line in the page, its text, and what the page says it prints."""

    line: int
    code: str
    prints: str | None


def blocks(page: Path) -> list[Block]:
    """The python blocks of a page with the output stated right after each, if any."""
    text = page.read_text(encoding="utf-8")
    found = list(_BLOCK.finditer(text))
    result = []
    for number, block in enumerate(found):
        if block[1] != "python":
            continue
        after = found[number + 1] if number + 1 < len(found) else None
        follows = after is not None and not text[block.end() : after.start()].strip()
        stated = after[2] if after is not None and follows and after[1] == "text" else None
        result.append(Block(text.count("\n", 0, block.start(2)) + 1, block[2], stated))
    return result


def disagreement(stated: str, printed: str) -> str | None:
    """Where what is printed is not what the page states; None when it is."""
    pattern, position = "", 0
    stated, printed = stated.strip(), printed.strip()
    for token in _TOKEN.finditer(stated):
        pattern += re.escape(stated[position : token.start()])
        position = token.end()
        if token["number"] is not None:
            pattern += f"({_NUMBER.pattern})"
        else:
            pattern += r"\s+" if token["space"] is not None else r"[\s\S]*?"
    pattern += re.escape(stated[position:])
    match = re.fullmatch(pattern, printed, re.IGNORECASE)
    if match is None:
        return f"the page states\n{stated}\nand the code prints\n{printed}"
    numbers = [token["number"] for token in _TOKEN.finditer(stated)]
    for shown, got in zip((n for n in numbers if n is not None), match.groups(), strict=True):
        if abs(float(shown) - float(got)) > max(_last_digit(shown), 1e-3 * abs(float(shown))):
            return f"the page states {shown} and the code prints {got}, in\n{printed}"
    return None


def _last_digit(number: str) -> float:
    """Size of the last digit shown: 0.01 for ``3.14``, 1e-9 for ``1.2e-8``."""
    mantissa, _, exponent = number.lower().partition("e")
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))
