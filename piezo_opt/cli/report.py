"""``piezo-opt report``: fit and write the page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.checking import UNANSWERED, Checking
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import AS_WRITTEN, DEFAULT, Reading, asked, parted
from piezo_opt.cli.solving import AS_USUAL, Solving, leave
from piezo_opt.comparison import compare


@grouped
def report(
    records: o.Records,
    out: Annotated[Path, Option("--out", metavar="OUT.html", help="The page to write.")],
    model: o.ModelPath = DEFAULT,
    title: Annotated[str | None, Option(help="Title of the page.")] = None,
    reading: Reading = AS_WRITTEN,
    checking: Checking = UNANSWERED,
    split: o.Split = None,
    start: o.StartState = None,
    how: Solving = AS_USUAL,
    overwrite: o.Overwrite = False,
) -> None:
    """Fit a model and write one self-contained HTML page about it.

    \b
    Examples:
      piezo-opt report loop.csv --out loop.html
      piezo-opt report loop.csv --model creep.toml --split "40 s" --out creep.html
    """
    outputs.check(
        {"--out": out, "--log": how.log},
        overwrite=overwrite,
        inputs=(*records, model),
        grows=frozenset({"--log"}),
    )
    outputs.check_suffix("--out", out, outputs.PAGES)
    train, test = parted(checking.records(reading.records(records)), split)
    question, remarks = asked(model, train, start)
    answer = how.fit(question, remarks)
    results = (answer,) if test is None else (answer, compare(answer, on=test))
    echo(answer.outcome.sentence)
    outputs.write_page(out, *results, title=title, overwrite=overwrite)
    echo(f"Report: {out.resolve()}")
    leave(answer)
