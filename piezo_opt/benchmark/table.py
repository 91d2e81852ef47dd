"""Plain tables: text columns to the left, numbers to the right."""

from __future__ import annotations

from collections.abc import Sequence


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lines of equal columns under a header.

    A column whose cells all begin like a number, or are empty, is aligned to the right.
    """
    columns = list(zip(*([header, *rows]), strict=True))
    right = [all(not cell or cell[0] in "+-.0123456789" for cell in c[1:]) for c in columns]
    widths = [max(len(cell) for cell in column) for column in columns]
    lines = []
    for row in (header, *rows):
        cells = [
            cell.rjust(width) if to_right else cell.ljust(width)
            for cell, width, to_right in zip(row, widths, right, strict=True)
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)
