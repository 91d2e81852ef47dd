"""The application: its commands, and what happens when one of them fails."""

from __future__ import annotations

import sys
import tempfile
import traceback
from importlib.metadata import version as installed
from typing import Annotated, Any, final

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

from piezo_opt.cli.bench import bench
from piezo_opt.cli.check import check
from piezo_opt.cli.compare import compare
from piezo_opt.cli.demo import demo
from piezo_opt.cli.diagnose import diagnose
from piezo_opt.cli.export import export
from piezo_opt.cli.fem import fem
from piezo_opt.cli.fit import fit
from piezo_opt.cli.linear import linear
from piezo_opt.cli.report import report
from piezo_opt.cli.signal_best import signal
from piezo_opt.cli.simulate import simulate
from piezo_opt.cli.solving import INTERRUPTED
from piezo_opt.cli.study import study
from piezo_opt.errors import PiezoOptError

__all__ = ["app", "main"]

BAD_INPUT = 2
FAILED = 1


@final
class _OneSentence(TyperGroup):
    """Turns what a user did wrong into one sentence on stderr and exit code 2."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; an error of the user's is no reason for a traceback."""
        try:
            return super().invoke(ctx)
        except PiezoOptError as error:
            typer.echo(" ".join(str(error).split()), err=True)
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


_ITS_OWN = (TyperException, typer.Exit, typer.Abort)
"""What the command-line library raises on purpose, to be told or to end."""


def _to_send(error: Exception) -> str:
    """Writes down where an error of the package's own happened, and says so."""
    with tempfile.NamedTemporaryFile(
        "w", encoding="utf-8", prefix="piezo-opt-", suffix=".txt", delete=False
    ) as file:
        file.write(f"piezo-opt {installed('piezo_opt')}\n{' '.join(sys.argv)}\n\n")
        traceback.print_exception(error, file=file)
    return (
        f"An error of the program itself, not of the input: {type(error).__name__}. What was "
        f"printed before holds. Please send {file.name} with a description of the record."
    )


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


for command in (demo, check, fit, diagnose, simulate, compare, report, linear):
    app.command()(command)
app.add_typer(bench)
app.add_typer(study)
app.add_typer(export)
app.add_typer(fem)
app.add_typer(signal)


def main() -> None:
    """Entry point of the command ``piezo-opt``."""
    app()
