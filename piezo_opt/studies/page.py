"""A study's tables inside a page that people write."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from piezo_opt.errors import InputError
from piezo_opt.files import replacing
from piezo_opt.studies.row import Study

BEGIN: Final = "<!-- begin of the study's tables -->"
END: Final = "<!-- end of the study's tables -->"


def tables_of(page: Path) -> str:
    """What stands between the marks of a page.

    Raises:
        InputError: no such page, or no marks in it.
    """
    return _parts(page)[1].strip()


def write_tables(page: Path, study: Study) -> None:
    """Put a study's tables between the marks of a page; all else of it stays.

    Raises:
        InputError: as :func:`tables_of`.
    """
    before, _, after = _parts(page)
    with replacing(page, overwrite=True) as temporary:
        temporary.write_text(
            f"{before}{BEGIN}\n\n{study.markdown().strip()}\n\n{END}{after}", encoding="utf-8"
        )


def _parts(page: Path) -> tuple[str, str, str]:
    if not page.is_file():
        raise InputError(f"{page}: there is no such page")
    text = page.read_text(encoding="utf-8")
    before, begin, rest = text.partition(BEGIN)
    inside, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(f"{page}: has no lines {BEGIN} and {END} to put the tables between")
    return before, inside, after
