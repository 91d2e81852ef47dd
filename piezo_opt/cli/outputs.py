"""What the commands write: asked for before long work starts, whole or not at all."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from piezo_opt.cli.codes import INTERRUPTED
from piezo_opt.cli.declare import Exit, echo
from piezo_opt.cli.telling import telling
from piezo_opt.errors import InputError
from piezo_opt.files import replacing, target_of

PAGES: Final = (".html", ".htm")
PICTURES: Final = (".png", ".svg", ".pdf")
_WRITTEN_AS: Final[Mapping[str, tuple[str, ...]]] = {
    "--report": PAGES,
    **dict.fromkeys(("--picture", "--shapes", "--response"), PICTURES),
}


def check(
    paths: Mapping[str, Path | None],
    *,
    overwrite: bool,
    inputs: Iterable[str | Path | None] = (),
    grows: frozenset[str] = frozenset(),
) -> None:
    """Refuse outputs that would destroy something, before any work.

    Args:
        paths: outputs by option.
        overwrite: whether existing files may be replaced.
        inputs: what the command reads: never an output, whatever was given.
        grows: options whose file may exist, because it is gone on with.

    Raises:
        InputError: an output exists, has no folder, is an input, a device or a link to one, or
            takes another one's place.
    """
    read = [Path(one) for one in inputs if one is not None]
    seen: dict[Path, str] = {}
    for option, path in paths.items():
        if path is None:
            continue
        try:
            where = target_of(path)
        except InputError as error:
            raise InputError(f"{option} {error}") from None
        for one in read:
            if _same(where, one):
                raise InputError(
                    f"{option} {path}: is read by this command, it would replace {one}: choose "
                    "another name"
                )
        if where.exists() and not overwrite and option not in grows:
            raise InputError(
                f"{option} {path}: exists already: choose another name or give --overwrite"
            )
        if not os.access(where.parent, os.W_OK):
            raise InputError(f"{option} {path}: nothing can be written to {path.parent}")
        if where in seen:
            raise InputError(f"{option} and {seen[where]} are the same file {path}: give two")
        seen[where] = option
        if option in _WRITTEN_AS:
            check_suffix(option, path, _WRITTEN_AS[option])


def check_suffix(option: str, path: Path, suffixes: tuple[str, ...]) -> None:
    """Refuse a name that says another format than what would be written.

    Raises:
        InputError: it does.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{option} {path}: it is written as {' or '.join(suffixes)}: choose one")


def _same(target: Path, read: Path) -> bool:
    """Whether two names lead to one file, by a link of either kind."""
    try:
        return target.exists() and read.exists() and target.samefile(read)
    except (OSError, ValueError):
        return False


def write_json(path: Path, data: Mapping[str, Any], *, overwrite: bool) -> None:
    """Plain data to a file; numbers that are not finite become null, as JSON has none."""
    with replacing(path, overwrite=overwrite) as temporary:
        text = json.dumps(_finite(data), indent=2, allow_nan=False)
        temporary.write_text(text + "\n", encoding="utf-8")


def write_page(path: Path, *results: object, title: str | None = None, overwrite: bool) -> None:
    """A report; drawing it may take a while, and what is drawn has been printed before.

    Raises:
        InputError: it cannot be written.
        Exit: Ctrl-C, with a sentence.
    """
    from piezo_opt.report import write_report

    try:
        with telling("Report") as tell:
            tell(f"drawing {path}")
            write_report(path, *results, title=title, overwrite=overwrite)
    except KeyboardInterrupt:
        echo(f"Interrupted while {path} was drawn: it was not written.", err=True)
        raise Exit(INTERRUPTED) from None


def write_picture(path: Path, draw: Callable[[], Any], *, overwrite: bool) -> None:
    """A figure of matplotlib's, drawn now, in the format of the name's suffix.

    Raises:
        InputError: it cannot be written.
    """
    with replacing(path, overwrite=overwrite) as temporary:
        draw().savefig(temporary, dpi=150, format=path.suffix.lstrip(".").lower())


def _finite(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
