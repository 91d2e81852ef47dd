"""A session: the records, every step, and how many of them hold; a JSON file and a script."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, final

from piezo_opt.errors import InputError
from piezo_opt.files import checked, replacing
from piezo_opt.workbench.edits import Adopt, Edit, begin_code, edit_from_dict, edit_to_dict
from piezo_opt.workbench.load import Load

SCHEMA: Final = "piezo_opt/workbench/1"
_LARGEST: Final = 1 << 24
"""[bytes] of a session file; a thousand steps have some hundred thousand."""


@final
@dataclass(frozen=True)
class Session:
    """Immutable: every click makes another one.

    Attributes:
        load: the records and the answers to their check.
        fitted: whether the default model was asked for.
        edits: steps after the first fit, those that were undone last.
        depth: how many of the edits hold.
    """

    load: Load
    fitted: bool = False
    edits: tuple[Edit, ...] = ()
    depth: int = 0

    @property
    def path(self) -> tuple[Edit, ...]:
        """The edits that hold."""
        return self.edits[: self.depth]

    @property
    def key(self) -> str:
        """What the fit of the steps that hold follows from, beside the records."""
        return json.dumps([edit_to_dict(edit) for edit in self.path], sort_keys=True)

    def with_(self, edit: Edit) -> Session:
        """One step more; what was undone before is forgotten."""
        return replace(self, edits=(*self.path, edit), depth=self.depth + 1)

    def undone(self) -> Session:
        """One step back.

        Raises:
            InputError: there is none.
        """
        if self.depth == 0:
            raise InputError("There is no step to undo.")
        return replace(self, depth=self.depth - 1)

    def redone(self) -> Session:
        """One step that was undone.

        Raises:
            InputError: there is none.
        """
        if self.depth == len(self.edits):
            raise InputError("There is no step to redo.")
        return replace(self, depth=self.depth + 1)

    @property
    def script(self) -> str:
        """Python that gives the same numbers without the page."""
        lines = [
            '"""What was clicked in a session of `piezo-opt workbench`, line by line.',
            "",
            "`python SCRIPT FIT.json` writes the last fit to a file.",
            '"""',
            "",
            "import sys",
            "from dataclasses import replace",
            "",
            "import piezo_opt as po",
            "from piezo_opt import effects",
            "",
            *self.load.code,
        ]
        if self.fitted:
            lines += [
                "",
                "# The default model.",
                "records, held = po.as_driven(records)",
                "model, remarks = po.default_model(records)",
                "fit_0 = po.solve(po.Identification(model, records))",
            ]
            for number, edit in enumerate(self.path, start=1):
                before = f"fit_{number - 1}"
                lines += ["", f"# {edit.title[:1].upper()}{edit.title[1:]}."]
                if isinstance(edit, Adopt):
                    lines.append(f"# It was found by po.diagnose({before}), and is begun there.")
                lines += [
                    f"question = {edit.code(before)}",
                    f"fit_{number} = po.solve(question, start={begin_code(edit, before)})",
                ]
            fits = [f"fit_{number}" for number in range(self.depth + 1)]
            lines += [
                "",
                f"fit = {fits[-1]}",
                "print(fit)",
                f"print(po.compare({', '.join(fits)}))",
                "if len(sys.argv) > 1:",
                "    fit.write_json(sys.argv[1])",
            ]
        return "\n".join(lines) + "\n"

    def to_dict(self) -> dict[str, Any]:
        """Plain data with a ``schema`` key."""
        return {
            "schema": SCHEMA,
            "load": self.load.to_dict(),
            "fitted": self.fitted,
            "edits": [edit_to_dict(edit) for edit in self.edits],
            "depth": self.depth,
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Session:
        """What :meth:`to_dict` gave.

        Raises:
            InputError: it is something else.
        """
        if not isinstance(data, Mapping) or data.get("schema") != SCHEMA:
            raise InputError(f"this is no session: its schema is not {SCHEMA!r}")
        edits, depth = data.get("edits"), data.get("depth")
        if not isinstance(edits, list) or type(depth) is not int or not 0 <= depth <= len(edits):
            raise InputError("its steps are not a list, or fewer than it counts")
        load = Load.from_dict(data.get("load", {}))
        steps = tuple(edit_from_dict(one) for one in edits)
        return Session(load, data.get("fitted") is True, steps, depth)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the session to a file, whole or not at all, in the place of an earlier one.

        Raises:
            InputError: it cannot be written.
        """
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"
        with (
            replacing(path, overwrite=True) as scratch,
            open(scratch, "w", encoding="utf-8") as file,
        ):
            file.write(text)
            file.flush()
            os.fsync(file.fileno())


def read_session(path: str | os.PathLike[str]) -> Session:
    """The session of a file.

    Raises:
        InputError: the file is none.
    """
    file = checked(path)
    if file.stat().st_size > _LARGEST:
        raise InputError(f"{file}: is no session: it is too large for one")
    try:
        return Session.from_dict(json.loads(file.read_text(encoding="utf-8")))
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file}: is no session: {error}") from None
