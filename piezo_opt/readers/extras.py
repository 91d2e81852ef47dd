"""Libraries that only some files need."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from piezo_opt.errors import InputError


def needed(library: str, *, extra: str, what: str) -> Any:
    """A library of an extra; `InputError` names what to install when it is missing."""
    try:
        return import_module(library)
    except ImportError as error:
        raise InputError(
            f"{what} need {library.partition('.')[0]}: install it with "
            f"pip install 'piezo_opt[{extra}]'"
        ) from error
