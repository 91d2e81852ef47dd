"""One self-contained HTML page: sections of text, tables and pictures; nothing from a network."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import final

from matplotlib.figure import Figure

from piezo_opt.report.picture import svg

_MICRO = re.compile(r"(?<=\d )um\b(\^2)?(?:\*s)?")

_STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0; background: #f5f6f8; color: #1d2129;
  font: 15px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 980px; margin: 0 auto; padding: 28px 20px 60px; }
h1 { font-size: 25px; line-height: 1.25; margin: 0 0 6px; }
h2 { font-size: 20px; margin: 34px 0 10px; padding-top: 14px; border-top: 2px solid #d9dde3; }
h3 { font-size: 16px; margin: 24px 0 8px; }
p { margin: 8px 0; }
.lead { font-size: 17px; background: #fff; border-left: 4px solid #0072B2; padding: 10px 14px; }
.lead.bad { border-color: #D55E00; }
.quiet { color: #5b616b; font-size: 13.5px; }
figure { margin: 12px 0; background: #fff; border: 1px solid #e0e3e8; padding: 8px;
  overflow: hidden; }
figure svg { display: block; width: 100%; height: auto; margin: 0 auto; touch-action: pan-y; }
figure svg:focus { outline: 2px solid #56B4E9; cursor: grab; }
figcaption { color: #5b616b; font-size: 13.5px; padding: 4px 6px 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; background: #fff; font-size: 14px; margin: 10px 0; }
th, td { padding: 5px 9px; border-bottom: 1px solid #e6e9ed; text-align: right;
  white-space: nowrap; font-variant-numeric: tabular-nums; }
th { background: #eef0f3; font-weight: 600; }
th:first-child, td:first-child, td.text, th.text { text-align: left; }
td.text { white-space: normal; min-width: 90px; }
td:first-child { white-space: normal; min-width: 130px; }
pre { background: #fff; border: 1px solid #e0e3e8; padding: 10px 12px; overflow-x: auto;
  font: 13px/1.5 ui-monospace, "DejaVu Sans Mono", monospace; }
details { margin: 14px 0; }
summary { cursor: pointer; color: #0072B2; }
ul { margin: 8px 0; padding-left: 22px; }
li { margin: 4px 0; }
"""

# Wheel zooms at the pointer, but only in a picture that was clicked: a page must scroll freely.
_SCRIPT = """
document.querySelectorAll("figure svg").forEach(function (svg) {
  var home = svg.getAttribute("viewBox");
  if (!home) { return; }
  var box = home.split(" ").map(Number), from = null;
  function show() { svg.setAttribute("viewBox", box.join(" ")); }
  function at(event) {
    var r = svg.getBoundingClientRect();
    return [box[0] + box[2] * (event.clientX - r.left) / r.width,
            box[1] + box[3] * (event.clientY - r.top) / r.height];
  }
  svg.setAttribute("tabindex", "0");
  svg.addEventListener("wheel", function (event) {
    if (document.activeElement !== svg) { return; }
    event.preventDefault();
    var p = at(event), k = event.deltaY > 0 ? 1.2 : 1 / 1.2;
    box = [p[0] - (p[0] - box[0]) * k, p[1] - (p[1] - box[1]) * k, box[2] * k, box[3] * k];
    show();
  }, { passive: false });
  svg.addEventListener("pointerdown", function (event) {
    svg.focus(); from = at(event); svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", function (event) {
    if (!from) { return; }
    var p = at(event);
    box[0] += from[0] - p[0]; box[1] += from[1] - p[1];
    show();
  });
  svg.addEventListener("pointerup", function () { from = null; });
  svg.addEventListener("pointercancel", function () { from = null; });
  function reset() { box = home.split(" ").map(Number); show(); }
  svg.addEventListener("dblclick", reset);
  svg.addEventListener("keydown", function (event) { if (event.key === "Escape") { reset(); } });
});
"""


