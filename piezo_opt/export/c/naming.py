"""Names in C: of parameters, states and channels, from the names that the model gives them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, final

from piezo_opt.assembly import System
from piezo_opt.errors import InputError

_WORDS: Final = """
auto break case char const continue default do double else enum extern float for goto if
inline int long register restrict return short signed sizeof static struct switch typedef
union unsigned void volatile while class delete new this try catch throw template typename
using namespace public private protected virtual friend operator bool true false main
"""
"""Words of C and C++, none of which can be a name."""


@final
@dataclass(frozen=True)
class Field:
    """One number, or a column of them, in one of the structs.

    Attributes:
        full: its name in the model, ``"creep.z"``.
        name: its name in C, ``"creep_z"``.
        size: number of elements; None for a single number.
        unit, meaning: what its comment says.
        at: position of its first element in the system's own order.
    """

    full: str
    name: str
    size: int | None
    unit: str
    meaning: str
    at: int

    @property
    def elements(self) -> list[str]:
        """Its elements as they stand in C."""
        return [self.name] if self.size is None else [f"{self.name}[{i}]" for i in range(self.size)]

    @property
    def declared(self) -> str:
        """As it stands in its struct."""
        return self.name if self.size is None else f"{self.name}[{self.size}]"


def prefix(name: str) -> str:
    """The prefix of everything that is written, as given.

    Raises:
        InputError: it is no name in C.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name) or name in _WORDS.split():
        raise InputError(
            f"name = {name!r}: is no name in C; take up to 31 letters, digits and underscores, "
            "and a letter first"
        )
    return name


def plain(text: str) -> str:
    """A text that may stand in a comment: one line of ASCII without an end of the comment."""
    told = {"°": " deg", "µ": "u", "±": "+-", "²": "^2", "³": "^3", "·": "*", "–": "-", "é": "e"}
    for sign, words in told.items():
        text = text.replace(sign, words)
    ascii_only = text.encode("ascii", "replace").decode()
    return " ".join(ascii_only.replace("*/", "* /").replace("/*", "/ *").split())


def parameters(system: System) -> list[Field]:
    """The parameters of a system that its code leaves open."""
    declared = system.model.parameters
    names = _distinct(system.parameter_names)
    return [
        Field(full, name, None, declared[full].unit, declared[full].meaning, i)
        for i, (full, name) in enumerate(zip(system.parameter_names, names, strict=True))
    ]


def states(system: System) -> list[Field]:
    """The states of a system, elements of one column together."""
    found: list[Field] = []
    at = 0
    for effect, kind in system.model:
        for own, size in kind.states.items():
            declared = kind.declared_states[own]
            full = f"{effect}.{own}"
            count = None if size == 1 else size
            found.append(Field(full, full, count, declared.unit, declared.meaning, at))
            at += size
    names = _distinct([one.full for one in found])
    return [
        Field(one.full, name, one.size, one.unit, one.meaning, one.at)
        for one, name in zip(found, names, strict=True)
    ]


def channels(system: System) -> list[str]:
    """The further channels that a system follows."""
    return _distinct(system.channel_names)


def _distinct(names: Iterable[str]) -> list[str]:
    """Names in C, each once."""
    taken: list[str] = []
    for full in names:
        name = re.sub(r"\W", "_", full.encode("ascii", "replace").decode())
        while name in taken or name in _WORDS.split():
            name += "_"
        taken.append(name)
    return taken
