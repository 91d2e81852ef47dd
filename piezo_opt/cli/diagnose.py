"""``piezo-opt diagnose``: which effect is missing, and does adding it hold."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.candidates import Candidates, read_candidates
from piezo_opt.cli.checking import UNANSWERED, Checking
from piezo_opt.cli.choices import EffortName, TranscriptionName
from piezo_opt.cli.codes import INTERRUPTED
from piezo_opt.cli.declare import Exit, Option, echo
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import AS_WRITTEN, DEFAULT, Reading, asked, parted
from piezo_opt.cli.solving import Solving, exit_code, leave
from piezo_opt.cli.telling import telling
from piezo_opt.diagnosis import Diagnosis, Stopped
from piezo_opt.diagnosis import diagnose as examine
from piezo_opt.diagnosis.advice import write_drives
from piezo_opt.diagnosis.evidence import WORTH
from piezo_opt.diagnosis.frontier import Effort
from piezo_opt.effects.catalogue import effect
from piezo_opt.errors import InputError
from piezo_opt.identification import Identification
from piezo_opt.measurement import Campaign, Measurement
from piezo_opt.stopping import TimeLimit


@grouped
def diagnose(
    records: o.Records,
    model: o.ModelPath = DEFAULT,
    test: Annotated[
        Path | None,
        Option(metavar="RECORD", help="Record to judge on, which nothing is fitted to."),
    ] = None,
    candidates: Annotated[
        Path | None,
        Option(metavar="FILE.py", help="Effects of your own, beside the catalogue."),
    ] = None,
    add: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="Effect that is in the model from the beginning."),
    ] = None,
    without: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="Effect taken out of the model, and not considered."),
    ] = None,
    withhold: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="Effect not to be considered; repeat for more."),
    ] = None,
    max_time: Annotated[
        str | None,
        Option(
            metavar="'60 s'",
            help="Then give the best so far. Unless given, a minute and 2 s more for every "
            "thousand samples.",
        ),
    ] = None,
    effort: Annotated[
        EffortName,
        Option(help="How many sets of effects are tried before it ends."),
    ] = EffortName.NORMAL,
    worth: Annotated[
        float,
        Option(
            metavar="NUMBER",
            help="What an effect must explain to be named. 0.35: the error grows by 6 % or more "
            "when it is left out again (sqrt(1 + NUMBER^2)).",
        ),
    ] = WORTH,
    json: o.Json = None,
    report: o.Page = None,
    drives: Annotated[
        Path | None,
        Option(metavar="DIR", help="Write the drives worth playing next here, as CSV."),
    ] = None,
    reading: Reading = AS_WRITTEN,
    checking: Checking = UNANSWERED,
    split: o.Split = None,
    start: o.StartState = None,
    solver: o.Solver = None,
    transcription: o.Transcription = TranscriptionName.SINGLE,
    overwrite: o.Overwrite = False,
) -> None:
    """Say where the model fails, which effect is missing, and whether adding it holds.

    Fits the model, then searches the sets of effects around it for the one that explains the
    record best for the fewest numbers. All data are fitted; --test, or what lies after --split,
    judges the answer. Ctrl-C and --max-time give the best so far, with every file that was asked
    for; the exit code is 130 after Ctrl-C.

    \b
    Examples:
      piezo-opt diagnose loop.csv --report loop.html
      piezo-opt diagnose train.csv --test other.csv --json diagnosis.json
      piezo-opt diagnose loop.csv --model mine.toml --candidates effects.py
      piezo-opt diagnose loop.csv --effort thorough
      piezo-opt diagnose loop.csv --add creep --without hysteretic_force --max-time "60 s"
    """
    if test is not None and split is not None:
        raise InputError("--test and --split both say what to judge on: give one of them")
    outputs.check(
        {"--json": json, "--report": report},
        overwrite=overwrite,
        inputs=(*records, model, test, candidates),
    )
    if drives is not None and not drives.is_dir():
        raise InputError(f"--drives {drives}: there is no such folder: make it first")
    withheld = (*(withhold or ()), *(without or ()))
    for name in withheld:
        effect(name)
    how = Solving(solver, transcription, max_time=max_time)
    limit = TimeLimit(how.seconds)
    own = Candidates() if candidates is None else read_candidates(candidates)
    train, later = parted(checking.records(reading.records(records)), split)
    held_out = _judge(later) if test is None else checking.judging(reading.single(test))
    question, remarks = asked(model, train, start)
    question = _overruled(question, add or (), without or ())
    baseline = how.fit(question, remarks, "Base model", limit)
    if exit_code(baseline):
        # There is no diagnosis; what there is goes where it was asked for.
        echo(str(baseline))
        if json is not None:
            outputs.write_json(json, baseline.to_dict(), overwrite=overwrite)
        if report is not None:
            outputs.write_page(report, baseline, overwrite=overwrite)
        leave(baseline)
    with telling("Diagnosis") as tell:
        found = examine(
            baseline,
            test=held_out,
            candidates=own.effects,
            withhold=withheld,
            effort=Effort[effort.name],
            worth=worth,
            max_time=limit.left,
            progress=tell,
        )
    echo(str(found))
    # What the first fit left out, the search may have found.
    joined = baseline.model.quasi_static and not found.final.model.quasi_static
    for sentence in (*own.remarks, *(() if joined else remarks)):
        echo(f"Remark: {sentence}")
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
    if drives is not None:
        _play(found, drives, overwrite=overwrite)
    if report is not None:
        outputs.write_page(report, found, overwrite=overwrite)
    if found.stopped is Stopped.USER:
        raise Exit(INTERRUPTED)


def _overruled(
    question: Identification, add: Sequence[str], without: Sequence[str]
) -> Identification:
    """The question with what the user puts into the model or takes out of it."""
    both = sorted(set(add) & set(without))
    if both:
        raise InputError(f"--add and --without both name {both[0]}: give one of them")
    model = question.model
    for name in add:
        added = effect(name)
        if name in model:
            raise InputError(f"--add {name}: the model has it already: leave the option out")
        model = model + added
    for name in without:
        model = model.without(name) if name in model else model
    return question if model is question.model else question.with_model(model)


def _judge(later: Campaign | None) -> Measurement | None:
    """The part to judge on; of several records there is none that could stand for the others."""
    if later is None:
        return None
    if len(later.records) > 1:
        raise InputError("--split takes one record: give the one to judge on by --test")
    return later.records[0]


def _play(found: Diagnosis, folder: Path, *, overwrite: bool) -> None:
    """Write the drives worth playing; without any, say so."""
    if not found.experiments:
        echo("No drive is advised: there is no group to split, nothing hidden to show.")
        return
    for file in write_drives(found.experiments, folder, overwrite=overwrite):
        echo(f"Drive: {file}")
