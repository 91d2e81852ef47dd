"""What ``piezo-opt tune`` asks of every controller: groups of options, and their meaning."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Argument, Commands, Option, echo
from piezo_opt.cli.inputs import Reading
from piezo_opt.errors import InputError
from piezo_opt.units import quantity, show
from piezo_opt.values import Values

if TYPE_CHECKING:
    from piezo_opt.control import Identified, Limits
    from piezo_opt.control.reach import Reach

FloatArray = NDArray[np.float64]

tune = Commands("tune", "Design a controller on a fitted actuator, and say what to expect of it.")

REACHED = 0.7
"""Of what the drive reaches: the default reference leaves room for a controller to act."""
SAMPLES = 200
"""Of one period of the default reference."""


Actuator: TypeAlias = Annotated[
    Path,
    Argument(
        metavar="FIT.json", help="JSON of a fit or diagnosis, a saved fit (.h5), or a model file."
    ),
]  # fmt: skip


class Shape(Enum):
    """What is followed."""

    TRIANGLE, SINE, STEP, SQUARE = "triangle", "sine", "step", "square"


@final
@dataclass(frozen=True)
class Reference:
    """What the actuator is to follow."""

    shape: Annotated[Shape, Option(help="Shape of the reference.")] = Shape.TRIANGLE
    low: Annotated[
        str | None,
        Option(
            metavar="'0 um'",
            help="Lower end of the reference; by default the lowest that is reached again.",
        ),
    ] = None
    high: Annotated[
        str | None,
        Option(
            metavar="'6 um'",
            help="Upper end of the reference; by default 70 % of what the drive reaches.",
        ),
    ] = None
    frequency: Annotated[
        str | None,
        Option(
            metavar="'10 Hz'",
            help="Frequency of the reference; by default a period has 200 samples.",
        ),
    ] = None
    periods: Annotated[int, Option(min=1, metavar="N", help="Periods of the reference.")] = 3
    reference: Annotated[
        Path | None,
        Option(metavar="RECORD", help="A record whose position is followed instead."),
    ] = None

    def values(self, period: float, reach: Reach) -> tuple[FloatArray, str]:
        """(N,) positions [m], one a period, and what they are.

        Args:
            period: [s].
            reach: of the actuator.

        Raises:
            InputError: ends that are none, or a period shorter than four samples.
        """
        if self.reference is not None:
            record = Reading().single(self.reference)
            since = record.time - record.time[0]
            time = np.arange(0.0, float(since[-1]), period)
            if time.size < 2:
                raise InputError(
                    f"--reference {self.reference}: lasts {show(float(since[-1]), 's')}, and the "
                    f"loop is sampled every {show(period, 's')}: sample faster (--period)"
                )
            values = reach.rest + np.interp(time, since, record.position - record.position[0])
            return values, f"the position of {record.name}, from rest, {time.size} samples"
        low = reach.again if self.low is None else quantity(self.low, "m")
        high = low + REACHED * (reach.top - low)
        if self.high is not None:
            high = quantity(self.high, "m")
        hertz = 1.0 / (SAMPLES * period)
        if self.frequency is not None:
            hertz = quantity(self.frequency, "Hz")
        if not np.isfinite(high) or not low < high:
            raise InputError(
                f"--low {show(low, 'm')}, --high {show(high, 'm')}: the lower end comes first"
            )
        if not 0.0 < hertz <= 0.25 / period:
            raise InputError(
                f"--frequency {self.frequency}: a period takes four samples of "
                f"{show(period, 's')} at least: sample faster (--period) or ask for less"
            )
        count = int(np.ceil(self.periods / (hertz * period))) + 1
        phase: FloatArray = np.asarray((hertz * period * np.arange(count)) % 1.0, dtype=float)
        told = f"a {self.shape.value} of {show(low, 'm')} to {show(high, 'm')}"
        if self.shape is not Shape.STEP:
            told += f" at {show(hertz, 'Hz')}"
        return np.asarray(
            low + (high - low) * _drawn(self.shape, phase)
        ), f"{told}, {count} samples"


def _drawn(shape: Shape, phase: FloatArray) -> FloatArray:
    """(N,) from 0 to 1, at phases of a period."""
    if shape is Shape.TRIANGLE:
        return np.asarray(1.0 - np.abs(2.0 * phase - 1.0))
    if shape is Shape.SINE:
        return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * phase))
    if shape is Shape.SQUARE:
        return np.where(phase >= 0.5, 1.0, 0.0)
    return np.where(np.arange(phase.size) >= phase.size // 10, 1.0, 0.0)


@final
@dataclass(frozen=True)
class Loop:
    """How the loop is sampled, and what limits it."""

    period: Annotated[
        str | None,
        Option(metavar="'1 ms'", help="Sampling period; by default that of the record."),
    ] = None
    range: Annotated[
        tuple[str, str] | None,
        Option(metavar="LOW HIGH", help="Range of the drive; by default that of the record."),
    ] = None
    slew: Annotated[str | None, Option(metavar="'5 kV/s'", help="Fastest change of the drive.")] = (
        None
    )
    delay: Annotated[
        int, Option(min=0, metavar="N", help="Whole periods that computing takes.")
    ] = 0
    noise: Annotated[
        str | None,
        Option(metavar="'5 nm'", help="Noise of the sensor; by default what the fit left."),
    ] = None
    scenarios: Annotated[
        int,
        Option(min=0, metavar="N", help="Actuators drawn from the fit's covariance to design on."),
    ] = 0
    seed: Annotated[int, Option(min=0, help="Seed of the draws and of the noise.")] = 0

    def limits(self, actuator: Identified) -> Limits:
        """Of the drive: as given, or the range of the record, rest included."""
        from piezo_opt.control import Limits

        ends = actuator.drive and (min(0.0, actuator.drive[0]), max(0.0, actuator.drive[1]))
        if self.range is not None:
            ends = quantity(self.range[0], "V"), quantity(self.range[1], "V")
        if ends is None:
            raise InputError("--range: the drive's range is not known: give it, '0 V' '100 V'")
        slew = float("inf") if self.slew is None else quantity(self.slew, "V/s")
        return Limits(*ends, slew)

    def noise_of(self, actuator: Identified) -> float:
        """Of the sensor [m]."""
        if self.noise is not None:
            return quantity(self.noise, "m")
        return actuator.noise or 0.0


@final
@dataclass(frozen=True)
class Result:
    """Where the answer goes, and when it is due."""

    json: o.Json = None
    picture: Annotated[
        Path | None, Option(metavar="OUT.png", help="The design as a picture: .png or .svg.")
    ] = None
    max_time: o.MaxTime = None
    overwrite: o.Overwrite = False

    def check(self, *inputs: Path | None) -> None:
        """Refuse outputs that would destroy something, before any work."""
        outputs.check(
            {"--json": self.json, "--picture": self.picture}, overwrite=self.overwrite,
            inputs=inputs,
        )  # fmt: skip

    def deliver(self, told: str, data: Mapping[str, Any], draw: Callable[[], Any]) -> None:
        """Say it, then write what was asked for; the picture, which may fail, comes last."""
        echo(told)
        if self.json is not None:
            outputs.write_json(self.json, data, overwrite=self.overwrite)
        if self.picture is not None:
            outputs.write_picture(self.picture, draw, overwrite=self.overwrite)


@final
@dataclass(frozen=True, eq=False)
class Asked:
    """A fit and what its loop is asked to do.

    Attributes:
        actuator: the fit.
        period: [s].
        limits: of the drive.
        noise: of the sensor [m].
        reference: (N,) [m]; ``told`` what it is.
    """

    actuator: Identified
    period: float
    limits: Limits
    noise: float
    reference: FloatArray
    told: str


def asked(fit: Path, reference: Reference, loop: Loop) -> Asked:
    """What the options ask for.

    Raises:
        InputError: the file holds no model, or what is asked makes no sense.
    """
    from piezo_opt.control import identified
    from piezo_opt.control.plant import without_delay
    from piezo_opt.control.reach import reach
    from piezo_opt.control.task import period_of

    actuator = identified(fit)
    period = period_of(actuator, loop.period)
    limits = loop.limits(actuator)
    model, _ = without_delay(actuator.model, actuator.numbers, period)
    own = {k: v for k, v in actuator.numbers.items() if k in model.parameters}
    found = reach(model, Values(own), limits, period)
    values, told = reference.values(period, found)
    return Asked(actuator, period, limits, loop.noise_of(actuator), values, told)


def described(what: Asked, fit: Path) -> dict[str, Any]:
    """What a JSON holds beside the design: the actuator, and what it was asked."""
    return {
        "plant": plant(what.actuator, fit),
        "reference": what.told,
        "noise": what.noise,
    }  # fmt: skip


def plant(actuator: Identified, fit: Path) -> dict[str, Any]:
    """The actuator of a design, as the JSON of a fit has it: a model file of its own."""
    names, values = actuator.names, {**actuator.values, **actuator.numbers}
    data: dict[str, Any] = {
        "source": fit.name,
        "model": actuator.model.to_dict(),
        "parameters": {n: {"value": v} for n, v in values.items()},
        "rms": actuator.noise,
    }
    if actuator.covariance is not None:
        std = np.sqrt(np.diag(actuator.covariance))
        with np.errstate(invalid="ignore", divide="ignore"):
            correlation = actuator.covariance / np.outer(std, std)
        spread = dict(zip(names, std.tolist(), strict=True))
        for name, entry in data["parameters"].items():
            entry.update({"estimated": name in spread, "std": spread.get(name)})
        data["correlation"] = {"names": list(names), "matrix": correlation.tolist()}
    if actuator.period is not None and actuator.drive is not None:
        data["sampling"] = [{"step": actuator.period, "drive": list(actuator.drive)}]
    return data
