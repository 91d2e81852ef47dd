"""``piezo-opt track``: displacement from a video."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Argument, Option, echo
from piezo_opt.cli.limiting import limit_of
from piezo_opt.cli.telling import telling
from piezo_opt.errors import InputError
from piezo_opt.units import quantity


def track(
    video: Annotated[Path, Argument(help="Video file.")],
    scale: Annotated[
        str, Option(metavar="'0.1725 um/px'", help="Length of a pixel.")
    ],
    reference: Annotated[
        str,
        Option(
            metavar="X,Y", help="Point that stands still, pixels from top left."
        ),
    ],
    box: Annotated[
        str | None,
        Option(
            metavar="X,Y,W,H", help="The feature in the first frame [px]; chosen unless given."
        ),
    ] = None,
    search: Annotated[
        float | None,
        Option(
            min=1.0, metavar="PX", help="How far from its box the feature may be; anywhere unless "
            "given.",
        ),
    ] = None,
    rate: Annotated[
        str | None,
        Option(metavar="'1 kHz'", help="Of the camera, where the file's times are not true."),
    ] = None,
    whole_pixels: Annotated[
        bool, Option("--whole-pixels", help="Round places to pixels, to see what that costs.")
    ] = False,
    sure: Annotated[
        float,
        Option(
            metavar="PX", help="Leave out frames whose sigma is larger; a quarter pixel at most."
        ),
    ] = 0.25,
    drive: Annotated[
        Path | None,
        Option(metavar="FILE", help="Time and voltage of the drive: makes a whole record."),
    ] = None,
    delay: Annotated[
        str, Option(metavar="'0 s'", help="When, in the video, the drive's clock began.")
    ] = "0 s",
    between: o.BetweenSamples = None,
    out: Annotated[
        Path | None, Option(metavar="OUT.csv|.h5", help="The displacement, or the record.")
    ] = None,
    picture: Annotated[
        Path | None, Option(metavar="OUT.png", help="First frame with what was followed.")
    ] = None,
    json: o.Json = None,
    max_time: o.MaxTime = None,
    overwrite: o.Overwrite = False,
) -> None:  # fmt: skip
    """Follow a feature of a video: its distance from a point, frame by frame, with its sigma.

    Needs the extra 'video'. Frames that could be wrong by half a pixel are left out.

    \b
    Examples:
      piezo-opt track tip.avi --scale 0.1725um/px --reference 12,80 --picture tip.png
      piezo-opt track tip.mp4 --scale 0.1725um/px --reference 12,80 --box 60,64,40,40 \\
          --drive volts.csv --out record.csv
    """
    outputs.check(
        {"--out": out, "--picture": picture, "--json": json},
        overwrite=overwrite,
        inputs=(video, drive),
    )
    if out is not None and out.suffix.lower() not in (".csv", ".h5", ".hdf5"):
        raise InputError(f"--out {out}: a track is written as .csv, .h5 or .hdf5: choose one")
    from piezo_opt.readers import read_drive, write
    from piezo_opt.video import track as followed

    volts = None if drive is None else read_drive(drive, between=between)
    begun = quantity(delay, "s")
    limit = limit_of(max_time).seconds
    with telling("Track") as tell:
        found = followed(
            video, scale=scale, reference=reference, box=box, search=search, rate=rate,
            whole_pixels=whole_pixels, sure=sure, max_time=limit, progress=tell,
        )  # fmt: skip
    record = None if volts is None else found.record(volts, begun)
    echo(str(found))
    if record is not None:
        echo(repr(record))
    if out is not None and record is not None:
        write(record, out, overwrite=overwrite)
    elif out is not None:
        found.write(out, overwrite=overwrite)
    if picture is not None:
        from piezo_opt.report.video import overlay

        outputs.write_picture(picture, lambda: overlay(found), overwrite=overwrite)
    if json is not None:
        outputs.write_json(json, found.to_dict(), overwrite=overwrite)
