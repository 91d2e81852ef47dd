"""One row of a correspondence, and the table of them."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final, final

SCHEMA: Final = "piezo_opt.study/1"


@final
@dataclass(frozen=True)
class Row:
    """What was published, and what comes out here.

    Args:
        what: the quantity.
        published: as it was printed, with its unit; "lost" where it did not survive.
        ours: computed, never typed in; the reason where it cannot be.
        remark: what to make of it.
        source: where it is printed, and the call that computes ours.
    """

    what: str
    published: str
    ours: str
    remark: str
    source: str


@final
@dataclass(frozen=True)
class Study:
    """Rows by section, in the order of the work.

    Args:
        title: of what.
        sections: name and rows of each.
    """

    title: str
    sections: tuple[tuple[str, tuple[Row, ...]], ...]

    @property
    def rows(self) -> tuple[Row, ...]:
        """All rows."""
        return tuple(row for _, rows in self.sections for row in rows)

    def __str__(self) -> str:
        lines = [self.title]
        for name, rows in self.sections:
            lines += ["", name, "-" * len(name)]
            for row in rows:
                lines += [
                    f"{row.what}",
                    f"    published  {row.published}",
                    f"    here       {row.ours}",
                ]
                if row.remark:
                    lines.append(f"    remark     {row.remark}")
                lines.append(f"    source     {row.source}")
        return "\n".join(lines)

    def markdown(self) -> str:
        """Tables for a page, one for each section."""
        lines: list[str] = []
        for name, rows in self.sections:
            lines += [f"### {name}", "", "| what | thesis | here | remark |", "|---|---|---|---|"]
            for row in rows:
                cells = (f"{row.what} ({row.source})", row.published, row.ours, row.remark)
                lines.append("| " + " | ".join(_cell(cell) for cell in cells) + " |")
            lines.append("")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "schema": SCHEMA,
            "title": self.title,
            "sections": [
                {"name": name, "rows": [asdict(row) for row in rows]}
                for name, rows in self.sections
            ],
        }


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
