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
from importlib.metadata import version as installed
from pathlib import Path
from typing import Annotated, Any, Final, final

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException
from typer.models import TyperInfo

from piezo_opt.cli.codes import BAD_INPUT, FAILED, INTERRUPTED
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
class _OnDemand(Mapping[str, Any]):
    """The commands by name, each made of its file when it is asked for: none waits for another's
    imports."""

    def __getitem__(self, name: str) -> Any:
        made = getattr(import_module(f"piezo_opt.cli.{_ROOMS[name]}"), name)
        if isinstance(made, typer.Typer):
            return typer.main.get_group_from_info(
                TyperInfo(made, name=name),
                pretty_exceptions_short=True,
                rich_markup_mode=None,
                suggest_commands=True,
            )
        alone = typer.Typer(
            add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False
        )
        alone.command(name)(made)
        return typer.main.get_command(alone)

    def __iter__(self) -> Iterator[str]:
        return iter(_ROOMS)

    def __len__(self) -> int:
        return len(_ROOMS)


@final
class _OneSentence(TyperGroup):
    """Turns what a user did wrong into one sentence on stderr and exit code 2."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = _OnDemand()  # type: ignore[assignment]

    def invoke(self, ctx: Any) -> Any:
        """Run the command; an error of the user's is no reason for a traceback."""
        try:
            return super().invoke(ctx)
        except PiezoOptError as error:
            typer.echo(_in_options(" ".join(str(error).split())), err=True)
            raise typer.Exit(BAD_INPUT) from None
        except MemoryError:
            typer.echo("There is not enough memory: cut the record or thin it.", err=True)
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt:
            typer.echo("Interrupted before there was a result.", err=True)
            raise typer.Exit(INTERRUPTED) from None
        except _ITS_OWN:
            raise
        except Exception as error:
            typer.echo(_to_send(error), err=True)
            raise typer.Exit(FAILED) from None


_SAID_IN_PYTHON: Final = re.compile(
    r"(?<![\w.(])(time|drive|position|record|between|period|startup|rate|trim|every|gain|scale"
    r"|decimal)=(?=\S)"
)
"""Options of reading as Python writes them, and not inside of a call."""


def _in_options(sentence: str) -> str:
    """A remedy as the command takes it: ``rate='1 kHz'`` is ``--rate '1 kHz'`` in a shell."""
    return _SAID_IN_PYTHON.sub(r"--\1 ", sentence)


_ITS_OWN = (TyperException, typer.Exit, typer.Abort)
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
            file.write(f"piezo-opt {installed('piezo_opt')}\n{' '.join(sys.argv)}\n\n")
            traceback.print_exception(error, file=file)
    except OSError:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return (
            f"{what} Please send this sentence ({Path(where.filename).name}, line {where.lineno}: "
            f"{' '.join(str(error).split())[:200]}), as there is no room for a file."
        )
    return f"{what} Please send {file.name} with a description of the record."


app = typer.Typer(
    cls=_OneSentence,
    name="piezo-opt",
    help="Identify piezoelectric actuators: read a record, fit the physics, see what is missing.",
    epilog="Begin with: piezo-opt demo",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"piezo-opt {installed('piezo_opt')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


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
        typer.echo(
            f"Standard output could not be written ({said.failed}); files that were asked for are "
            "whole.",
            err=True,
        )
        raise SystemExit(ending.code or FAILED) from None
