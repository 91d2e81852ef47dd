"""``piezo-opt bench speed``: nanoseconds a sample, beside programs that do nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.telling import telling
from piezo_opt.errors import InputError

if TYPE_CHECKING:
    from piezo_opt.benchmark.batch_speed import BatchSpeed
    from piezo_opt.benchmark.equal_accuracy import EqualAccuracy
    from piezo_opt.benchmark.scaling import Scaling


def speed(
    samples: Annotated[int, Option(min=100, metavar="N", help="Of the record.")] = 8000,
    repetitions: Annotated[
        int, Option(min=1, metavar="N", help="Runs of each, in turns; the fastest counts.")
    ] = 15,
    library: Annotated[
        bool, Option(help="Build the library of all effects anew, in an empty folder.")
    ] = True,
    alternatives: Annotated[
        bool, Option(help="Also what a user would take instead, at equal accuracy.")
    ] = True,
    scaling: Annotated[
        bool,
        Option(help="Also how time grows with resonance, parameters and sets."),
    ] = True,
    picture: Annotated[
        Path | None,
        Option(metavar="OUT.png", help="Error against time of every way: .png or .svg."),
    ] = None,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Simulate five models, and compare with C compiled for each of them and written by hand.

    Then what a user would take instead at equal accuracy, by how much the best scheme is faster as
    the resonance rises, and how time grows with derivatives and with sets of parameters. Takes
    about two minutes.

    \b
    Examples:
      piezo-opt bench speed
      piezo-opt bench speed --no-library --json speed.json --picture work_precision.png
    """
    from piezo_opt.benchmark.alternatives import alternatives as others
    from piezo_opt.benchmark.batch_speed import measure_batch
    from piezo_opt.benchmark.equal_accuracy import equal_accuracy
    from piezo_opt.benchmark.scaling import measure_scaling
    from piezo_opt.benchmark.speed import measure
    from piezo_opt.report.speed_figures import work_precision

    outputs.check({"--json": json, "--picture": picture}, overwrite=overwrite)
    if picture is not None and not alternatives:
        raise InputError("--picture: shows the alternatives: leave --no-alternatives out")
    with telling("Speed") as tell:
        found = measure(samples, repetitions, library=library, progress=tell)
        beside = others(samples, repetitions, tell) if alternatives else None
        more: dict[str, EqualAccuracy | Scaling | BatchSpeed] = {}
        if scaling:
            more["equal_accuracy"] = equal_accuracy(samples // 2, repetitions, progress=tell)
            more["scaling"] = measure_scaling(samples, repetitions, progress=tell)
            tell("many sets")
            more["batch"] = measure_batch(repetitions=repetitions)
    echo(str(found))
    if beside is not None:
        echo(f"\n{beside}")
    for one in more.values():
        echo(f"\n{one}")
    if json is not None:
        told = {name: one.to_dict() for name, one in more.items()}
        if beside is not None:
            told["alternatives"] = beside.to_dict()
        outputs.write_json(json, {**found.to_dict(), **told}, overwrite=overwrite)
    if picture is not None and beside is not None:
        outputs.write_picture(picture, lambda: work_precision(beside), overwrite=overwrite)
