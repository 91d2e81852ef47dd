"""``piezo-opt signal best`` and ``signal between``: drives found for a question."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.inputs import DEFAULT, Reading, asked
from piezo_opt.cli.signal import Out, Picture, Seed, save_preview, signal
from piezo_opt.errors import InputError
from piezo_opt.units import quantity

if TYPE_CHECKING:
    from piezo_opt.identification import Fit
    from piezo_opt.signals import Drive

__all__ = ["signal"]

Noise: TypeAlias = Annotated[
    str | None, Option(metavar="'20 nm'", help="Of the reading; the fit's residual else.")
]
Slewing: TypeAlias = Annotated[
    str | None, Option(metavar="'500 V/s'", help="Fastest change of the drive.")
]
Lasting: TypeAlias = Annotated[
    str | None, Option(metavar="'4 s'", help="Length; that of the record else.")
]
Fastest: TypeAlias = Annotated[
    str | None, Option(metavar="'200 Hz'", help="Fastest sine; a fifth of the rate else.")
]
Judged: TypeAlias = Annotated[int, Option(min=1, metavar="N", help="Drives judged in each family.")]


@signal.command()
def best(
    records: o.Records, model: o.ModelPath = DEFAULT,
    of: Annotated[
        str | None,
        Option("--for", metavar="A,B", help="Parameters meant; all that are free else."),
    ] = None,
    noise: Noise = None, slew: Slewing = None, duration: Lasting = None, highest: Fastest = None,
    evaluations: Judged = 250, seed: Seed = 0, out: Out = None, picture: Picture = None,
    json: o.Json = None, overwrite: o.Overwrite = False,
) -> None:  # fmt: skip
    """Fit a model, and find the drive from which its parameters would be learnt best.

    \b
    Example:
      piezo-opt signal best loop.csv --for bouc_wen.beta,bouc_wen.gamma --out next.csv
    """
    from piezo_opt.signals import best_for

    outputs.check({"--out": out, "--picture": picture, "--json": json}, overwrite=overwrite)
    told = best_for(
        _fitted(records, model),
        None if of is None else [name.strip() for name in of.split(",")],
        evaluations=evaluations, seed=seed, **_numbers(noise, slew, duration, highest),
    )  # fmt: skip
    _deliver(told.drive, out, picture, overwrite=overwrite)
    echo(str(told))
    if json is not None:
        outputs.write_json(json, told.to_dict(), overwrite=overwrite)


@signal.command()
def between(
    records: o.Records,
    model: Annotated[
        list[str], Option("--model", metavar="MODEL.toml", help="One of them; give several.")
    ],
    noise: Noise = None, slew: Slewing = None, duration: Lasting = None, highest: Fastest = None,
    evaluations: Judged = 250, seed: Seed = 0, out: Out = None, picture: Picture = None,
    json: o.Json = None, overwrite: o.Overwrite = False,
) -> None:  # fmt: skip
    """Fit several models to the same records, and find the drive that tells them apart.

    \b
    Example:
      piezo-opt signal between loop.csv --model lag.toml --model delay.toml --out next.csv
    """
    from piezo_opt.signals import best_between

    outputs.check({"--out": out, "--picture": picture, "--json": json}, overwrite=overwrite)
    if len({Path(one).stem for one in model}) < 2:
        raise InputError("--model: give two model files with different names")
    told = best_between(
        {Path(one).stem: _fitted(records, one) for one in model},
        evaluations=evaluations, seed=seed, **_numbers(noise, slew, duration, highest),
    )  # fmt: skip
    _deliver(told.drive, out, picture, overwrite=overwrite)
    echo(told.sentence)
    if json is not None:
        outputs.write_json(json, told.to_dict(), overwrite=overwrite)


def _fitted(records: list[Path], model: str) -> Fit:
    from piezo_opt.identification import solve

    question, _ = asked(model, Reading().records(records), None)
    return solve(question)


def _numbers(
    noise: str | None, slew: str | None, duration: str | None, highest: str | None
) -> dict[str, Any]:
    return {
        "noise": None if noise is None else quantity(noise, "m"),
        "slew": float("inf") if slew is None else quantity(slew, "V/s"),
        "duration": None if duration is None else quantity(duration, "s"),
        "highest": 0.0 if highest is None else quantity(highest, "Hz"),
    }


def _deliver(drive: Drive, out: Path | None, picture: Path | None, *, overwrite: bool) -> None:
    if out is not None:
        drive.write(out, overwrite=overwrite)
    if picture is not None:
        save_preview(drive, picture, overwrite=overwrite)
