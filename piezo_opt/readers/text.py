"""Bytes to text: which encoding a file is in, found in the file itself."""

from __future__ import annotations

import codecs
from contextlib import suppress
from pathlib import Path

from piezo_opt.errors import InputError

_HEAD = 65536
_CHUNK = 1 << 20
_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def encoding_of(file: Path) -> tuple[str, str | None]:
    """The name of a file's encoding, and a sentence where it is not UTF-8.

    A mark at the beginning decides; without one zeros at every other byte are UTF-16, what
    decodes as UTF-8 is that, and the rest is the Western European encoding of Windows, of which
    Latin-1 is a part.

    Raises:
        InputError: the file is binary.
    """
    with file.open("rb") as content:
        head = content.read(_HEAD)
        for mark, name in _MARKS:
            if head.startswith(mark):
                said = None if name == "utf-8-sig" else f"The text is in {name.upper()}."
                return _decodes(file, name), said
        if b"\0" in head:
            return _sixteen(file, head)
    try:
        return _decodes(file, "utf-8"), None
    except InputError:
        name = _decodes(file, "cp1252")
        return name, "The text is not in UTF-8 and was read as Latin-1."


def _sixteen(file: Path, head: bytes) -> tuple[str, str]:
    """UTF-16 without its mark: text of this kind has a zero in every other byte."""
    for zeros, letters, name in ((1, 0, "utf-16-le"), (0, 1, "utf-16-be")):
        upper, lower = head[zeros::2], head[letters::2]
        if upper.count(0) > 0.9 * len(upper) and lower.count(0) == 0:
            return _decodes(file, name), f"The text is in {name.upper()}."
    # A logger that was broken off leaves the room that it had reserved.
    if 0 not in head.rstrip(b"\0") and 0 not in file.read_bytes().rstrip(b"\0"):
        with suppress(InputError):
            return _decodes(file, "utf-8"), "The file ends with zeros, which were left out."
    raise InputError(
        f"{file}: is binary, not text: read .mat, .h5, .nc, .tdms and .parquet files under their "
        "own suffix, or export CSV"
    )


def _decodes(file: Path, name: str) -> str:
    """The name again, when the whole file decodes."""
    decoder = codecs.getincrementaldecoder(name)()
    try:
        with file.open("rb") as content:
            while chunk := content.read(_CHUNK):
                decoder.decode(chunk)
            decoder.decode(b"", final=True)
    except UnicodeError as error:
        raise InputError(
            f"{file}: is neither UTF-8, UTF-16 nor Latin-1 text: save it as CSV in UTF-8"
        ) from error
    return name
