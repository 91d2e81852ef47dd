"""``piezo-opt fit``: records in, values with their uncertainty out."""

from __future__ import annotations

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.checking import UNANSWERED, Checking
from piezo_opt.cli.declare import echo
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import AS_WRITTEN, DEFAULT, Reading, asked, parted
from piezo_opt.cli.solving import AS_USUAL, Solving, leave
from piezo_opt.comparison import compare
from piezo_opt.identification import Ending


@grouped
def fit(
    records: o.Records,
    model: o.ModelPath = DEFAULT,
    json: o.Json = None,
    report: o.Page = None,
    reading: Reading = AS_WRITTEN,
    checking: Checking = UNANSWERED,
    split: o.Split = None,
    start: o.StartState = None,
    how: Solving = AS_USUAL,
    intervals: o.Intervals = None,
    replicates: o.Replicates = 200,
    overwrite: o.Overwrite = False,
    quiet: o.Quiet = False,
) -> None:
    """Fit a model to one or several records and see where it fails.

    \b
    Examples:
      piezo-opt fit loop.csv --json fit.json --report fit.html
      piezo-opt fit loop.csv --model creep.toml --split "40 s"
      piezo-opt fit sweep.csv --drive "u [V]" --position "y [nm]" --starts 20 --workers 2
      piezo-opt fit loop.csv --intervals bootstrap --replicates 1000 --workers 4
      piezo-opt fit loop.csv --intervals profile

    A CSV file has a header with units: time [s],voltage [V],displacement [um].
    Ctrl-C and --max-time give the best so far, with every file that was asked for; the exit code is
    130 after Ctrl-C.
    """
    outputs.check(
        {"--json": json, "--report": report, "--log": how.log},
        overwrite=overwrite,
        inputs=(*records, model),
        grows=frozenset({"--log"}),
    )
    train, test = parted(checking.records(reading.records(records)), split)
    question, remarks = asked(model, train, start)
    answer = how.fit(question, remarks)
    comparison = compare(answer, on=test)
    sure = None
    if intervals is not None and answer.outcome.ending is not Ending.INTERRUPTED:
        from piezo_opt.cli.intervals import intervals as found

        sure = found(
            answer,
            intervals,
            replicates=replicates,
            seed=how.seed,
            workers=how.workers,
            log=how.log,
        )
    # What was found is said before anything is written or drawn, which may fail.
    parts = (answer, comparison) if sure is None else (answer, sure, comparison)
    echo(answer.outcome.sentence if quiet else "\n\n".join(map(str, parts)))
    if json is not None:
        data = answer.to_dict()
        if sure is not None:
            data["intervals"] = sure.to_dict()
        if test is not None:
            data["held_out"] = comparison.to_dict()
        outputs.write_json(json, data, overwrite=overwrite)
    if report is not None:
        outputs.write_page(report, answer, comparison, overwrite=overwrite)
    leave(answer)
