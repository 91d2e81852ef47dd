"""``piezo-opt bench``: the package's own claims, measured."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.bench_advice import advice
from piezo_opt.cli.bench_control import control
from piezo_opt.cli.bench_faults import faults
from piezo_opt.cli.bench_optimisers import optimisers
from piezo_opt.cli.bench_speed import speed
from piezo_opt.cli.bench_spiked import spiked
from piezo_opt.cli.bench_video import video
from piezo_opt.cli.declare import Commands, Option, echo
from piezo_opt.cli.limiting import limit_of, limited
from piezo_opt.cli.solving import pool
from piezo_opt.cli.telling import telling

bench = Commands("bench", "Measure what the package claims.")


class Size(Enum):
    """Sizes of hidden effects."""

    STANDARD = "standard"
    HARD = "hard"


class Plants(Enum):
    """Families of plants."""

    OWN = "own"
    FOREIGN = "foreign"


bench.command()(control)
bench.command()(advice)
bench.command()(faults)
bench.command()(optimisers)
bench.command()(speed)
bench.command()(spiked)
bench.command()(video)


@bench.command()
def hidden(
    classes: Annotated[
        str | None,
        Option(
            metavar="A,B+C",
            help="Classes of hidden effects, 'none', 'two', or pairs; all unless given.",
        ),
    ] = None,
    seeds: Annotated[int, Option(min=1, metavar="N", help="Records of each class.")] = 20,
    first_seed: Annotated[int, Option(min=0, metavar="N", help="Where seeds begin.")] = 0,
    level: Annotated[
        Size, Option(help="Effects of 3 to 30 times the noise, or of 0.7 to 3.")
    ] = Size.STANDARD,
    samples: Annotated[int, Option(min=500, metavar="N", help="Samples of each record.")] = 8000,
    workers: Annotated[
        int, Option(min=1, metavar="N", help="Processes that share the records.")
    ] = 1,
    json: o.Json = None,
    log: Annotated[
        Path | None,
        Option(metavar="FILE.jsonl", help="Keeps finished records; a second run goes on from it."),
    ] = None,
    family: Annotated[
        Plants | None,
        Option(help="Whose plants: the first family, or one by another hand."),
    ] = None,
    blind: Annotated[
        bool,
        Option("--blind", help="Only totals, of foreign plants unless told otherwise."),
    ] = False,
    baseline: Annotated[
        bool,
        Option("--baseline", help="Also refit with every effect and take the best: slow."),
    ] = False,
    leave_out: Annotated[
        bool,
        Option("--leave-out", help="Diagnose with a catalogue that lacks what is hidden."),
    ] = False,
    max_time: o.MaxTime = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Hide effects in plants that share no code with the package, and see what is named.

    Ctrl-C and --max-time give the table of what was done, and write it where it was asked for.

    \b
    Examples:
      piezo-opt bench hidden --seeds 2
      piezo-opt bench hidden --classes none,creep,two --workers 2 --json hidden.json
      piezo-opt bench hidden --level hard --workers 2 --log hard.jsonl
      piezo-opt bench hidden --blind --seeds 5 --workers 2 --json totals.json
      piezo-opt bench hidden --leave-out --seeds 1 --samples 4000 --workers 2
    """
    from piezo_opt.benchmark.hidden import hidden_bench

    outputs.check({"--json": json, "--log": log}, overwrite=overwrite, grows=frozenset({"--log"}))
    limit = limit_of(max_time)
    asked = None if classes is None else [one.strip() for one in classes.split(",")]
    chosen = family or (Plants.FOREIGN if blind else Plants.OWN)
    with pool(workers) as executor, telling("Bench") as tell, limited(limit):
        found = hidden_bench(
            asked,
            seeds,
            level.value,
            first_seed=first_seed,
            samples=samples,
            executor=executor,
            progress=lambda done, of: tell(f"{done} of {of} records (Ctrl-C prints those)"),
            log=log,
            family=chosen.value,
            blind=blind,
            baseline=baseline,
            leave_out=leave_out,
        )
    echo(str(found))
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)


@bench.command()
def linear_coverage(
    seeds: Annotated[int, Option(min=1, metavar="N", help="Records.")] = 200,
) -> None:
    """How often the 95 % intervals of a black-box linear fit hold the truth.

    \b
    Example:
      piezo-opt bench linear-coverage
    """
    from piezo_opt.benchmark.linear_coverage import linear_coverage as measured

    for name, share in measured(seeds).items():
        echo(f"{name:<22}{100.0 * share:.1f} % of {seeds}")


@bench.command()
def linear_peers() -> None:
    """Black-box linear models against SIPPY and nfoursid, which must be installed.

    \b
    Example:
      piezo-opt bench linear-peers
    """
    from piezo_opt.benchmark.linear_peers import linear_peers as measured

    echo(str(measured()))
