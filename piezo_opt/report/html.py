"""Results to one HTML file that opens anywhere, without a network."""

from __future__ import annotations

import os
from pathlib import Path

from piezo_opt.choosing import expected
from piezo_opt.errors import InputError
from piezo_opt.files import replacing
from piezo_opt.report.chapters import chapter, together
from piezo_opt.report.page import Heading, page

__all__ = ["write_report"]


def write_report(
    path: str | os.PathLike[str],
    *results: object,
    title: str | None = None,
    overwrite: bool = False,
) -> Path:
    """Write fits, comparisons and diagnoses, in the order given, as one self-contained HTML page.

    Args:
        path: of the page; it appears whole or not at all.
        results: fits, comparisons and diagnoses. A fit and the comparison of it alone on its own
            records are one chapter.
        title: of the page; by default the heading of its first chapter.
        overwrite: whether an existing file may be replaced.

    Returns:
        the path.

    Raises:
        InputError: nothing to show, something that is no result, an existing file, or one that
            cannot be written.
    """
    if not results:
        raise InputError("a report needs a result: write_report('report.html', fit)")
    if title is not None:
        expected(str, title, "title", "a text")
    expected((str, os.PathLike), path, "The page", "its path")
    file = Path(path)
    if file.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{file}: a report is a page: name it .html")
    # Asked before anything is drawn; the file is put in place at the end.
    with replacing(file, overwrite=overwrite) as temporary:
        blocks = [block for result in together(results) for block in chapter(result)]
        first = blocks[0]
        if title is None and isinstance(first, Heading):
            title, blocks = first.text, blocks[1:]
        temporary.write_text(page(title or file.stem, blocks), encoding="utf-8")
    return file
