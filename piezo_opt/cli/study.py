"""``piezo-opt study``: published numbers beside ours, and what a diagnosis is worth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Commands, Option, echo
from piezo_opt.cli.limiting import limit_of, limited
from piezo_opt.cli.solving import pool
from piezo_opt.cli.telling import telling

study = Commands(
    "study", "Published numbers beside ours, and what a diagnosis is worth to a controller."
)


@study.command()
def thesis(
    json: o.Json = None,
    page: Annotated[
        Path | None,
        Option(metavar="PAGE.md", help="Page whose tables, between their marks, to renew."),
    ] = None,
    picture: Annotated[
        Path | None,
        Option(metavar="OUT.png", help="The pictures of its chapter 4: .png or .svg."),
    ] = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Every number of the thesis that survives, beside the one that comes out here.

    \b
    Examples:
      piezo-opt study thesis
      piezo-opt study thesis --page docs/thesis.md --picture chapter4.png
    """
    from piezo_opt.studies import study_thesis
    from piezo_opt.studies.page import tables_of, write_tables

    outputs.check({"--json": json, "--picture": picture}, overwrite=overwrite)
    if page is not None:
        tables_of(page)
    with telling("Thesis") as tell:
        found = study_thesis(tell)
    echo(str(found))
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
    if page is not None:
        write_tables(page, found)
    if picture is not None:
        from piezo_opt.report.thesis import chapter_four
        from piezo_opt.studies.thesis.control import hysteresis_loops, vibration_answers
        from piezo_opt.studies.thesis.hysteresis import loop_fit

        fit = loop_fit()
        outputs.write_picture(
            picture,
            lambda: chapter_four(fit, hysteresis_loops(fit), *vibration_answers()),
            overwrite=overwrite,
        )


@study.command()
def worth(
    plants: Annotated[int, Option(min=1, metavar="N", help="Number of plants.")] = 20,
    seed: Annotated[int, Option(min=0, help="Seed of the first plant; others follow.")] = 0,
    samples: Annotated[int, Option(min=1000, metavar="N", help="Samples of each record.")] = 3000,
    workers: Annotated[
        int, Option(min=1, metavar="N", help="Processes that share the plants.")
    ] = 1,
    json: o.Json = None,
    picture: Annotated[
        Path | None, Option(metavar="OUT.png", help="Every plant as a point: .png or .svg.")
    ] = None,
    max_time: o.MaxTime = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Controllers on the undiagnosed, the diagnosed and the best model, tried on foreign plants.

    Every plant has creep and a second mode and shares no code with the package. About a minute
    of processor time for each; Ctrl-C and --max-time give the plants that were finished.

    \b
    Examples:
      piezo-opt study worth --plants 2
      piezo-opt study worth --workers 2 --json worth.json --picture worth.png
    """
    from piezo_opt.studies import study_worth

    outputs.check({"--json": json, "--picture": picture}, overwrite=overwrite)
    limit = limit_of(max_time)
    with pool(workers) as executor, telling("Study") as tell, limited(limit):
        found = study_worth(
            plants, seed, samples=samples, executor=executor,
            progress=lambda done, of: tell(f"{done} of {of} plants (Ctrl-C prints those)"),
        )  # fmt: skip
    echo(str(found))
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
    if picture is not None:
        from piezo_opt.report.worth import worths

        outputs.write_picture(picture, lambda: worths(found.points()), overwrite=overwrite)
