"""``piezo-opt demo``: the main job on the record that ships with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.telling import telling
from piezo_opt.demo import PAGE, found


def demo(
    out: Annotated[
        Path,
        Option(metavar="DIR|OUT.html", help=f"Where to write; a folder gets {PAGE}."),
    ] = Path(),
) -> None:
    """Fit the thesis' measured loop, say where the fit fails, and write a page with pictures.

    The page of an earlier demo is replaced; no other file is.

    \b
    Examples:
      piezo-opt demo
      piezo-opt demo --out /tmp
    """
    done = found(out)
    echo(str(done))
    with telling("Report") as tell:
        tell(f"drawing {done.page}")
        done.write_page()
    echo(f"\nReport: {done.page.resolve()}")
