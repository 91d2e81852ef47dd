"""Choices and numbers as callers give them: one sentence at the call for what is neither."""

from __future__ import annotations

import math
from enum import Enum
from numbers import Integral
from typing import Any, Final, TypeVar

from piezo_opt.errors import InputError

_LONGEST: Final = 60
"""Letters of a value that a sentence shows."""
_Choice = TypeVar("_Choice", bound=Enum)


def chosen(kind: type[_Choice], value: object, what: str) -> _Choice:
    """A member of ``kind``, given as itself or by its word.

    Raises:
        InputError: there is no such member; the sentence lists those there are.
    """
    if isinstance(value, kind):
        return value
    for one in kind:
        if value == one.value:
            return one
    raise InputError(
        f"{what} is {value!r}: give {', '.join(f'{kind.__name__}.{one.name}' for one in kind)}."
    )


def expected(kind: type | tuple[type, ...], value: object, what: str, remedy: str) -> None:
    """Refuse what is of another kind.

    Raises:
        InputError: it is.
    """
    if not isinstance(value, kind):
        raise InputError(f"{what} is {_shown(value)}: give {remedy}.")


def whole(value: object, what: str, least: int) -> None:
    """Refuse what is no whole number from ``least`` on.

    Raises:
        InputError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise InputError(f"{what} is {_shown(value)}: give a whole number from {least} on.")


def real(value: Any, what: str) -> None:
    """Refuse what is no real number; infinity is one.

    Raises:
        InputError: it is none.
    """
    try:
        if isinstance(value, bool | str | complex):
            raise TypeError("no number")
        float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} is {_shown(value)}: give a number in SI units.") from None


def words(value: object, what: str) -> None:
    """Refuse one text where several are expected: each of its letters would be one.

    Raises:
        InputError: it is a text.
    """
    if isinstance(value, str):
        raise InputError(f"{what} is the text {_shown(value)}: give a tuple, (..., ).")


def _shown(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def is_number(value: Any) -> bool:
    """Whether something is one finite real number."""
    try:
        return not isinstance(value, bool | complex | str) and math.isfinite(float(value))
    except (TypeError, ValueError, OverflowError):
        return False
