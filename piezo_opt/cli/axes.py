"""``piezo-opt axes``: stages with several drives and positions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Argument, Commands, Option, echo
from piezo_opt.cli.limiting import leave_early, limit_of, limited
from piezo_opt.cli.linear import number_range
from piezo_opt.cli.telling import telling

axes = Commands("axes", "Identify and simulate stages with several drives and positions.")

Files: TypeAlias = Annotated[
    list[Path],
    Argument(
        help="Records: .h5 with voltage and displacement, u_NAME.npy beside y_NAME.npy, tables, or "
        "folders of these."
    ),
]
Sampling: TypeAlias = Annotated[
    str | None, Option("--rate", metavar="'6400 Hz'", help="Sampling rate of arrays.")
]
Repeats: TypeAlias = Annotated[
    str | None, Option("--period", metavar="'1.28 s'", help="Period of tables.")
]


@axes.command()
def response(
    files: Files,
    rate: Sampling = None,
    period: Repeats = None,
    json: o.Json = None,
    report: o.Page = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Matrix of frequency responses with noise and distortion, for every amplitude.

    \b
    Examples:
      piezo-opt axes response data/cubespec-fsm/train.h5 --report response.html
      piezo-opt axes response folder --rate "6400 Hz" --json response.json
    """
    outputs.check({"--json": json, "--report": report}, overwrite=overwrite, inputs=files)
    from piezo_opt.linear_models import response_matrix
    from piezo_opt.readers import read_axes

    found = [response_matrix(one) for one in read_axes(*files, rate=rate, period=period).levels]
    echo("\n\n".join(map(str, found)))
    if json is not None:
        told = {"schema": "piezo_opt.axes_response/1", "levels": [one.to_dict() for one in found]}
        outputs.write_json(json, told, overwrite=overwrite)
    if report is not None:
        outputs.write_page(report, *found, title="Frequency responses", overwrite=overwrite)


@axes.command()
def fit(
    files: Files,
    modes: Annotated[
        str | None,
        Option(metavar="N|N-M", help="Number of modes, or a range; by default 2 to 24."),
    ] = None,
    real: Annotated[
        int, Option(min=0, metavar="N", help="Real poles, for creep and amplifier.")
    ] = 2,
    held_out: Annotated[
        int,
        Option(
            min=0, metavar="N", help="Realisations of every amplitude that only judge; 0 for none."
        ),
    ] = 2,
    compare: Annotated[bool, Option(help="Fit and judge linear models beside it.")] = True,
    rate: Sampling = None,
    period: Repeats = None,
    json: o.Json = None,
    report: o.Page = None,
    max_time: o.MaxTime = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Fit one modal model to all axes and amplitudes, and tell its error on held-out records.

    The model that is written is fitted to all realisations; the errors are those of models that
    have not seen the held-out ones. Ctrl-C and --max-time give the best so far; the exit code is
    130 after Ctrl-C.

    \b
    Examples:
      piezo-opt axes fit data/cubespec-fsm/train.h5 --json mirror.json --report mirror.html
      piezo-opt axes fit u_100mV.npy u_300mV.npy --rate "6400 Hz" --modes 18
    """
    outputs.check({"--json": json, "--report": report}, overwrite=overwrite, inputs=files)
    counts = range(2, 26, 2) if modes is None else number_range("--modes", modes)
    limit = limit_of(max_time)
    from piezo_opt.linear_models import identify_axes
    from piezo_opt.readers import read_axes

    with limited(limit), telling("Axes") as tell:
        found = identify_axes(
            read_axes(*files, rate=rate, period=period),
            counts[0] if len(counts) == 1 else list(counts),
            real=real, held_out=held_out, compare=compare, progress=tell,
        )  # fmt: skip
    echo(str(found))
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
    if report is not None:
        outputs.write_page(report, found, overwrite=overwrite)
    leave_early(found.interrupted, limit)


@axes.command()
def simulate(
    model: Annotated[Path, Argument(metavar="MODEL.json", help="What 'axes fit' wrote.")],
    files: Files,
    rate: Sampling = None,
    period: Repeats = None,
    out: Annotated[
        Path | None,
        Option(metavar="OUT.npz", help="Simulated positions [m] of every record, by name."),
    ] = None,
    json: o.Json = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Simulate the drives of records with a fitted model, and compare with their positions.

    The error of an axis is sqrt(mean e^2) / std(y) over each period, its mean over periods and
    realisations; 'mean' is that over the axes, 'total' all axes in one norm.

    \b
    Examples:
      piezo-opt axes simulate mirror.json data/cubespec-fsm/train.h5 --json error.json
      piezo-opt axes simulate mirror.json u_100mV_test.npy y_100mV_test.npy --rate "6400 Hz"
    """
    outputs.check({"--out": out, "--json": json}, overwrite=overwrite, inputs=(model, *files))
    from piezo_opt.linear_models import axes_error, read_axes_model
    from piezo_opt.readers import read_axes
    from piezo_opt.readers.axes import write_positions

    found, records = read_axes_model(model), read_axes(*files, rate=rate, period=period)
    error = axes_error(found, records)
    if out is not None:
        write_positions(
            out, {one.name: found.simulate(one) for one in records}, overwrite=overwrite
        )
    echo(str(error))
    if json is not None:
        outputs.write_json(json, error.to_dict(), overwrite=overwrite)
