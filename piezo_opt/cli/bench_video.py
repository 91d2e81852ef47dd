"""``piezo-opt bench video``: places in films whose answer is known."""

from __future__ import annotations

from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.limiting import limit_of
from piezo_opt.cli.telling import telling


def video(
    frames: Annotated[
        int, Option(min=50, metavar="N", help="Frames in which the tip jumps anywhere.")
    ] = 1000,
    seeds: Annotated[int, Option(min=1, metavar="N", help="Films of each motion.")] = 2,
    seed: o.Seed = 0,
    max_time: o.MaxTime = None,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Track rendered films: errors and their sigma for each codec, and jumps that mislead.

    Ctrl-C and --max-time give what was done.

    \b
    Example:
      piezo-opt bench video --seeds 1 --frames 200
    """
    from dataclasses import asdict

    from piezo_opt.benchmark.tracking import KINDS, Row, calibration, jumps

    outputs.check({"--json": json}, overwrite=overwrite)
    rows: list[Row] = []
    leaps = None
    limit = limit_of(max_time)
    try:
        with telling("Films") as tell, limit:
            leaps = jumps(frames, seed=seed, progress=tell)
            for kind in KINDS:
                rows += calibration((kind,), seeds=seeds, first_seed=seed, progress=tell)
    except KeyboardInterrupt:
        echo("Ended early.", err=True)
    if leaps is not None:
        echo(str(leaps))
    if rows:
        echo(
            f"\n{'film':<42}{'frames':>7}{'valid':>8}{'rms':>9}{'largest':>9}{'in 2 sigma':>12}"
            f"{'locking':>9}"
        )
    for row in rows:
        echo(
            f"{row.kind:<42}{row.frames:>7}{100 * row.valid:>6.1f} %{row.rms:>9.4f}"
            f"{row.worst:>9.3f}{100 * row.inside:>10.1f} %{row.locking:>9.4f}"
        )
    if json is not None:
        outputs.write_json(
            json,
            {
                "schema": "piezo_opt/bench-video/1",
                "jumps": None if leaps is None else asdict(leaps),
                "films": [asdict(row) for row in rows],
            },
            overwrite=overwrite,
        )
