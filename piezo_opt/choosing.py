"""Choices and numbers as callers give them: one sentence at the call for what is neither."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any, TypeVar

from piezo_opt.errors import InputError

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


def is_number(value: Any) -> bool:
    """Whether something is one finite real number."""
    try:
        return not isinstance(value, complex) and math.isfinite(float(value))
    except (TypeError, ValueError, OverflowError):
        return False
