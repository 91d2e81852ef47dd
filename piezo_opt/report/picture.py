"""A figure as text that stands inside a page: SVG without anything that points outside."""

from __future__ import annotations

import io
import re

from matplotlib.figure import Figure

from piezo_opt.report.style import styled

_PROLOGUE = re.compile(r"^.*?(?=<svg)", re.DOTALL)
_METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)
_SIZE = re.compile(r'(<svg[^>]*?) width="[^"]*"', re.DOTALL)
_HEIGHT = re.compile(r'(<svg[^>]*?) height="[^"]*"', re.DOTALL)
_ID = re.compile(r'(\bid="|xlink:href="#|url\(#)([^")]+)')


def svg(figure: Figure, key: str) -> str:
    """The figure as an ``<svg>`` element; ids begin with ``key``, so that pictures on one page
    do not take each other's clip paths.
    """
    buffer = io.StringIO()
    with styled():
        engine = figure.get_layout_engine()
        if engine is not None:
            # Saving would draw everything once more only to lay it out.
            engine.execute(figure)
            figure.set_layout_engine("none")
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = _METADATA.sub("", _PROLOGUE.sub("", buffer.getvalue(), count=1))
    text = _HEIGHT.sub(r"\1", _SIZE.sub(r"\1", text, count=1), count=1)
    width = figure.get_figwidth() * 96.0
    text = text.replace("<svg", f'<svg role="img" style="max-width:{width:.0f}px"', 1)
    return _ID.sub(rf"\g<1>{key}-\2", text)
