"""``piezo-opt signal best`` and ``signal between``: drives found for a question."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias, final

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.checking import UNANSWERED, Checking
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import AS_WRITTEN, DEFAULT, Reading, asked
from piezo_opt.cli.limiting import leave_early, limit_of, limited
from piezo_opt.cli.signal import Out, Picture, Seed, save_preview, signal
from piezo_opt.cli.solving import Solving, exit_code, leave
from piezo_opt.cli.telling import telling
from piezo_opt.errors import InputError
from piezo_opt.units import quantity

if TYPE_CHECKING:
    from piezo_opt.identification import Fit
    from piezo_opt.measurement import Campaign
    from piezo_opt.signals import BestDrive
    from piezo_opt.signals.between import DriveBetween
    from piezo_opt.stopping import TimeLimit

__all__ = ["signal"]

Noise: TypeAlias = Annotated[
    str | None,
    Option(metavar="'20 nm'", help="Noise of the reading; by default what the fit left."),
]
Slewing: TypeAlias = Annotated[
    str | None, Option(metavar="'500 V/s'", help="Fastest change of the drive.")
]
Lasting: TypeAlias = Annotated[
    str | None, Option(metavar="'4 s'", help="Length; by default that of the record.")
]
Fastest: TypeAlias = Annotated[
    str | None,
    Option(metavar="'200 Hz'", help="Fastest sine; by default a fifth of the rate."),
]
Judged: TypeAlias = Annotated[int, Option(min=1, metavar="N", help="Drives judged in each family.")]


@final
@dataclass(frozen=True)
class Room:
    """What the next drive may be, and how long is looked for it."""

    noise: Noise = None
    slew: Slewing = None
    duration: Lasting = None
    highest: Fastest = None
    evaluations: Judged = 250
    seed: Seed = 0
    max_time: o.MaxTime = None

    def said(self) -> dict[str, Any]:
        """The same as the search takes it."""
        return {
            "noise": None if self.noise is None else quantity(self.noise, "m"),
            "slew": float("inf") if self.slew is None else quantity(self.slew, "V/s"),
            "duration": None if self.duration is None else quantity(self.duration, "s"),
            "highest": 0.0 if self.highest is None else quantity(self.highest, "Hz"),
            "evaluations": self.evaluations,
            "seed": self.seed,
        }


@final
@dataclass(frozen=True)
class Found:
    """Where the drive goes."""

    out: Out = None
    picture: Picture = None
    json: o.Json = None
    overwrite: o.Overwrite = False

    def check(self, *inputs: str | Path) -> None:
        """Refuse outputs that would destroy something, before any work."""
        outputs.check(
            {"--out": self.out, "--picture": self.picture, "--json": self.json},
            overwrite=self.overwrite,
            inputs=inputs,
        )

    def deliver(self, told: BestDrive | DriveBetween) -> None:
        """Say it, and write what was asked for."""
        echo(str(told))
        if self.json is not None:
            outputs.write_json(self.json, told.to_dict(), overwrite=self.overwrite)
        if self.out is not None:
            told.drive.write(self.out, overwrite=self.overwrite)
        if self.picture is not None:
            save_preview(told.drive, self.picture, overwrite=self.overwrite)


USUAL_ROOM: Final = Room()
NOWHERE: Final = Found()


@signal.command()
@grouped
def best(
    records: o.Records, model: o.ModelPath = DEFAULT,
    of: Annotated[
        str | None,
        Option("--for", metavar="A,B", help="Parameters to learn; by default all free ones."),
    ] = None,
    together: Annotated[
        bool,
        Option(
            "--together", help="Make the determinant of their covariance small (D-optimal), not "
            "the deviation of each.",
        ),
    ] = False,
    room: Room = USUAL_ROOM, found: Found = NOWHERE, reading: Reading = AS_WRITTEN,
    checking: Checking = UNANSWERED,
) -> None:  # fmt: skip
    """Fit a model, and find the drive from which its parameters would be learnt best.

    Ctrl-C and --max-time give the best drive so far.

    \b
    Example:
      piezo-opt signal best loop.csv --for bouc_wen.beta,bouc_wen.gamma --out next.csv
    """
    from piezo_opt.signals import Criterion, best_for

    found.check(*records, model)
    said, limit = room.said(), limit_of(room.max_time)
    fit = _fitted(checking.records(reading.records(records)), model, limit)
    with telling("Drives") as tell, limited(limit):
        told = best_for(
            fit, None if of is None else [name.strip() for name in of.split(",")],
            criterion=Criterion.DETERMINANT if together else Criterion.DEVIATIONS,
            progress=tell, **said,
        )  # fmt: skip
    found.deliver(told)
    leave_early(told.interrupted, limit)


@signal.command()
@grouped
def between(
    records: o.Records,
    model: Annotated[
        list[str], Option("--model", metavar="MODEL.toml", help="One of them; give several.")
    ],
    room: Room = USUAL_ROOM, found: Found = NOWHERE, reading: Reading = AS_WRITTEN,
    checking: Checking = UNANSWERED,
) -> None:  # fmt: skip
    """Fit several models to the same records, and find the drive that tells them apart.

    Ctrl-C and --max-time give the best drive so far.

    \b
    Example:
      piezo-opt signal between loop.csv --model lag.toml --model delay.toml --out next.csv
    """
    from piezo_opt.signals import best_between

    found.check(*records, *model)
    if len({Path(one).stem for one in model}) < 2:
        raise InputError("--model: give two model files with different names")
    said, limit = room.said(), limit_of(room.max_time)
    taken = checking.records(reading.records(records))
    fits = {Path(one).stem: _fitted(taken, one, limit) for one in model}
    with telling("Drives") as tell, limited(limit):
        told = best_between(fits, progress=tell, **said)
    found.deliver(told)
    leave_early(told.interrupted, limit)


def _fitted(records: Campaign, model: str, limit: TimeLimit) -> Fit:
    """The model on the records; a fit that was interrupted is told, and no drive is looked for."""
    question, remarks = asked(model, records, None)
    fit = Solving().fit(question, remarks, f"Fit of {model}", limit)
    if exit_code(fit):
        echo(str(fit))
    leave(fit)
    return fit
