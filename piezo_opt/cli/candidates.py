"""Effects of the user's own, out of a Python file."""

from __future__ import annotations

import importlib.util
import inspect
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import final

from piezo_opt.effects import Effect
from piezo_opt.errors import InputError


@final
@dataclass(frozen=True)
class Candidates:
    """Effects that a file offers, and sentences about what it cannot offer."""

    effects: tuple[Effect, ...] = ()
    remarks: tuple[str, ...] = ()


def read_candidates(path: Path) -> Candidates:
    """Every effect that is defined in a Python file, in the order written.

    A class that another file defines, an abstract one, and one whose name begins with an
    underscore is no candidate. One that cannot be made is left out with a remark. Where the file
    itself raises, a remark says in which line, and what it had defined by then is offered.

    Raises:
        InputError: there is no such file, or it is none of Python, or it has no effect.
    """
    if not path.is_file():
        raise InputError(f"--candidates {path}: there is no such file: give a .py file")
    module, raised = _run(path)
    kinds = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind)
        and issubclass(kind, Effect)
        and kind.__module__ == module.__name__
        and not inspect.isabstract(kind)
        and not kind.__name__.startswith("_")
    ]
    if not kinds and not raised:
        raise InputError(
            f"--candidates {path}: it defines no effect: write a class that derives from "
            "piezo_opt.Effect"
        )
    effects: list[Effect] = []
    remarks = [f"--candidates {sentence}: what follows it is left out." for sentence in raised]
    for kind in dict.fromkeys(kinds):
        if kind.structural:
            remarks.append(f"{kind.__name__} ({path}) is structural: it has no gate to be scored.")
            continue
        try:
            effects += kind.entries()
        except Exception as error:  # whatever a user's own code raises
            remarks.append(f"{kind.__name__} cannot be made: {_said(error, path)}.")
    return Candidates(tuple(effects), tuple(remarks))


def _run(path: Path) -> tuple[ModuleType, list[str]]:
    """The module as far as it got, and where it raised, if it did."""
    name = f"candidates_of_{path.stem}"
    specification = importlib.util.spec_from_file_location(name, path)
    if specification is None or specification.loader is None:
        raise InputError(f"--candidates {path}: is no Python file: its name must end with .py")
    module = importlib.util.module_from_spec(specification)
    # Dataclasses look up the module that their class comes from.
    sys.modules[name] = module
    try:
        specification.loader.exec_module(module)
    except Exception as error:  # whatever a user's own code raises
        return module, [_said(error, path)]
    return module, []


def _said(error: Exception, path: Path) -> str:
    """Type and text of an error, with the last line of the file on the way to it."""
    text = str(error.msg if isinstance(error, SyntaxError) else error)
    what = f"{type(error).__name__}: {text}" if text else type(error).__name__
    if isinstance(error, SyntaxError):
        return f"{error.filename or path}, line {error.lineno}: {what}"
    # The traceback has the whole path, also where the user gave a relative one.
    own = path.resolve()
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if Path(frame.filename).resolve() == own
    ]
    return f"{path}, line {lines[-1]}: {what}" if lines else f"{path}: {what}"