@final
@dataclass(frozen=True)
class Heading:
    """A heading: level 2 opens a chapter, 3 a part of it."""

    text: str
    level: int = 2


@final
@dataclass(frozen=True)
class Lead:
    """The sentence to read if only one is read."""

    text: str
    good: bool = True


@final
@dataclass(frozen=True)
class Text:
    """A paragraph; ``quiet`` for what is good to know."""

    text: str
    quiet: bool = False


@final
@dataclass(frozen=True)
class Points:
    """Sentences, one under the other."""

    sentences: tuple[str, ...]


@final
@dataclass(frozen=True)
class Listing:
    """Text in fixed width, as a terminal prints it."""

    text: str


@final
@dataclass(frozen=True)
class Table:
    """Columns of text: (heading, cells); names in ``prose`` are set as text to the left."""

    columns: tuple[tuple[str, tuple[str, ...]], ...]
    prose: tuple[str, ...] = ()


@final
@dataclass(frozen=True, eq=False)
class Picture:
    """A figure and the sentence that says what to look for."""

    figure: Figure
    caption: str


@final
@dataclass(frozen=True)
class Folded:
    """What few readers need, shown when its summary is clicked."""

    summary: str
    blocks: tuple[Block, ...]


Block = Heading | Lead | Text | Points | Listing | Table | Picture | Folded


def page(title: str, blocks: Sequence[Block]) -> str:
    """The whole page as text."""
    body = "\n".join(_html(block, f"p{k}") for k, block in enumerate(blocks))
    pictures = any(isinstance(block, Picture) for block in blocks)
    hint = (
        '<p class="quiet">Click a picture, then turn the wheel to zoom and drag to move; '
        "double-click or Esc brings it back.</p>\n"
        if pictures
        else ""
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<main>\n"
        f"<h1>{escape(title)}</h1>\n{hint}{body}\n</main>\n<script>{_SCRIPT}</script>\n"
        "</body>\n</html>\n"
    )


def _said(text: str) -> str:
    """Text for a page: escaped, and "um" as engineers write it."""

    def micro(found: re.Match[str]) -> str:
        return found[0].replace("um", "µm").replace("^2", "²").replace("*", "·")

    return escape(_MICRO.sub(micro, text))


def _html(block: Block, key: str) -> str:
    match block:
        case Heading(text, level):
            return f"<h{level}>{_said(text)}</h{level}>"
        case Lead(text, good):
            return f'<p class="lead{"" if good else " bad"}">{_said(text)}</p>'
        case Text(text, quiet):
            return f"<p{' class=quiet' if quiet else ''}>{_said(text)}</p>"
        case Points(sentences):
            items = "".join(f"<li>{_said(one)}</li>" for one in sentences)
            return f"<ul>{items}</ul>"
        case Listing(text):
            return f"<pre>{escape(text)}</pre>"
        case Table(columns, prose):
            return _table(columns, prose)
        case Folded(summary, blocks):
            inside = "\n".join(_html(one, f"{key}-{k}") for k, one in enumerate(blocks))
            return f"<details><summary>{_said(summary)}</summary>\n{inside}\n</details>"
        case Picture(figure, caption):
            return f"<figure>{svg(figure, key)}<figcaption>{_said(caption)}</figcaption></figure>"


def _table(columns: tuple[tuple[str, tuple[str, ...]], ...], prose: tuple[str, ...]) -> str:
    marks = [" class=text" if head in prose else "" for head, _ in columns]
    head = "".join(
        f"<th{mark}>{_said(name)}</th>" for mark, (name, _) in zip(marks, columns, strict=True)
    )
    rows = zip(*(cells for _, cells in columns), strict=True)
    body = "".join(
        "<tr>"
        + "".join(f"<td{mark}>{_said(cell)}</td>" for mark, cell in zip(marks, row, strict=True))
        + "</tr>"
        for row in rows
    )
    inside = f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody>"
    return f'<div class="wide"><table>{inside}</table></div>'
