"""Effects of the user's own, out of a Python file."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import final

from piezo_opt.assembly import check_effect
from piezo_opt.effects import Effect
from piezo_opt.effects.catalogue import CATALOGUE
from piezo_opt.effects.promises import first_line, in_words, line_of
from piezo_opt.errors import InputError, ModelError


@final
@dataclass(frozen=True)
class Candidates:
    """Effects that a file offers, and sentences about what it cannot offer."""

    effects: tuple[Effect, ...] = ()
    remarks: tuple[str, ...] = ()


def read_candidates(path: Path) -> Candidates:
    """Every effect that is defined in a Python file, in the order written.

    A class that another file defines, an abstract one, and one whose name begins with an
    underscore is no candidate; a structural one is left out with a remark.

    Raises:
        InputError: there is no such file, it is none of Python, it raises, it has no effect, or one
            of them cannot be made, does not vanish at its null, or has a unit that does not exist.
    """
    if not path.is_file():
        raise InputError(f"--candidates {path}: there is no such file: give a .py file")
    module = _run(path)
    kinds = [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind)
        and issubclass(kind, Effect)
        and kind.__module__ == module.__name__
        and not inspect.isabstract(kind)
        and not kind.__name__.startswith("_")
    ]
    if not kinds:
        raise InputError(
            f"--candidates {path}: it defines no effect: write a class that derives from "
            "piezo_opt.Effect"
        )
    effects: list[Effect] = []
    remarks: list[str] = []
    for kind in dict.fromkeys(kinds):
        if kind.structural:
            remarks.append(f"{kind.__name__} ({path}) is structural: it has no gate to be scored.")
            continue
        try:
            own = kind.entries()
        except (Exception, SystemExit) as error:  # whatever a user's own code raises
            raise InputError(
                f"--candidates {line_of(str(path), error)}: {kind.__name__} cannot be made: "
                f"{in_words(error)}"
            ) from error
        for effect in own:
            try:
                check_effect(effect)
            except ModelError as error:
                placed = ", line " in str(error)
                where = "" if placed else f"{first_line(effect)}: "
                raise InputError(f"--candidates {where}{error}") from error
            if effect.name in CATALOGUE:
                raise InputError(
                    f"--candidates {first_line(effect)}: the catalogue has an effect called "
                    f"{effect.name}: give the class another name"
                )
        effects += own
    return Candidates(tuple(effects), tuple(remarks))


def _run(path: Path) -> ModuleType:
    """The module that the file makes."""
    name = f"candidates_of_{path.stem}"
    specification = importlib.util.spec_from_file_location(name, path)
    if specification is None or specification.loader is None:
        raise InputError(f"--candidates {path}: is no Python file: its name must end with .py")
    module = importlib.util.module_from_spec(specification)
    # Dataclasses look up the module that their class comes from.
    sys.modules[name] = module
    try:
        specification.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # whatever a user's own code raises
        raise InputError(f"--candidates {line_of(str(path), error)}: {in_words(error)}") from error
    return module
