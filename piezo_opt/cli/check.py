"""``piezo-opt check``: what records show about themselves, before anything is fitted."""

from __future__ import annotations

import sys

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.checking import UNANSWERED, Checking
from piezo_opt.cli.declare import Exit, echo
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import AS_WRITTEN, Reading
from piezo_opt.measurement import check as examine

REFUSED = 2
"""Exit code where a fit would be refused."""


@grouped
def check(
    records: o.Records,
    json: o.Json = None,
    reading: Reading = AS_WRITTEN,
    checking: Checking = UNANSWERED,
    overwrite: o.Overwrite = False,
) -> None:
    """Say what records show about themselves: wrong readings, units, clocks, channels.

    Every command that fits begins with the same check. What it mends by itself it says; what
    would make a fit wrong is refused until it is mended (--mend NAME) or accepted (--accept NAME).
    Nothing is written but --json. The exit code is 2 where a fit would be refused.

    \b
    Examples:
      piezo-opt check loop.csv
      piezo-opt check first.csv second.csv --json check.json
      piezo-opt check wrapped.csv --mend wrapped
    """
    outputs.check({"--json": json}, overwrite=overwrite, inputs=records)
    found = examine(
        reading.records(records), accept=checking.accept or (), mend=checking.mend or ()
    )
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
    if _braille():
        echo(f"{found.pictures()}\n")
    echo(str(found))
    if found.refused:
        raise Exit(REFUSED)


def _braille() -> bool:
    """Whether the terminal's letters include those of the picture."""
    try:
        "⣿".encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
