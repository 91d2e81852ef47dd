"""Options that several commands share, declared once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

from piezo_opt.cli.choices import IntervalsName, SolverName, TranscriptionName
from piezo_opt.cli.declare import Argument, Option
from piezo_opt.identification import Start
from piezo_opt.measurement import Between

Records: TypeAlias = Annotated[
    list[Path],
    Argument(help="Record files: text, .h5, .nc, .mat, .lvm, .tdms or .parquet."),
]
Record: TypeAlias = Annotated[
    Path,
    Argument(help="Record file: text, .h5, .nc, .mat, .lvm, .tdms or .parquet."),
]
ModelPath: TypeAlias = Annotated[
    str,
    Option(
        "--model",
        metavar="MODEL.toml",
        help="Model file, JSON of an earlier fit, or 'default': hysteresis, and mechanics where "
        "the record shows a resonance.",
    ),
]
Time: TypeAlias = Annotated[str | None, Option(metavar="COL", help="Column of time: 't', '1 [s]'.")]
Drive: TypeAlias = Annotated[
    str | None,
    Option(metavar="COL", help="Column of the drive: 'u', 'u [V]', '2 [V]'."),
]
Position: TypeAlias = Annotated[
    str | None,
    Option(metavar="COL", help="Column of the position: 'y', 'y [um]', '3 [um]'."),
]
RecordName: TypeAlias = Annotated[
    str | None,
    Option(
        "--record",
        metavar="NAME",
        help="Which of several records in a file: its name or number, or 'all'.",
    ),
]
BetweenSamples: TypeAlias = Annotated[
    Between | None,
    Option(help="How the drive moves between samples; by default as the file or the record says."),
]
Period: TypeAlias = Annotated[
    str | None, Option(metavar="'0.2 s'", help="Period of a steady state that repeats.")
]
Startup: TypeAlias = Annotated[
    str | None,
    Option(metavar="'40 ms'", help="Time at the beginning in which errors do not count."),
]
Rate: TypeAlias = Annotated[
    str | None,
    Option(
        metavar="'1 kHz'",
        help="Sampling rate, where the clock is missing or wrong, or 'even'.",
    ),
]
Trim: TypeAlias = Annotated[
    str | None, Option(metavar="'2 s:8 s'", help="Keep this stretch; an end may be left out.")
]
Every: TypeAlias = Annotated[
    int, Option(min=1, metavar="N", help="Keep every N-th sample, after a low-pass filter.")
]
Gain: TypeAlias = Annotated[
    str | None,
    Option(metavar="15", help="Gain of the amplifier, if the drive was recorded before it."),
]
Scale: TypeAlias = Annotated[
    str | None,
    Option(metavar="'2.5 um/V'", help="Scale of the sensor, if its reading is in volts."),
]
Decimal: TypeAlias = Annotated[
    str | None, Option(metavar="','", help="Sign of decimals in a text file: ',' or '.'.")
]
Accept: TypeAlias = Annotated[
    list[str] | None,
    Option(
        metavar="NAME",
        help="Take the record as it is in spite of this finding of the check; repeatable.",
    ),
]
Mend: TypeAlias = Annotated[
    list[str] | None,
    Option(metavar="NAME", help="Apply the remedy for this finding of the check; repeatable."),
]
Split: TypeAlias = Annotated[
    str | None,
    Option(metavar="'40 s'", help="Fit before this instant, test after it."),
]
StartState: TypeAlias = Annotated[
    Start | None,
    Option(
        help="What was before the record: 'free' estimates it, 'rest' is nothing, 'periodic' the "
        "same again. By default free, and periodic with --period."
    ),
]
Solver: TypeAlias = Annotated[
    SolverName | None,
    Option(help="Optimiser; by default the one that suits --transcription."),
]
Transcription: TypeAlias = Annotated[
    TranscriptionName,
    Option(
        help="How a fit is computed: 'single' simulates a record in one run, the others in pieces."
    ),
]
Starts: TypeAlias = Annotated[
    int,
    Option(
        min=1, metavar="N", help="Number of starting points; the first is found from the record."
    ),
]
Seed: TypeAlias = Annotated[int, Option(min=0, help="Seed of the random starting points.")]
Log: TypeAlias = Annotated[
    Path | None,
    Option(
        metavar="FILE.h5",
        help="Keeps what is finished (intervals in FILE.intervals.h5): a second run goes on there.",
    ),
]
Workers: TypeAlias = Annotated[
    int, Option(min=1, metavar="N", help="Processes that share the starts.")
]
Intervals: TypeAlias = Annotated[
    IntervalsName | None,
    Option(help="Further intervals of the values, by many fits."),
]
Replicates: TypeAlias = Annotated[
    int, Option(min=20, metavar="N", help="Number of fits of a bootstrap.")
]
MaxTime: TypeAlias = Annotated[
    str | None,
    Option(
        metavar="'60 s'", help="Stop after this time with the best so far. No limit by default."
    ),
]
Json: TypeAlias = Annotated[
    Path | None, Option("--json", metavar="OUT.json", help="Write the result in SI units.")
]
Page: TypeAlias = Annotated[
    Path | None, Option("--report", metavar="OUT.html", help="Write a page with pictures.")
]
Overwrite: TypeAlias = Annotated[bool, Option("--overwrite", help="Replace existing files.")]
Quiet: TypeAlias = Annotated[bool, Option("--quiet", "-q", help="Print the outcome only.")]
