"""``piezo-opt signal``: drives made by rule, as files, pictures and sketches."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias, final

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Commands, Option, echo
from piezo_opt.errors import InputError
from piezo_opt.readers import HOLD_SEVERAL
from piezo_opt.units import quantity

if TYPE_CHECKING:
    from piezo_opt.identification import Fit
    from piezo_opt.modelfile import ModelFile
    from piezo_opt.signals import Drive

signal = Commands("signal", "Make a drive to play, or find the best one for a question.")

Low: TypeAlias = Annotated[str, Option(metavar="'0 V'", help="Lowest drive.")]
High: TypeAlias = Annotated[str, Option(metavar="'100 V'", help="Highest drive.")]
Rate: TypeAlias = Annotated[str, Option(metavar="'1 kHz'", help="Samples a second.")]
Frequency: TypeAlias = Annotated[str, Option(metavar="'1 Hz'", help="Frequency of the signal.")]
Periods: TypeAlias = Annotated[int, Option(min=1, metavar="N", help="Number of periods.")]
Out: TypeAlias = Annotated[Path | None, Option(metavar="OUT.csv", help="Samples: .csv or .h5.")]
Slew: TypeAlias = Annotated[str | None, Option(metavar="'500 V/s'", help="Fastest change allowed.")]
Stroke: TypeAlias = Annotated[
    str | None,
    Option(metavar="'0 um..10 um'", help="Positions allowed, as --fit predicts them."),
]
FitFile: TypeAlias = Annotated[
    Path | None,
    Option("--fit", metavar="FIT.json", help="JSON of a fit, or a saved fit, for --stroke."),
]
Picture: TypeAlias = Annotated[
    Path | None, Option(metavar="OUT.png", help="The drive and its spectrum.")
]
Sketch: TypeAlias = Annotated[
    Path | None, Option("--arduino", metavar="OUT.ino", help="Sketch that plays it.")
]


class Board(Enum):
    """What an Arduino gives out."""

    DIGITAL, PWM, MCP4725 = "digital", "pwm", "mcp4725"


By: TypeAlias = Annotated[Board, Option("--output", help="What the board gives out.")]
Seed: TypeAlias = Annotated[int, Option(min=0, help="Seed of what is random.")]


@final
@dataclass(frozen=True)
class Delivery:
    """Where a drive goes, and within which limits."""

    out: Path | None
    picture: Path | None
    sketch: Path | None
    board: Board
    slew: str | None
    stroke: str | None
    fit: Path | None
    overwrite: bool

    def deliver(self, made: Callable[[], Drive]) -> None:
        """Make the drive, keep it to the limits, write what is asked for, say what it is."""
        outputs.check(
            {"--out": self.out, "--picture": self.picture, "--arduino": self.sketch},
            overwrite=self.overwrite,
            inputs=(self.fit,),
        )
        drive = self._limited(made())
        echo(f"{drive}, crest factor {drive.crest:.2f}")
        if self.out is not None:
            drive.write(self.out, overwrite=self.overwrite)
        if self.sketch is not None:
            from piezo_opt.signals import Output, write_arduino

            write_arduino(
                drive, self.sketch, output=Output(self.board.value), overwrite=self.overwrite
            )
        if self.picture is not None:
            save_preview(drive, self.picture, overwrite=self.overwrite)

    def _limited(self, drive: Drive) -> Drive:
        from piezo_opt.signals import DriveLimits, within

        shortest, longest = -float("inf"), float("inf")
        if self.stroke is not None:
            low, dots, high = self.stroke.partition("..")
            if not dots:
                raise InputError(f"--stroke {self.stroke}: give two positions, '0 um..10 um'")
            shortest, longest = quantity(low, "m"), quantity(high, "m")
        slew = float("inf") if self.slew is None else quantity(self.slew, f"{drive.unit}/s")
        limits = DriveLimits(slew=slew, shortest=shortest, longest=longest)
        return within(drive, limits, None if self.fit is None else _fit_of(self.fit))


def _fit_of(path: Path) -> Fit | ModelFile:
    """A saved fit, or the model of its JSON."""
    from piezo_opt.identification import load_fit
    from piezo_opt.modelfile import read_model

    return load_fit(path) if path.suffix.lower() in HOLD_SEVERAL else read_model(path)


def save_preview(drive: Drive, path: Path, *, overwrite: bool) -> None:
    """The drive and its spectrum as a picture."""
    from piezo_opt.report.signals import preview

    outputs.write_picture(path, lambda: preview(drive), overwrite=overwrite)


@signal.command()
def triangle(
    low: Low = "0 V", high: High = "100 V", frequency: Frequency = "1 Hz", rate: Rate = "1 kHz",
    periods: Periods = 1, out: Out = None, slew: Slew = None, stroke: Stroke = None,
    fit: FitFile = None, picture: Picture = None, arduino: Sketch = None,
    output: By = Board.MCP4725, overwrite: o.Overwrite = False,
) -> None:  # fmt: skip
    """Up and down: a loop at one speed.

    \b
    Example:
      piezo-opt signal triangle --high "125 V" --frequency "0.02 Hz" --rate "100 Hz" --out loop.csv
    """
    from piezo_opt import signals

    Delivery(out, picture, arduino, output, slew, stroke, fit, overwrite).deliver(
        lambda: signals.triangle(
            quantity(low, "V"), quantity(high, "V"), quantity(frequency, "Hz"),
            rate=quantity(rate, "Hz"), periods=periods,
        )
    )  # fmt: skip


@signal.command()
def square(
    low: Low = "0 V", high: High = "100 V", frequency: Frequency = "1 Hz", rate: Rate = "1 kHz",
    duty: Annotated[float, Option(help="Share of the period at high.")] = 0.5,
    periods: Periods = 1, out: Out = None, slew: Slew = None, stroke: Stroke = None,
    fit: FitFile = None, picture: Picture = None, arduino: Sketch = None,
    output: By = Board.DIGITAL, overwrite: o.Overwrite = False,
) -> None:  # fmt: skip
    """Steps between two levels: resonance, damping, creep.

    \b
    Example (the thesis' drive, on pin 9 of an Arduino):
      piezo-opt signal square --high "5 V" --frequency "1 Hz" --rate "100 Hz" --arduino square.ino
    """
    from piezo_opt import signals

    Delivery(out, picture, arduino, output, slew, stroke, fit, overwrite).deliver(
        lambda: signals.square(
            quantity(low, "V"), quantity(high, "V"), quantity(frequency, "Hz"),
            rate=quantity(rate, "Hz"), duty=duty, periods=periods,
        )
    )  # fmt: skip


@signal.command()
def staircase(
    levels: Annotated[
        str, Option(metavar="'0,50,100 V'", help="Levels and their unit.")
    ] = "0,50,100,25,75,0 V",
    hold: Annotated[str, Option(metavar="'1 s'", help="Time at each level.")] = "1 s",
    rate: Rate = "1 kHz", out: Out = None, slew: Slew = None, stroke: Stroke = None,
    fit: FitFile = None, picture: Picture = None, arduino: Sketch = None,
    output: By = Board.MCP4725, overwrite: o.Overwrite = False,
) -> None:  # fmt: skip
    """Levels, each held: creep, and steps of several sizes.

    \b
    Example:
      piezo-opt signal staircase --levels "0,100,50,0 V" --hold "5 s" --out stairs.csv
    """
    from piezo_opt import signals

    parts = [re.fullmatch(r"\s*([^\sa-zA-Z]+)\s*([a-zA-Z]*)\s*", p) for p in levels.split(",")]
    last = parts[-1]
    if last is None or not all(parts):
        raise InputError(f"--levels {levels}: give numbers and a unit, '0,50,100 V'")
    unit = last[2] or "V"
    volts = [quantity(f"{part[1]} {part[2] or unit}", "V") for part in parts if part]
    Delivery(out, picture, arduino, output, slew, stroke, fit, overwrite).deliver(
        lambda: signals.staircase(volts, quantity(hold, "s"), rate=quantity(rate, "Hz"))
    )


@signal.command()
def decaying(
    low: Low = "0 V", high: High = "100 V", frequency: Frequency = "1 Hz", rate: Rate = "1 kHz",
    count: Annotated[int, Option(min=1, metavar="N", help="Number of triangles.")] = 5,
    minor: Annotated[int, Option(min=0, metavar="N", help="Minor loops in each.")] = 1,
    hold: Annotated[str, Option(metavar="'0 s'", help="Time at each end.")] = "0 s",
    out: Out = None, slew: Slew = None, stroke: Stroke = None, fit: FitFile = None,
    picture: Picture = None, arduino: Sketch = None, output: By = Board.MCP4725,
    overwrite: o.Overwrite = False,
) -> None:  # fmt: skip
    """Triangles that fall, with minor loops: hysteresis of all sizes.

    \b
    Example:
      piezo-opt signal decaying --high "125 V" --count 8 --minor 2 --out minor.csv
    """
    from piezo_opt import signals

    Delivery(out, picture, arduino, output, slew, stroke, fit, overwrite).deliver(
        lambda: signals.decaying_triangles(
            quantity(low, "V"), quantity(high, "V"), quantity(frequency, "Hz"),
            rate=quantity(rate, "Hz"), count=count, minor=minor, hold=quantity(hold, "s"),
        )
    )  # fmt: skip


@signal.command()
def chirp(
    low: Low = "0 V", high: High = "100 V",
    start: Annotated[str, Option(metavar="'1 Hz'", help="First frequency.")] = "1 Hz",
    stop: Annotated[str, Option(metavar="'100 Hz'", help="Last frequency.")] = "100 Hz",
    duration: Annotated[str, Option(metavar="'10 s'", help="Length of the sweep.")] = "10 s",
    rate: Rate = "1 kHz",
    linear: Annotated[
        bool, Option("--linear", help="Sweep by equal steps, not by equal factors.")
    ] = False,
    out: Out = None, slew: Slew = None, stroke: Stroke = None, fit: FitFile = None,
    picture: Picture = None, arduino: Sketch = None, output: By = Board.MCP4725,
    overwrite: o.Overwrite = False,
) -> None:  # fmt: skip
    """A sine that sweeps over frequencies: resonances.

    \b
    Example:
      piezo-opt signal chirp --stop "400 Hz" --rate "2 kHz" --out sweep.csv
    """
    from piezo_opt import signals

    Delivery(out, picture, arduino, output, slew, stroke, fit, overwrite).deliver(
        lambda: signals.chirp(
            quantity(low, "V"), quantity(high, "V"), quantity(start, "Hz"), quantity(stop, "Hz"),
            quantity(duration, "s"), rate=quantity(rate, "Hz"), logarithmic=not linear,
        )
    )  # fmt: skip


class Which(Enum):
    """Harmonics of a multisine."""

    FULL, ODD, ODD_DETECTION, LOGARITHMIC = "full", "odd", "odd-detection", "logarithmic"


@signal.command()
def multisine(
    low: Low = "0 V", high: High = "100 V",
    lowest: Annotated[str, Option(metavar="'1 Hz'", help="First line.")] = "1 Hz",
    highest: Annotated[str, Option(metavar="'100 Hz'", help="Last line.")] = "100 Hz",
    period: Annotated[str, Option(metavar="'1 s'", help="Period of the signal.")] = "1 s",
    lines: Annotated[Which, Option(help="Which harmonics.")] = Which.FULL,
    schroeder: Annotated[
        bool, Option("--schroeder", help="Schroeder's phases, not random ones.")
    ] = False,
    seed: Seed = 0, rate: Rate = "1 kHz", periods: Periods = 1, out: Out = None,
    slew: Slew = None, stroke: Stroke = None, fit: FitFile = None, picture: Picture = None,
    arduino: Sketch = None, output: By = Board.MCP4725, overwrite: o.Overwrite = False,
) -> None:  # fmt: skip
    """Many sines at once: frequency responses, and distortion on lines left out.

    \b
    Example:
      piezo-opt signal multisine --lines odd-detection --periods 4 --seed 1 --out odd.csv
    """
    from piezo_opt import signals

    Delivery(out, picture, arduino, output, slew, stroke, fit, overwrite).deliver(
        lambda: signals.multisine(
            quantity(low, "V"), quantity(high, "V"), quantity(lowest, "Hz"),
            quantity(highest, "Hz"), quantity(period, "s"), rate=quantity(rate, "Hz"),
            lines=signals.Lines(lines.value),
            phases=signals.Phases.SCHROEDER if schroeder else signals.Phases.RANDOM,
            seed=seed, periods=periods,
        )
    )  # fmt: skip
