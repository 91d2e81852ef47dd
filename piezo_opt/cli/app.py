"""The application: its commands, and what happens when one of them fails."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import tempfile
import traceback
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Final, final

import click

from piezo_opt.cli.codes import BAD_INPUT, FAILED, INTERRUPTED
from piezo_opt.cli.declare import Exit, command, echo
from piezo_opt.cli.enduring import Enduring
from piezo_opt.errors import PiezoOptError

__all__ = ["app", "main"]

_ROOMS: Final = {
    **{name: name for name in ("demo", "check", "fit", "diagnose", "simulate", "compare")},
    **{name: name for name in ("report", "linear", "axes", "bench", "study", "export", "fem")},
    "signal": "signal_best",
    "track": "track",
    "tune": "tune",
    "workbench": "workbench",
}
"""The file of each command, in the order of the help."""


@final
class _OnDemand(Mapping[str, click.Command]):
    """The commands by name, each made of its file when it is asked for: none waits for another's
    imports."""

    def __getitem__(self, name: str) -> click.Command:
        made = getattr(import_module(f"piezo_opt.cli.{_ROOMS[name]}"), name)
        return made if isinstance(made, click.Command) else command(made, name)

    def __iter__(self) -> Iterator[str]:
        return iter(_ROOMS)

    def __len__(self) -> int:
        return len(_ROOMS)


@final
class _OneSentence(click.Group):
    """Turns what a user did wrong into one sentence on stderr and exit code 2."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = _OnDemand()  # type: ignore[assignment]

    def list_commands(self, _: click.Context) -> list[str]:
        """In the order of the help."""
        return list(self.commands)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; an error of the user's is no reason for a traceback."""
        try:
            return super().invoke(ctx)
        except PiezoOptError as error:
            echo(_in_options(" ".join(str(error).split())), err=True)
            raise Exit(BAD_INPUT) from None
        except MemoryError:
            echo("There is not enough memory: cut the record or thin it.", err=True)
            raise Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            echo("Interrupted before there was a result.", err=True)
            raise Exit(INTERRUPTED) from None
        except _ITS_OWN:
            raise
        except Exception as error:
            echo(_to_send(error), err=True)
            raise Exit(FAILED) from None


_SAID_IN_PYTHON: Final = re.compile(
    r"(?<![\w.(])(time|drive|position|record|between|period|startup|rate|trim|every|gain|scale"
    r"|decimal)=(?=\S)"
)
"""Options of reading as Python writes them, and not inside of a call."""


def _in_options(sentence: str) -> str:
    """A remedy as the command takes it: ``rate='1 kHz'`` is ``--rate '1 kHz'`` in a shell."""
    return _SAID_IN_PYTHON.sub(r"--\1 ", sentence)


_ITS_OWN = (click.ClickException, Exit, click.Abort)
"""What the command-line library raises on purpose, to be told or to end."""


def _to_send(error: Exception) -> str:
    """Writes down where an error of the package's own happened, and says so."""
    what = (
        f"An error of the program itself, not of the input: {type(error).__name__}. What was "
        "printed before holds."
    )
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", prefix="piezo-opt-", suffix=".txt", delete=False
        ) as file:
            file.write(f"piezo-opt {_installed()}\n{' '.join(sys.argv)}\n\n")
            traceback.print_exception(error, file=file)
    except OSError:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return (
            f"{what} Please send this sentence ({Path(where.filename).name}, line {where.lineno}: "
            f"{' '.join(str(error).split())[:200]}), as there is no room for a file."
        )
    return f"{what} Please send {file.name} with a description of the record."


def _version(_context: click.Context, _option: click.Parameter, asked: bool) -> None:
    if asked:
        echo(f"piezo-opt {_installed()}")
        raise Exit


def _installed() -> str:
    from importlib.metadata import version  # slow to load, and rarely asked

    return version("piezo_opt")


app = _OneSentence(
    name="piezo-opt",
    help="Identify piezoelectric actuators: read a record, fit the physics, see what is missing.",
    epilog="Begin with: piezo-opt demo",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    params=[
        click.Option(
            ["--version"], is_flag=True, expose_value=False, is_eager=True, callback=_version,
            help="Print the version.",
        )
    ],
)  # fmt: skip


def main() -> None:
    """Run the command of ``sys.argv``, and end the process with its code.

    Standard output that cannot be written (a full disk) is one sentence and exit code 1, after the
    files that were asked for.
    """
    with contextlib.ExitStack() as streams:
        for name in ("stdout", "stderr"):
            if getattr(sys, name) is None:  # closed by who began the process: nobody listens
                nobody = streams.enter_context(open(os.devnull, "w", encoding="utf-8"))
                setattr(sys, name, nobody)
        _told()


def _told() -> None:
    said = Enduring(sys.stdout)
    sys.stdout = said
    try:
        app()
    except SystemExit as ending:
        said.flush()
        if not said.failed:
            raise
        echo(
            f"Standard output could not be written ({said.failed}); files that were asked for are "
            "whole.",
            err=True,
        )
        raise SystemExit(ending.code or FAILED) from None
