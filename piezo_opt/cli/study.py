"""``piezo-opt study``: published numbers beside those computed here."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs

study = typer.Typer(
    name="study",
    help="Published numbers beside those computed here.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@study.callback()
def _front() -> None:
    """Published numbers beside those computed here."""


@study.command()
def thesis(
    json: o.Json = None,
    page: Annotated[
        Path | None,
        typer.Option(metavar="PAGE.md", help="Page whose tables, between their marks, to renew."),
    ] = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Every number of the thesis that survives, beside the one that comes out here.

    \b
    Examples:
      piezo-opt study thesis
      piezo-opt study thesis --page docs/thesis.md
    """
    from piezo_opt.studies import study_thesis
    from piezo_opt.studies.page import tables_of, write_tables

    outputs.check({"--json": json}, overwrite=overwrite)
    if page is not None:
        tables_of(page)
    found = study_thesis()
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
    if page is not None:
        write_tables(page, found)
    typer.echo(str(found))
