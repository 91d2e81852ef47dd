"""``piezo-opt compare``: several models on the same record, or on one that none has seen."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.checking import UNANSWERED, Checking
from piezo_opt.cli.choices import TranscriptionName
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import AS_WRITTEN, DEFAULT, Reading, asked, parted
from piezo_opt.cli.solving import Solving, exit_code, leave
from piezo_opt.comparison import compare as side_by_side
from piezo_opt.errors import InputError
from piezo_opt.identification import Fit
from piezo_opt.measurement import Campaign
from piezo_opt.stopping import TimeLimit


@grouped
def compare(
    records: o.Records,
    model: Annotated[
        list[str] | None,
        Option(
            metavar="MODEL.toml", help="Model file, JSON of a fit, or 'default'; repeat for more."
        ),
    ] = None,
    test: Annotated[
        list[Path] | None,
        Option(metavar="RECORD", help="Record to compare on, which no model is fitted to."),
    ] = None,
    json: o.Json = None,
    report: o.Page = None,
    reading: Reading = AS_WRITTEN,
    checking: Checking = UNANSWERED,
    split: o.Split = None,
    start: o.StartState = None,
    solver: o.Solver = None,
    transcription: o.Transcription = TranscriptionName.SINGLE,
    max_time: o.MaxTime = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Fit several models and put their errors side by side.

    Ctrl-C and --max-time compare what was fitted by then, and write every file that was asked for.

    \b
    Examples:
      piezo-opt compare loop.csv --model plain.toml --model creep.toml
      piezo-opt compare loop.csv --model plain.toml --model creep.toml --test other.csv
      piezo-opt compare loop.csv --model default --split "40 s" --report compare.html
    """
    if test and split is not None:
        raise InputError("--test and --split both say what to compare on: give one of them")
    outputs.check(
        {"--json": json, "--report": report},
        overwrite=overwrite,
        inputs=(*records, *(model or ()), *(test or ())),
    )
    train, held_out = parted(checking.records(reading.records(records)), split)
    if test:
        held_out = Campaign(tuple(map(checking.judging, reading.records(test))))
    chosen = model or [DEFAULT]
    # All files are read before the first fit: a typing error in the last one costs no waiting.
    questions = [asked(one, train, start) for one in chosen]
    how = Solving(solver, transcription, max_time=max_time)
    limit = TimeLimit(how.seconds)
    fits: list[Fit] = []
    for name, (question, remarks) in zip(chosen, questions, strict=True):
        fits.append(how.fit(question, remarks, name, limit))
        if exit_code(fits[-1]) or limit.passed:
            break
    comparison = side_by_side(*fits, on=held_out)
    echo(str(comparison))
    for name in chosen[len(fits) :]:
        echo(f"Not fitted for want of time: {name}.")
    if json is not None:
        outputs.write_json(json, comparison.to_dict(), overwrite=overwrite)
    if report is not None:
        outputs.write_page(report, comparison, *fits, overwrite=overwrite)
    for fit in fits:
        leave(fit)
