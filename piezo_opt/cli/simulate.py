"""``piezo-opt simulate``: what a model reads on the drive of a record."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

from piezo_opt.cli import options as o
from piezo_opt.cli import outputs
from piezo_opt.cli.declare import Option, echo
from piezo_opt.cli.groups import grouped
from piezo_opt.cli.inputs import AS_WRITTEN, Reading, model_file
from piezo_opt.comparison.metrics import fit_percent, rms
from piezo_opt.readers import write
from piezo_opt.simulation import Initial
from piezo_opt.simulation import simulate as respond
from piezo_opt.units import show


class Beginning(Enum):
    """Where a simulation begins."""

    REST = "rest"
    PERIODIC = "periodic"


@grouped
def simulate(
    source: o.Record,
    model: Annotated[str, Option(metavar="MODEL.toml", help="Model file, or the JSON of a fit.")],
    out: Annotated[Path, Option(metavar="OUT.csv", help="Record to write: .csv or .h5.")],
    reading: Reading = AS_WRITTEN,
    start: Annotated[
        Beginning, Option(help="States at the beginning, plus those the model file gives.")
    ] = Beginning.REST,
    overwrite: o.Overwrite = False,
) -> None:
    """Simulate a model on the drive of a record.

    Values are those of the model file, nominal ones where it says nothing; OUT has the record's
    time and drive, and the model's reading as displacement.

    \b
    Example:
      piezo-opt simulate loop.csv --model fit.json --out simulated.csv
    """
    outputs.check({"--out": out}, overwrite=overwrite, inputs=(source, model))
    file = model_file(model)
    measured = reading.single(source).driven(file.between)
    response = respond(
        file.model, measured, file.numbers.of_record(0), initial=Initial(start.value)
    )
    answer = measured.with_(
        position=response.reading,
        name=f"{measured.name} simulated",
        source=f"simulated with {Path(model).name}",
        allow_saturated=True,
    )
    error = (measured.position - response.reading)[measured.counted]
    percent = fit_percent(measured.position[measured.counted], error)
    echo(
        f"{len(answer)} samples; measured minus simulated "
        f"{show(rms(error), measured.position_unit)} rms, fit {percent:.2f} %, scheme error "
        f"{show(response.accuracy.error, measured.position_unit)}"
        f"{'' if response.compiled else ' (no C compiler: slower virtual machine)'}."
    )
    write(answer, out, overwrite=overwrite)
