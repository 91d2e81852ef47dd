"""``piezo-opt export``: a fitted model leaves as code."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated, TypeAlias

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Argument, Commands, Option, echo
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import AS_WRITTEN, Reading
from piezo_opt.units import quantity

export = Commands("export", "Take a fitted model away as code that needs nothing of this package.")


Holder: TypeAlias = Annotated[
    Path,
    Argument(
        metavar="FIT.json", help="JSON of a fit, diagnosis or comparison, or a model file."
    ),
]  # fmt: skip
Out: TypeAlias = Annotated[Path, Option("--out", metavar="DIR", help="Folder to make.")]
Replayed: TypeAlias = Annotated[
    Path | None,
    Option(metavar="RECORD", help="Record for the check; best one that the fit has not seen."),
]
Step: TypeAlias = Annotated[
    str | None,
    Option(metavar="'1 ms'", help="Time between two calls; by default the record's."),
]
Name: TypeAlias = Annotated[
    str, Option(metavar="WORD", help="Prefix of every symbol, name of the files.")
]
Substeps: TypeAlias = Annotated[
    int | None,
    Option(min=1, metavar="N", help="Sub-steps of every call; by default chosen."),
]
Range: TypeAlias = Annotated[
    tuple[str, str] | None,
    Option(metavar="LOW HIGH", help="Range of the drive for a check without a record."),
]
Single: TypeAlias = Annotated[
    bool, Option("--float", help="Numbers of four bytes and nothing wider.")
]


def volts(pair: tuple[str, str] | None) -> tuple[float, float] | None:
    """A range of the drive in volts."""
    return None if pair is None else (quantity(pair[0], "V"), quantity(pair[1], "V"))


@export.command()
@grouped
def c(
    source: Holder,
    out: Out,
    single: Single = False,
    replay: Replayed = None,
    step: Step = None,
    name: Name = "actuator",
    substeps: Substeps = None,
    drive_range: Range = None,
    board: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="Run it on atmega328p or cortex-m4f as well, with --float."),
    ] = None,
    sensitivities: Annotated[
        bool,
        Option("--sensitivities", help="Also the derivatives of the reading by parameters."),
    ] = False,
    reading: Reading = AS_WRITTEN,
) -> None:
    """Write C99 that needs nothing but libm: a header, a source, a program to try it with.

    The code is compiled and replayed before the folder appears: it must read what the library
    reads, to rounding in double and to 1e-5 of the stroke in float.

    \b
    Examples:
      piezo-opt export c fit.json --out actuator --replay other.csv
      piezo-opt export c fit.json --out firmware --float --step "1 ms" --board cortex-m4f
    """
    from piezo_opt.export import export_c

    found = export_c(
        source,
        out,
        step=step,
        precision="float" if single else "double",
        replay=None if replay is None else reading.single(replay),
        name=name,
        substeps=substeps,
        drive=volts(drive_range),
        boards=tuple(board or ()),
        sensitivities=sensitivities,
    )
    echo(str(found))


class Signal(Enum):
    """What a sketch plays."""

    TRIANGLE = "triangle"
    SQUARE = "square"


@export.command()
def arduino(
    source: Holder,
    out: Out,
    signal: Annotated[Signal, Option(help="What is played.")] = Signal.TRIANGLE,
    low: Annotated[str | None, Option(metavar="'0 V'", help="Lower end: 0 unless given.")] = None,
    high: Annotated[
        str | None,
        Option(metavar="'125 V'", help="Upper end: 125 V, or 15 um with --inverse."),
    ] = None,
    period: Annotated[str, Option(metavar="'50 s'", help="Period of the signal.")] = "50 s",
    step: Annotated[str, Option(metavar="'50 ms'", help="Between two samples.")] = "50 ms",
    periods: Annotated[
        int, Option(min=0, metavar="N", help="Then the drive goes to zero; 0 for never.")
    ] = 0,
    full_scale: Annotated[
        str, Option(metavar="'150 V'", help="Drive at the pin's largest value.")
    ] = "150 V",
    pin: Annotated[int, Option(min=0, metavar="N", help="Pin of the signal.")] = 9,
    inverse: Annotated[
        bool, Option("--inverse", help="The signal is a position; the drive follows from it.")
    ] = False,
) -> None:
    """Write a sketch for an Arduino: a signal to the actuator, and its model beside it.

    By default the triangle of the thesis, 0 to 125 V and back in 50 s. With --inverse the drive is
    the one that brings the actuator to a position, without a sensor.

    \b
    Examples:
      piezo-opt export arduino fit.json --out triangle
      piezo-opt export arduino fit.json --out square --signal square --high "63 V" --period "1 s"
      piezo-opt export arduino fit.json --out follow --inverse --high "15 um"
    """
    from piezo_opt.export import export_arduino

    found = export_arduino(
        source,
        out,
        signal=signal.value,
        low=0.0 if low is None else low,
        high=high or ("15 um" if inverse else "125 V"),
        period=period,
        step=step,
        periods=periods,
        full_scale=full_scale,
        pin=pin,
        inverse=inverse,
    )
    echo(str(found))


class Version(Enum):
    """Of the FMI standard."""

    TWO = "2.0"
    THREE = "3.0"


@export.command()
def fmu(
    source: Holder,
    out: Annotated[Path, Option(metavar="OUT.fmu", help="File to write.")],
    version: Annotated[Version, Option(help="Version of the FMI standard.")] = Version.TWO,
    exchange: Annotated[
        bool, Option("--exchange", help="For model exchange in the place of co-simulation.")
    ] = False,
    step: Step = None,
    name: Name = "actuator",
    drive_range: Range = None,
    platforms: Annotated[
        str | None,
        Option(
            metavar="A,B", help="linux, windows, mac, linux-arm, mac-arm; by default this system."
        ),
    ] = None,
    overwrite: o.Overwrite = False,
) -> None:
    """Write a functional mock-up unit, for Simulink, OpenModelica and every other FMI tool.

    Between communication points the drive goes along a straight line. Other systems than this one
    take the extra that brings a compiler: pip install 'piezo_opt[cross]'.

    \b
    Examples:
      piezo-opt export fmu fit.json --out actuator.fmu --step "1 ms"
      piezo-opt export fmu fit.json --out actuator.fmu --step "1 ms" --platforms linux,windows
    """
    from piezo_opt.export import export_fmu

    outputs.check({"--out": out}, overwrite=overwrite, inputs=(source,))
    found = export_fmu(
        source,
        out,
        version=version.value,
        exchange=exchange,
        step=step,
        name=name,
        drive=volts(drive_range),
        platforms=tuple((platforms or "").replace(",", " ").split()),
        overwrite=overwrite,
    )
    echo(str(found))


@export.command()
def controller(
    source: Annotated[
        Path,
        Argument(
            metavar="TUNED.json",
            help="JSON of piezo-opt tune pid, lqr, mpc or shaper; of a fit, for its inverse.",
        ),
    ],
    out: Out,
    single: Single = False,
    period: Annotated[
        str | None,
        Option(metavar="'1 ms'", help="Sampling period; by default that of the design."),
    ] = None,
    limits: Annotated[
        tuple[str, str] | None,
        Option(metavar="LOW HIGH", help="Limits of the drive; by default those of the design."),
    ] = None,
    name: Name = "controller",
) -> None:
    """Write a controller as C99 that needs nothing but libm.

    It answers with a number within the limits whatever it is given; a member says what it met. The
    code is compiled and replayed against Python, faults included, before the folder appears.

    \b
    Examples:
      piezo-opt tune pid fit.json --json pid.json && piezo-opt export controller pid.json --out pid
      piezo-opt export controller lqr.json --out firmware --float
      piezo-opt export controller fit.json --out inverse --limits "0 V" "120 V"
    """
    from piezo_opt.control import Limits
    from piezo_opt.export import export_controller

    ends = volts(limits)
    found = export_controller(
        source, out, period=period, limits=None if ends is None else Limits(*ends),
        precision="float" if single else "double", name=name,
    )  # fmt: skip
    echo(str(found))
