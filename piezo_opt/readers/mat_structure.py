"""Whether a MATLAB 5 file is whole, looked at before scipy reads it.

scipy trusts the type numbers in the file and uses them as indices in compiled code, so a damaged
file can end the process instead of raising. This walk over the elements ("tags") follows the
published layout (MathWorks, "MAT-File Format", level 5): a header of 128 bytes, then elements of
type and size; matrices hold further elements, compressed elements hold one matrix.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import final

from piezo_opt.errors import InputError
from piezo_opt.files import LARGEST_FILE

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_PLAIN = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18})
_DEEPEST = 32
_NUMBERS = range(6, 16)
_CELL, _STRUCTURE, _OBJECT, _TEXT, _SPARSE, _OPAQUE = 1, 2, 3, 4, 5, 17


class _Damaged(Exception):
    """What is wrong, in a few words."""


@final
@dataclass(frozen=True)
class Contents:
    """The variables of a file: numbers of elements by name, and names of objects."""

    sizes: dict[str, int]
    objects: tuple[str, ...]


def check_structure(file: Path) -> Contents:
    """What a MATLAB file of version 5 to 7.2 holds; `InputError` unless it is a whole one."""
    content = file.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    again = "save the signals again, as in save('file.mat', 't', 'u', 'y', '-v7')"
    if order is None or struct.unpack(order + "H", content[124:126])[0] != 0x0100:
        raise InputError(f"{file}: is not a MATLAB file of version 5 or 7.3: {again}")
    try:
        return _elements(memoryview(content)[_HEADER:], order)
    except _Damaged as error:
        raise InputError(f"{file}: is not a whole MATLAB file ({error}): {again}") from error


def _elements(content: memoryview, order: str) -> Contents:
    place = 0
    sizes: dict[str, int] = {}
    objects: list[str] = []
    while place < len(content):
        kind, body, place = _element(content, place, order)
        if kind == _COMPRESSED:
            unfolded = memoryview(_unfolded(body))
            inner, matrix, _ = _element(unfolded, 0, order)
            if inner != _MATRIX:
                raise _Damaged("a compressed variable holds no matrix")
            kind, body = inner, matrix
        if kind != _MATRIX:
            raise _Damaged(f"element of type {kind} where a variable should be")
        if (opaque := _object(body, order)) is not None:
            objects.append(opaque)
            continue
        name, size = _matrix(body, order, 0)
        if name:
            sizes[name] = size
    return Contents(sizes, tuple(objects))


def _object(body: memoryview, order: str) -> str | None:
    """The name of a variable that is an object of a class, which has no shape; else None."""
    kind, flags, place = _element(body, 0, order)
    if kind == _MATRIX or len(flags) != 8:
        return None
    if struct.unpack_from(order + "I", flags)[0] & 0xFF != _OPAQUE:
        return None
    _, name, _ = _element(body, place, order)
    return bytes(name).decode("latin-1")


def _element(content: memoryview, place: int, order: str) -> tuple[int, memoryview, int]:
    """Type, body and the place of the next element."""
    if place + 8 > len(content):
        raise _Damaged("cut short in the head of an element")
    kind, size = struct.unpack_from(order + "II", content, place)
    if kind >> 16:
        # Up to four bytes are packed beside the type.
        kind, size = kind & 0xFFFF, kind >> 16
        if size > 4:
            raise _Damaged("a packed element of more than four bytes")
        start, following = place + 4, place + 8
    else:
        start = place + 8
        following = start + size if kind == _COMPRESSED else start + size + -size % 8
    if start + size > len(content):
        raise _Damaged("cut short in the body of an element")
    return kind, content[start : start + size], following


def _unfolded(body: memoryview) -> bytes:
    try:
        machine = zlib.decompressobj()
        content = machine.decompress(body, LARGEST_FILE)
    except zlib.error as error:
        raise _Damaged("a compressed variable does not unfold") from error
    if not machine.eof:
        raise _Damaged("a compressed variable is cut short or too large")
    return content


def _matrix(content: memoryview, order: str, depth: int) -> tuple[str, int]:
    """Name and number of elements of a variable whose parts fit together."""
    if depth > _DEEPEST:
        raise _Damaged("structures nested too deeply")
    if not content:
        return "", 0  # an empty field
    parts: list[tuple[int, memoryview]] = []
    place = 0
    while place < len(content):
        kind, body, place = _element(content, place, order)
        if kind == _MATRIX:
            _matrix(body, order, depth + 1)
        elif kind not in _PLAIN:
            raise _Damaged(f"unknown data type {kind}")
        parts.append((kind, body))
    if len(parts) < 3 or len(parts[0][1]) != 8 or len(parts[1][1]) < 8:
        raise _Damaged("a variable without shape or name")
    return bytes(parts[2][1]).decode("latin-1"), _check_parts(parts, order)


def _check_parts(parts: list[tuple[int, memoryview]], order: str) -> int:
    """The number and kinds of the parts fit the class and the shape of the matrix."""
    (flags,) = struct.unpack_from(order + "I", parts[0][1])
    sizes = struct.unpack_from(f"{order}{len(parts[1][1]) // 4}i", parts[1][1])
    if min(sizes) < 0:
        raise _Damaged("a variable of negative size")
    count = 1
    for size in sizes:
        count *= size
    which, complex_, body = flags & 0xFF, bool(flags & 0x0800), parts[3:]
    if which in _NUMBERS:
        _all_plain(body, 2 if complex_ else 1)
    elif which == _TEXT:
        _all_plain(body, 1)
    elif which == _SPARSE:
        _all_plain(body, 4 if complex_ else 3)
    elif which == _CELL:
        _all_matrices(body, count)
    elif which in (_STRUCTURE, _OBJECT):
        head = 3 if which == _OBJECT else 2
        if len(body) < head or any(kind == _MATRIX for kind, _ in body[:head]):
            raise _Damaged("a structure without fields")
        length = int.from_bytes(body[head - 2][1][:4], "little" if order == "<" else "big")
        names = len(body[head - 1][1])
        if length <= 0 or names % length:
            raise _Damaged("a structure with damaged field names")
        _all_matrices(body[head:], count * (names // length))
    else:
        # Function handles and class instances hold no signals; scipy's handling of them is not
        # worth trusting with a file from elsewhere.
        raise _Damaged(
            f"a variable of class {which}, which holds no plain data: a function, or an object "
            "inside a structure"
        )
    return count


def _all_plain(parts: list[tuple[int, memoryview]], number: int) -> None:
    if len(parts) != number or any(kind == _MATRIX for kind, _ in parts):
        raise _Damaged("a variable without its numbers")


def _all_matrices(parts: list[tuple[int, memoryview]], number: int) -> None:
    if len(parts) != number or any(kind != _MATRIX for kind, _ in parts):
        raise _Damaged("a structure or cell without its contents")
