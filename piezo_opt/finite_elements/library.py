"""The libraries that finite elements need, imported where they are used."""

from __future__ import annotations

import importlib
from typing import Any

from piezo_opt.errors import InputError


def library(name: str) -> Any:
    """The module of that name.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"finite elements need the package {name}: install piezo_opt[fem]"
        ) from error
